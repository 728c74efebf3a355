"""What a method did in every frame, in a few numbers each."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.evaluation.scores import FrameScore
from seaclutter_cli.frame import FilterResult, Reason, Rings

Series = NDArray[np.float32]


@dataclass(frozen=True)
class Numbers:
    """What a method did in one frame.

    Parameters
    ----------
    counts : ndarray, shape (7,)
        Points for each `Reason`; the first entry counts those kept.
    rings : Rings or None
        Thresholds and corrections, for methods that work in rings.
    scene : str, optional
        Class of scene, for methods that know scenes.
    """

    counts: NDArray[np.int64]
    rings: Rings | None
    scene: str | None = None

    @classmethod
    def of(cls, result: FilterResult | None) -> "Numbers | None":
        """Return those of a result; None where there is none."""
        return None if result is None else cls(result.counts, result.rings, result.scene)


class History:
    """The numbers of one method, frame by frame: some hundred bytes each.

    Parameters
    ----------
    rings : int
        Rings of the method, K; 0 without.
    """

    _ALARMS = ("visible", "omitted", "false_alarms")

    def __init__(self, rings: int) -> None:
        self._rings = rings
        self._rows: list[Series] = []
        self._scenes: list[str | None] = []

    def add(self, numbers: Numbers | None, score: FrameScore | None) -> None:
        """Add a frame; what is not known is NaN."""
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
        """Points for each `Reason`, shape (frames, 7)."""
        return self._columns(0, len(Reason))

    @property
    def scenes(self) -> dict[str, NDArray[np.bool_]]:
        """For each class of scene by name whether a frame is of it, shape (frames,); empty if none is known."""
        told = np.array([scene or "" for scene in self._scenes], object)
        return {name: told == name for name in sorted(set(told) - {""})}

    @property
    def clusters(self) -> Series:
        """Clusters of what was kept, shape (frames,)."""
        return self._columns(len(Reason), 1)[:, 0]

    @property
    def visible(self) -> Series:
        """Targets that could be seen, shape (frames,); NaN where a frame is not labelled."""
        return self._columns(len(Reason) + 1, 1)[:, 0]

    @property
    def omitted(self) -> Series:
        """Visible targets that were lost, shape (frames,)."""
        return self._columns(len(Reason) + 2, 1)[:, 0]

    @property
    def false_alarms(self) -> Series:
        """Clusters that are no targets, shape (frames,)."""
        return self._columns(len(Reason) + 3, 1)[:, 0]

    @property
    def thresholds(self) -> Series:
        """Thresholds used, shape (frames, K)."""
        return self._columns(len(Reason) + 4, self._rings)

    @property
    def corrections(self) -> Series:
        """Corrections used, shape (frames, K)."""
        return self._columns(len(Reason) + 4 + self._rings, self._rings)
