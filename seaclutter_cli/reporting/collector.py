"""Data of reports: statistics of all frames, points of frames that are selected while they arrive, and densities."""

from abc import ABC, abstractmethod
from bisect import insort
from collections import deque
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import astuple, dataclass
from functools import cache
from operator import itemgetter
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Ints, Mask, Rows
from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.evaluation.scores import FrameScore
from seaclutter_cli.frame import WATER_COLUMNS, WATER_REASONS, FilterResult, Frame, Reason
from seaclutter_cli.reporting.sample import Sample, take_sample
from seaclutter_cli.tracking.follow import CONFIRMED, Follower, FrameObjects
from seaclutter_cli.truth import Truth

Series = NDArray[np.float32]


class History:
    """Statistics of one method with K range rings, or none, for every frame: a few hundred bytes each.

    Columns by name, float32, NaN where unknown: ``counts`` for each `Reason`, shape (frames, reasons); ``missed`` and
    ``false_alarms``, shape (frames,); ``water``, shape (frames, 5), in the order of `WATER_COLUMNS`; ``thresholds`` and
    ``corrections``, shape (frames, K).
    """

    def __init__(self, rings: int) -> None:
        sizes = {"counts": len(Reason), "water": len(WATER_COLUMNS), "thresholds": rings, "corrections": rings}
        arrays = [(name, np.float32, (size,)) for name, size in sizes.items()]
        self._type = np.dtype([*arrays, ("missed", np.float32), ("false_alarms", np.float32)])
        self._rows: list[Rows] = []
        self._scenes: list[str] = []

    def add(self, result: FilterResult | None, score: FrameScore | None) -> None:
        """Add a frame; unknown values become NaN."""
        row = np.full((), np.nan, self._type)
        if result is not None:
            row["counts"] = result.counts
            if result.water is not None:
                row["water"] = astuple(result.water)
            if result.rings is not None and row["thresholds"].size:
                row["thresholds"] = result.rings.thresholds
                row["corrections"] = result.rings.corrections
        if score is not None and score.alarms is not None:
            row["missed"], row["false_alarms"] = score.alarms.missed, score.alarms.false_alarms
        self._rows.append(row)
        self._scenes.append((result.scene if result else None) or "")

    def __getitem__(self, name: str) -> Series:
        return np.array(self._rows, self._type)[name]

    @property
    def scenes(self) -> dict[str, Mask]:
        """Masks of the frames of each class of scene, shape (frames,), by its name; empty if no class is known."""
        names = np.array(self._scenes, object)
        return {name: names == name for name in sorted(set(self._scenes) - {""})}


@dataclass(frozen=True)
class ScoredFrame:
    """A frame of an evaluation or of a filtered log, with its truth, and result and score by each method."""

    frame: Frame
    results: Sequence[FilterResult | None]
    truth: Truth | None
    scores: Sequence[FrameScore | None]


class FrameListener(ABC):
    """A listener for the frames of an evaluation, or for those that are read back from filtered logs."""

    def begin(self, recording: str) -> None:  # noqa: B027 - most need not know
        """Start a recording."""

    @abstractmethod
    def add(self, scored: ScoredFrame) -> None:
        """Take a frame."""


MAX_BINS = 600
_COLUMNS, _ROWS = 120, 64


