"""How well scenes are told: the confusion matrix, precision and recall of each class."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Confusion:
    """Which scenes were taken for which.

    Parameters
    ----------
    classes : sequence of str
        Names of the scenes.
    counts : ndarray, shape (C, C), int64
        Frames by what they show (row) and what they were taken for (column).
    """

    classes: Sequence[str]
    counts: NDArray[np.int64]

    @classmethod
    def of(cls, classes: Sequence[str], truth: NDArray[np.int64], told: NDArray[np.int64]) -> "Confusion":
        """Count frames, shape (N,), by their true and told classes."""
        size = len(classes)
        return cls(classes, np.bincount(size * truth + told, minlength=size * size).reshape(size, size))

    @property
    def precision(self) -> NDArray[np.float64]:
        """Share of the frames told to be of a class that are, shape (C,); NaN where there are none."""
        return _ratio(np.diag(self.counts), self.counts.sum(axis=0))

    @property
    def recall(self) -> NDArray[np.float64]:
        """Share of the frames of a class that were told to be, shape (C,); NaN where there are none."""
        return _ratio(np.diag(self.counts), self.counts.sum(axis=1))

    @property
    def accuracy(self) -> float:
        """Share of the frames told right; NaN if there are none."""
        return float(_ratio(np.asarray(np.trace(self.counts)), self.counts.sum()))

    @property
    def mean_precision(self) -> float:
        """Mean of the classes' precisions; one that was never told counts as 0."""
        return float(np.nan_to_num(self.precision).mean())

    def as_dict(self) -> dict[str, Any]:
        """Return counts, precision and recall as JSON holds them."""
        columns = zip(self.classes, self.counts.tolist(), _plain(self.precision), _plain(self.recall), strict=True)
        return {
            name: {"told": dict(zip(self.classes, row, strict=True)), "precision": precision, "recall": recall}
            for name, row, precision, recall in columns
        }


def _ratio(part: NDArray[np.int64], whole: NDArray[np.int64]) -> NDArray[np.float64]:
    with np.errstate(invalid="ignore"):
        return np.asarray(part / whole)


def _plain(values: NDArray[np.float64]) -> list[float | None]:
    return [round(value, 6) if np.isfinite(value) else None for value in values.tolist()]
