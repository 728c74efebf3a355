"""Scores of scene classifiers."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.evaluation.confusion import Confusion


@dataclass(frozen=True)
class SceneScores(Confusion):
    """Confusion matrix of scenes.

    Parameters
    ----------
    counts : ndarray, shape (C, C), int64
        Frames by true class (row) and predicted class (column).
    classes : sequence of str
        Names of the scenes.
    """

    classes: Sequence[str]

    @classmethod
    def count(cls, classes: Sequence[str], truth: NDArray[np.int64], predicted: NDArray[np.int64]) -> "SceneScores":
        """Return the scores of frames from the indices of their true and predicted classes, shape (N,)."""
        return cls(Confusion.of(truth, predicted, range(len(classes))).counts, classes)

    @property
    def mean_precision(self) -> float:
        """Mean precision of the classes; a class that is never predicted counts as 0."""
        return float(np.nan_to_num(self.precision).mean())

    def as_dict(self) -> dict[str, Any]:
        """Return counts, precision and recall as JSON-compatible data."""
        columns = zip(self.classes, self.counts.tolist(), _plain(self.precision), _plain(self.recall), strict=True)
        return {
            name: {"predicted": dict(zip(self.classes, row, strict=True)), "precision": precision, "recall": recall}
            for name, row, precision, recall in columns
        }


def _plain(values: NDArray[np.float64]) -> list[float | None]:
    return [round(value, 6) if np.isfinite(value) else None for value in values.tolist()]