def bin_starts(frames: int) -> Ints:
    """Return the first frame of each bin, shape (B,), int64; all bins but the last have the same length."""
    size = max(1, -(-frames // MAX_BINS))
    return np.arange(0, frames, size)


def binned(values: Series, starts: Ints) -> tuple[Series, Series, Series]:
    """Return mean, minimum and maximum of each of B bins, shape (B, K) each; NaN for bins without known values.

    The series, shape (frames, K), are NaN where unknown; a bin begins at each of the frames ``starts``.
    """
    known = np.isfinite(values)
    count = np.add.reduceat(known, starts, axis=0, dtype=np.int64)
    total = np.add.reduceat(np.where(known, values, 0).astype(np.float64), starts, axis=0)
    mean = np.where(count, total / np.maximum(count, 1), np.nan)
    low, high = (reduce.reduceat(values, starts, axis=0) for reduce in (np.fmin, np.fmax))  # where known
    return mean.astype(np.float32), low, high


def density_of(
    samples: Sequence[Sample], method: int, edges: Sequence[float], threshold: float
) -> tuple[float, float, float, NDArray[np.float32]] | None:
    """Return the density of the points of several frames by the reasons of a method; None without intensities.

    It is the mean number of points per frame for each `Reason`, shape (reasons, rows, columns), in cells of equal size.
    Columns go from 0 to the range that comes first, rows from the least to the greatest intensity, and extend above the
    highest threshold; there are no edges without range rings.
    """
    if not samples:
        return None
    range_m = np.concatenate([sample.range_m for sample in samples])
    intensity = np.concatenate([sample.intensity for sample in samples]).astype(np.float64)
    weight = np.concatenate([sample.weight for sample in samples]) / len(samples)
    reason = np.concatenate([sample.reasons[method] for sample in samples])
    known = np.isfinite(intensity)
    if not known.any():
        return None
    reach_m = 1.15 * edges[-1] if edges else float(np.quantile(range_m[known], 0.98))
    shown = known & (range_m < reach_m)
    within = intensity[shown & (range_m >= (edges[0] if edges else 0.0))]
    low = min(0.0, float(np.quantile(within, 0.01))) if len(within) else 0.0
    high = max(float(np.quantile(within, 0.985)) if len(within) else 0.0, 1.5 * threshold)
    high = high if high > low else low + 1.0
    whole = bool((intensity[known] == np.floor(intensity[known])).all())
    rows = min(_ROWS, max(int(np.ceil(high - low)), 1)) if whole else _ROWS
    if whole:  # rows of fractional height would leave empty rows between the values
        high = low + rows * float(np.ceil((high - low) / rows))
    bins = ((0, len(Reason)), (low, high), (0, max(reach_m, 1e-3)))
    points = np.stack((reason[shown], intensity[shown], range_m[shown]), axis=1)
    counts, _ = np.histogramdd(points, (len(Reason), rows, _COLUMNS), bins, weights=weight[shown])
    return reach_m, low, high, counts.astype(np.float32)


_MIN_SPACING = 5
"""Minimum distance in frames between selected frames of a kind; closer frames look alike."""

Why = Literal["worst", "best", "even", "picked"]
"""Why a frame was selected: among the worst, among the best, evenly spaced, or requested."""

_NANO = 1_000_000_000
_PAGE_BYTES = 7_500_000
_POINTS = 24_000


@dataclass(frozen=True)
class Chosen:
    """A selected frame: its index among all frames, why it was selected, and the data stored for it."""

    row: int
    why: Why
    item: Sample


_Ranked = tuple[float, int, Chosen]
"""A frame among the worst or the best; the smallest key comes first, equal keys in pseudo-random order."""


class Choice:
    """Selection of the worst, the best and evenly spaced frames from a stream of unknown length.

    Half of the frames are the worst, a sixth the best. Every n-th frame is stored as evenly spaced; n doubles when
    there are four times too many.
    """

    def __init__(self, frames: int) -> None:
        self._bad, self._good = frames // 2, frames // 6
        self._even = frames - self._bad - self._good
        self._worst: list[_Ranked] = []
        self._best: list[_Ranked] = []
        self._spread: dict[int, Sample] = {}
        self._stride = 1

    def offer(self, row: int, *, badness: float | None, merit: float | None, make: Callable[[], Sample]) -> None:
        """Offer a frame for selection; rows must be in ascending order.

        A frame with a badness of 0 or None is never among the worst, one with a merit of None never among the best.
        ``make`` returns the data to store; it is called if the frame is selected.
        """
        make = cache(make)
        if badness:
            _insert(self._worst, -badness, self._bad, row, lambda: Chosen(row, "worst", make()))
        if merit is not None:
            _insert(self._best, -merit, self._good, row, lambda: Chosen(row, "best", make()))
        if row % self._stride == 0:
            self._spread[row] = make()
            if len(self._spread) > 4 * self._even:
                self._stride *= 2
                self._spread = {kept: item for kept, item in self._spread.items() if kept % self._stride == 0}

    def chosen(self) -> list[Chosen]:
        """Return the selected frames, each once: the worst first, then the best, then the others by row."""
        found: dict[int, Chosen] = {}
        for *_, one in (*self._worst, *self._best):
            found.setdefault(one.row, one)
        others = [Chosen(row, "even", item) for row, item in self._spread.items() if row not in found]
        room = min(self._bad + self._good + self._even - len(found), len(others))
        return [*found.values(), *(others[number * len(others) // room] for number in range(room))]

    def spread(self) -> list[Sample]:
        """Return all evenly spaced frames that are stored."""
        return list(self._spread.values())


def _insert(ranked: list[_Ranked], key: float, size: int, row: int, make: Callable[[], Chosen]) -> None:
    """Insert a frame into a ranked list; it replaces a frame close to it, if there is one."""
    keys = key, row * 2654435761 % 2**32  # spreads equal frames over the whole recording
    close = next((number for number, (*_, one) in enumerate(ranked) if row - one.row < _MIN_SPACING), None)
    rival = close if close is not None else len(ranked) - 1 if len(ranked) == size else None
    if not size or (rival is not None and keys >= ranked[rival][:2]):
        return
    if rival is not None:
        del ranked[rival]
    insort(ranked, (*keys, make()), key=itemgetter(0, 1))


_MOST_TRACKS, _MOST_PLACES = 60, 200


class TrackPaths:
    """Tracks of the objects of all recordings, relative to own ship; of each, at most a few hundred positions."""

    def __init__(self, new: Callable[[], Follower]) -> None:
        self._new, self._follower = new, new()
        self._rows: deque[int] = deque()
        self._recording = -1
        self._tracks: dict[tuple[int, int], dict[str, Any]] = {}

    def begin(self) -> None:
        """Start a recording."""
        self._take(self._follower.finish())
        self._follower, self._recording = self._new(), self._recording + 1

    def add(self, row: int, result: FilterResult) -> None:
        """Follow the objects of a frame, given its number among all frames."""
        self._rows.append(row)
        self._take(self._follower.add(result, None))

    def found(self) -> list[dict[str, Any]]:
        """Return the confirmed tracks that were seen most; call it after the last frame."""
        self._take(self._follower.finish())
        return sorted(self._tracks.values(), key=lambda one: -one["frames"])[:_MOST_TRACKS]

    def _take(self, frames: Iterable[FrameObjects]) -> None:
        for frame in frames:
            row = self._rows.popleft()
            speeds = np.hypot(*frame.velocities.T)
            for k, (number, state) in enumerate(zip(frame.tracks, frame.states, strict=True)):
                if state != CONFIRMED:
                    continue
                fresh = {"recording": self._recording, "id": number, "frames": 0, "rows": [], "places": [], "step": 1}
                one = self._tracks.setdefault((self._recording, number), fresh)
                if one["frames"] % one["step"] == 0:
                    one["rows"].append(row)
                    one["places"].append(frame.centers[k, :2].round(1).tolist())
                if len(one["rows"]) > _MOST_PLACES:
                    one["rows"], one["places"], one["step"] = one["rows"][::2], one["places"][::2], 2 * one["step"]
                one["frames"] += 1
                one["size"], one["yaw"] = frame.sizes[k].round(2).tolist(), round(float(frame.yaws[k]), 3)
                one["speed"], one["score"] = round(float(speeds[k]), 1), round(float(frame.scores[k]), 2)
                one["kind"] = frame.kinds[k]


@dataclass(frozen=True)
class Method:
    """A method in a report: its name, edges of its range rings in metres, if it has some, and configuration as YAML."""

    name: str
    edges: Sequence[float]
    config: str


class Collector(FrameListener):
    """Collector of the statistics of all frames and the points of selected frames.

    It stores a few hundred bytes for every frame, and points for a few dozen frames at most, however long the logs are.
    The first method determines the worst frames: those with the most false alarms and missed targets; without labels,
    those with the largest share of points removed as clutter. Frames with the numbers in ``picks`` are shown, too.
    """

    def __init__(
        self,
        methods: Sequence[Method],
        params: EvaluationParams,
        new_follower: Callable[[], Follower],
        *,
        labelled: bool,
        frames: int,
        picks: Collection[int] = (),
    ) -> None:
        self.methods, self.params, self.labelled = methods, params, labelled
        self.recordings: list[str] = []
        self.timeline: list[tuple[int, int, float]] = []
        """Recording index, number within the recording, and time in seconds within the recording of each frame."""
        self.histories = [History(max(len(method.edges) - 1, 0)) for method in methods]
        self.tracks = TrackPaths(new_follower)
        self._choice = Choice(frames)
        self._picks, self._picked = frozenset(picks), dict[int, Sample]()
        self._first_ns: int | None = None
        bytes_per_point = (3 * 2 + 1 + 1 + len(methods)) * 4 / 3
        self._points = min(_POINTS, int(_PAGE_BYTES / (frames + len(self._picks)) / bytes_per_point))

    def begin(self, recording: str) -> None:
        """Start a recording."""
        self.recordings.append(recording)
        self.tracks.begin()
        self._first_ns = None

    def add(self, scored: ScoredFrame) -> None:
        """Take the statistics of a frame, and its points if it is selected."""
        frame = scored.frame
        if self._first_ns is None:
            self._first_ns = frame.log_time_ns
        row = len(self.timeline)
        self.timeline.append((len(self.recordings) - 1, frame.index, (frame.log_time_ns - self._first_ns) / _NANO))
        if scored.results[0] is not None:
            self.tracks.add(row, scored.results[0])
        for history, own, score in zip(self.histories, scored.results, scored.scores, strict=True):
            history.add(own, score)

        def make() -> Sample:
            return take_sample(frame, scored.results, scored.truth, self.params, self._points)

        if frame.index in self._picks:
            self._picked[row] = make()
        badness, merit = _judged(scored, labelled=self.labelled)
        self._choice.offer(row, badness=badness, merit=merit, make=make)

    @property
    def chosen(self) -> list[Chosen]:
        """Frames to show, the worst first."""
        history = self.histories[0]
        errors = np.nan_to_num(history["false_alarms"]) + np.nan_to_num(history["missed"])
        found = [one for one in self._choice.chosen() if one.row not in self._picked]
        found += [Chosen(row, "picked", sample) for row, sample in self._picked.items()]
        return sorted(found, key=lambda one: (-float(errors[one.row]), one.row if self.labelled else 0))

    @property
    def figure_sample(self) -> Sample:
        """Frame shown in figures: the first requested one, otherwise the worst."""
        return next(iter(self._picked.values()), None) or self.chosen[0].item

    @property
    def spread(self) -> list[Sample]:
        """Evenly spaced frames that represent all frames."""
        return self._choice.spread()


def _judged(scored: ScoredFrame, *, labelled: bool) -> tuple[float | None, float | None]:
    """Return badness and merit of a frame by its first method: its errors, and its detected targets if there are none.

    Without labels, they are the share of points removed as clutter, and its negative.
    """
    score, result = scored.scores[0], scored.results[0]
    if labelled and score and score.alarms:
        errors = score.alarms.false_alarms + score.alarms.missed
        return float(errors), None if errors else float(score.alarms.detected)
    if labelled or result is None:
        return None, None
    removed = float(result.counts[[Reason.LOW_INTENSITY, Reason.OUTLIER, *WATER_REASONS]].sum())
    share = removed / max(float(result.counts.sum()), 1.0)
    return share, -share
