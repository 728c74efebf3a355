"""How well scenes are told."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.evaluation.confusion import Confusion


@dataclass(frozen=True)
class SceneScores(Confusion):
    """Which scenes frames were taken for.

    Parameters
    ----------
    counts : ndarray, shape (C, C), int64
        Frames by what they show (row) and what they were taken for (column).
    classes : sequence of str
        Names of the scenes.
    """

    classes: Sequence[str]

    @classmethod
    def count(cls, classes: Sequence[str], truth: NDArray[np.int64], told: NDArray[np.int64]) -> "SceneScores":
        """Count frames, shape (N,), by the places of their true and told classes."""
        return cls(Confusion.of(truth, told, range(len(classes))).counts, classes)

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


def _plain(values: NDArray[np.float64]) -> list[float | None]:
    return [round(value, 6) if np.isfinite(value) else None for value in values.tolist()]
