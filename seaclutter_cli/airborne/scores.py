"""How well classes were told: from a confusion matrix."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Counts = NDArray[np.int64]


def confusion(truth: NDArray[Any], found: NDArray[Any], classes: Sequence[int]) -> Counts:
    """Return how many points of each class, by row, were called what, by column, shape (C, C); others are left out.

    Examples
    --------
    >>> confusion(np.array([1, 1, 9, 5]), np.array([1, 9, 9, 9]), (1, 9))
    array([[1, 1],
           [0, 1]])
    """
    place = np.full(int(max(classes)) + 1, -1)
    place[list(classes)] = np.arange(len(classes))
    known = np.isin(truth, classes) & np.isin(found, classes)
    rows, columns = place[truth[known]], place[found[known]]
    return np.bincount(rows * len(classes) + columns, minlength=len(classes) ** 2).reshape(len(classes), -1)


@dataclass(frozen=True)
class Scores:
    """Scores of C classes.

    Parameters
    ----------
    matrix : ndarray, shape (C, C), int64
        `confusion`.
    """

    matrix: Counts

    @property
    def precision(self) -> NDArray[np.float64]:
        """Share of what was called a class that is of it, shape (C,); NaN where nothing was."""
        return _share(np.diag(self.matrix), self.matrix.sum(axis=0))

    @property
    def recall(self) -> NDArray[np.float64]:
        """Share of a class that was called so, shape (C,); NaN where there is nothing of it."""
        return _share(np.diag(self.matrix), self.matrix.sum(axis=1))

    @property
    def f1(self) -> NDArray[np.float64]:
        """Harmonic mean of precision and recall, shape (C,); NaN where a class is neither there nor found."""
        return _share(2 * np.diag(self.matrix), self.matrix.sum(axis=0) + self.matrix.sum(axis=1))

    @property
    def macro_f1(self) -> float:
        """Mean F1 of the classes that are there or were found."""
        known = self.f1[np.isfinite(self.f1)]
        return float(known.mean()) if len(known) else float("nan")

    @property
    def accuracy(self) -> float:
        """Share of all that was called what it is."""
        return float(_share(np.trace(self.matrix), self.matrix.sum()))

    @property
    def kappa(self) -> float:
        r"""Cohen's kappa: :math:`(p_o - p_e) / (1 - p_e)`.

        Examples
        --------
        >>> round(Scores(np.array([[20, 5], [10, 15]])).kappa, 3)
        0.4
        """
        total = self.matrix.sum()
        chance = float(_share(self.matrix.sum(axis=0) @ self.matrix.sum(axis=1), total.astype(float) ** 2))
        return (self.accuracy - chance) / (1 - chance) if chance < 1 else float("nan")


def _share(part: Any, whole: Any) -> NDArray[np.float64]:
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.true_divide(part, whole))
