"""Statistics of a method for every frame, and the interfaces of those who receive them."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.evaluation.scores import FrameScore
from seaclutter_cli.frame import WATER_COLUMNS, FilterResult, Frame, Reason, Rings, WaterState
from seaclutter_cli.truth import Truth

Series = NDArray[np.float32]


@dataclass(frozen=True)
class FrameStatistics:
    """What a `FilterResult` tells apart from the reasons of the points; of them the counts for each `Reason`."""

    counts: NDArray[np.int64]
    rings: Rings | None
    scene: str | None = None
    water: WaterState | None = None


class History:
    """Statistics of one method with K range rings, or none, for every frame: a few hundred bytes each.

    Columns by name, float32, NaN where unknown: ``counts`` for each `Reason`, shape (frames, 8); ``missed`` and
    ``false_alarms``, shape (frames,); ``water``, shape (frames, 4), in the order of `WATER_COLUMNS`; ``thresholds`` and
    ``corrections``, shape (frames, K).
    """

    def __init__(self, rings: int) -> None:
        sizes = {"counts": len(Reason), "water": len(WATER_COLUMNS), "thresholds": rings, "corrections": rings}
        arrays = [(name, np.float32, (size,)) for name, size in sizes.items()]
        self._type = np.dtype([*arrays, ("missed", np.float32), ("false_alarms", np.float32)])
        self._rows: list[NDArray[np.void]] = []
        self._scenes: list[str] = []

    def add(self, statistics: FrameStatistics | FilterResult | None, score: FrameScore | None) -> None:
        """Add a frame; unknown values become NaN."""
        row = np.full((), np.nan, self._type)
        if statistics is not None:
            row["counts"] = statistics.counts
            if statistics.water is not None:
                row["water"] = astuple(statistics.water)
            if statistics.rings is not None and row["thresholds"].size:
                row["thresholds"] = statistics.rings.thresholds
                row["corrections"] = statistics.rings.corrections
        if score is not None and score.alarms is not None:
            row["missed"], row["false_alarms"] = score.alarms.missed, score.alarms.false_alarms
        self._rows.append(row)
        self._scenes.append((statistics.scene if statistics else None) or "")

    def __getitem__(self, name: str) -> Series:
        """Return a column."""
        return np.array(self._rows, self._type)[name]

    @property
    def scenes(self) -> dict[str, NDArray[np.bool_]]:
        """Masks of the frames of each class of scene, shape (frames,), by its name; empty if no class is known."""
        names = np.array(self._scenes, object)
        return {name: names == name for name in sorted(set(self._scenes) - {""})}


@dataclass(frozen=True)
class ScoredFrame:
    """A frame of an evaluation or of a filtered log, with its truth, and statistics and score by each method.

    ``results`` returns the result of each method, which may be slow.
    """

    frame: Frame
    statistics: Sequence[FrameStatistics | FilterResult | None]
    truth: Truth | None
    scores: Sequence[FrameScore | None]
    results: Callable[[], Sequence[FilterResult | None]]


class FrameListener(ABC):
    """A listener for the frames of an evaluation, or for those that are read back from filtered logs."""

    @abstractmethod
    def begin(self, recording: str) -> None:
        """Start a recording."""

    @abstractmethod
    def add(self, scored: ScoredFrame) -> None:
        """Take a frame."""
