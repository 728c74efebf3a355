"""Statistics of a method for every frame."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.evaluation.scores import FrameScore
from seaclutter_cli.frame import FilterResult, Reason, Rings

Series = NDArray[np.float32]


@dataclass(frozen=True)
class Numbers:
    """Statistics of a method for one frame.

    Parameters
    ----------
    counts : ndarray, shape (8,)
        Points for each `Reason`; the first entry counts the kept points.
    rings : Rings or None
        Thresholds and corrections, for methods with range rings.
    scene : str, optional
        Class of scene, for methods that distinguish scenes.
    """

    counts: NDArray[np.int64]
    rings: Rings | None
    scene: str | None = None

    @classmethod
    def of(cls, result: FilterResult | None) -> "Numbers | None":
        """Return the statistics of a result; None without a result."""
        return None if result is None else cls(result.counts, result.rings, result.scene)


class History:
    """Statistics of one method for every frame, a few hundred bytes each.

    Parameters
    ----------
    rings : int
        Number of range rings of the method, K; 0 without range rings.
    """

    _ALARMS = ("visible", "missed", "false_alarms")

    def __init__(self, rings: int) -> None:
        self._rings = rings
        self._rows: list[Series] = []
        self._scenes: list[str | None] = []

    def add(self, numbers: Numbers | None, score: FrameScore | None) -> None:
        """Add a frame; unknown values become NaN."""
        row = np.full(len(Reason) + len(self._ALARMS) + 1 + 2 * self._rings, np.nan, np.float32)
        if numbers is not None:
            row[: len(Reason)] = numbers.counts
            if numbers.rings is not None and self._rings:
                row[-2 * self._rings :] = np.concatenate((numbers.rings.thresholds, numbers.rings.corrections))
        if score is not None:
            row[len(Reason)] = score.clusters
            if score.alarms is not None:
                alarms = [getattr(score.alarms, name) for name in self._ALARMS]
                row[len(Reason) + 1 :][: len(alarms)] = alarms
        self._rows.append(row)
        self._scenes.append(numbers.scene if numbers else None)

    def _columns(self, first: int, count: int) -> Series:
        width = len(Reason) + len(self._ALARMS) + 1 + 2 * self._rings
        return np.array(self._rows, np.float32).reshape(-1, width)[:, first : first + count]

    @property
    def counts(self) -> Series:
        """Points for each `Reason`, shape (frames, 8)."""
        return self._columns(0, len(Reason))

    @property
    def scenes(self) -> dict[str, NDArray[np.bool_]]:
        """Masks of the frames of each class of scene, shape (frames,), by its name; empty if no class is known."""
        names = np.array([scene or "" for scene in self._scenes], object)
        return {name: names == name for name in sorted(set(names) - {""})}

    @property
    def clusters(self) -> Series:
        """Clusters of the kept points, shape (frames,)."""
        return self._columns(len(Reason), 1)[:, 0]

    @property
    def visible(self) -> Series:
        """Visible targets, shape (frames,); NaN for unlabelled frames."""
        return self._columns(len(Reason) + 1, 1)[:, 0]

    @property
    def missed(self) -> Series:
        """Missed targets, shape (frames,); NaN for unlabelled frames."""
        return self._columns(len(Reason) + 2, 1)[:, 0]

    @property
    def false_alarms(self) -> Series:
        """False alarms, shape (frames,); NaN for unlabelled frames."""
        return self._columns(len(Reason) + 3, 1)[:, 0]

    @property
    def thresholds(self) -> Series:
        """Thresholds of the range rings, shape (frames, K)."""
        return self._columns(len(Reason) + 4, self._rings)

    @property
    def corrections(self) -> Series:
        """Corrections of the range rings, shape (frames, K)."""
        return self._columns(len(Reason) + 4 + self._rings, self._rings)
