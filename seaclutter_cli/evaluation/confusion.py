"""Confusion matrix of a classification, and the scores derived from it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Floats, Ints


@dataclass(frozen=True)
class Confusion:
    """Confusion matrix: points or frames by true class (row) and predicted class (column), shape (C, C), int64."""

    counts: Ints

    @staticmethod
    def of(truth: NDArray[Any], found: NDArray[Any], codes: Sequence[int]) -> "Confusion":
        """Return the matrix of true and predicted class codes, each of shape (N,), but of those in ascending codes."""
        known = np.isin(truth, codes) & np.isin(found, codes)
        rows, columns = (np.searchsorted(codes, one[known]) for one in (truth, found))
        return Confusion(np.bincount(rows * len(codes) + columns, minlength=len(codes) ** 2).reshape(len(codes), -1))

    @property
    def precision(self) -> Floats:
        """Share of the predictions of each class that are correct, shape (C,); NaN without predictions."""
        return _share(np.diag(self.counts), self.counts.sum(axis=0))

    @property
    def recall(self) -> Floats:
        """Share of the members of each class that are predicted correctly, shape (C,); NaN without members."""
        return _share(np.diag(self.counts), self.counts.sum(axis=1))

    @property
    def f1(self) -> Floats:
        """Harmonic mean of precision and recall, shape (C,); NaN where a class is neither present nor predicted."""
        return _share(2 * np.diag(self.counts), self.counts.sum(axis=0) + self.counts.sum(axis=1))

    @property
    def macro_f1(self) -> float:
        """Mean F1 of the classes that are present or predicted."""
        known = self.f1[np.isfinite(self.f1)]
        return float(known.mean()) if len(known) else float("nan")

    @property
    def accuracy(self) -> float:
        """Share of correct predictions."""
        return float(_share(np.trace(self.counts), self.counts.sum()))

    @property
    def kappa(self) -> float:
        r"""Cohen's kappa: :math:`(p_o - p_e) / (1 - p_e)`."""
        total = self.counts.sum()
        expected = float(_share(self.counts.sum(axis=0) @ self.counts.sum(axis=1), total.astype(float) ** 2))
        return (self.accuracy - expected) / (1 - expected) if expected < 1 else float("nan")


def _share(part: Any, whole: Any) -> Floats:
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.true_divide(part, whole))
