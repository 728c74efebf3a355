"""Statistics of a method for every frame, and the interfaces of those who receive them."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.evaluation.scores import FrameScore
from seaclutter_cli.frame import WATER_COLUMNS, FilterResult, Frame, Reason, Rings, WaterState
from seaclutter_cli.truth import Truth

Series = NDArray[np.float32]


@dataclass(frozen=True)
class FrameStatistics:
    """Statistics of a method for one frame: points for each `Reason`, shape (8,), and what else the method tells.

    There are thresholds and corrections of methods with range rings, the class of scene, and the water, if there is
    some.
    """

    counts: NDArray[np.int64]
    rings: Rings | None
    scene: str | None = None
    water: WaterState | None = None

    @classmethod
    def of(cls, result: FilterResult | None) -> "FrameStatistics | None":
        """Return the statistics of a result; None without a result."""
        return None if result is None else cls(result.counts, result.rings, result.scene, result.water)


class History:
    """Statistics of one method with K range rings, or none, for every frame: a few hundred bytes each."""

    _ALARMS = ("missed", "false_alarms")

    def __init__(self, rings: int) -> None:
        sizes = {
            "counts": len(Reason),
            "alarms": len(self._ALARMS),
            "water": len(WATER_COLUMNS),
            "thresholds": rings,
            "corrections": rings,
        }
        ends = pairwise(accumulate(sizes.values(), initial=0))
        self._parts = {name: slice(*part) for name, part in zip(sizes, ends, strict=True)}
        self._width = sum(sizes.values())
        self._rows: list[Series] = []
        self._scenes: list[str | None] = []

    def add(self, statistics: FrameStatistics | None, score: FrameScore | None) -> None:
        """Add a frame; unknown values become NaN."""
        row, parts = np.full(self._width, np.nan, np.float32), self._parts
        if statistics is not None:
            row[parts["counts"]] = statistics.counts
            if statistics.water is not None:
                row[parts["water"]] = astuple(statistics.water)
            if statistics.rings is not None and len(row[parts["thresholds"]]):
                row[parts["thresholds"]] = statistics.rings.thresholds
                row[parts["corrections"]] = statistics.rings.corrections
        if score is not None and score.alarms is not None:
            row[parts["alarms"]] = [getattr(score.alarms, name) for name in self._ALARMS]
        self._rows.append(row)
        self._scenes.append(statistics.scene if statistics else None)

    def _columns(self, part: str) -> Series:
        return np.array(self._rows, np.float32).reshape(-1, self._width)[:, self._parts[part]]

    @property
    def counts(self) -> Series:
        """Points for each `Reason`, shape (frames, 8)."""
        return self._columns("counts")

    @property
    def scenes(self) -> dict[str, NDArray[np.bool_]]:
        """Masks of the frames of each class of scene, shape (frames,), by its name; empty if no class is known."""
        names = np.array([scene or "" for scene in self._scenes], object)
        return {name: names == name for name in sorted(set(names) - {""})}

    @property
    def missed(self) -> Series:
        """Missed targets, shape (frames,); NaN for unlabelled frames."""
        return self._columns("alarms")[:, 0]

    @property
    def false_alarms(self) -> Series:
        """False alarms, shape (frames,); NaN for unlabelled frames."""
        return self._columns("alarms")[:, 1]

    @property
    def water(self) -> Series:
        """Values of `WaterState`, shape (frames, 4), in the order of `WATER_COLUMNS`; NaN without water."""
        return self._columns("water")

    @property
    def thresholds(self) -> Series:
        """Thresholds of the range rings, shape (frames, K)."""
        return self._columns("thresholds")

    @property
    def corrections(self) -> Series:
        """Corrections of the range rings, shape (frames, K)."""
        return self._columns("corrections")


@dataclass(frozen=True)
class ScoredFrame:
    """A frame of an evaluation or of a filtered log, with its truth, and statistics and score by each method.

    ``results`` returns the result of each method, which may be slow.
    """

    frame: Frame
    statistics: Sequence[FrameStatistics | None]
    truth: Truth | None
    scores: Sequence[FrameScore | None]
    results: Callable[[], Sequence[FilterResult | None]]


class FrameListener(ABC):
    """A listener for the frames of an evaluation, or for those that are read back from filtered logs."""

    @abstractmethod
    def begin(self, recording: str) -> None:
        """Start a recording."""

    def expect(self, frames: int) -> None:  # noqa: B027 - optional for subclasses
        """Take the approximate number of frames, before the first of them."""

    @abstractmethod
    def add(self, scored: ScoredFrame) -> None:
        """Take a frame."""
