"""Collection of report data during filtering: statistics of all frames and points of selected frames."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np

from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.evaluation.scores import FrameScore
from seaclutter_cli.frame import Reason
from seaclutter_cli.reporting.choice import Choice, Chosen
from seaclutter_cli.reporting.history import FrameListener, FrameStatistics, History, ScoredFrame
from seaclutter_cli.reporting.sample import Sample, take_sample

_NANO = 1_000_000_000
_PAGE_BYTES = 7_500_000
_POINTS = 24_000


@dataclass(frozen=True)
class Method:
    """A method in a report: its name, edges of its range rings in metres, if it has some, and configuration as YAML."""

    name: str
    edges: Sequence[float]
    config: str


@dataclass
class Timeline:
    """Recording index, number within the recording, and time in seconds within the recording of each frame."""

    recording: list[int] = field(default_factory=list)
    frame: list[int] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)


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
        *,
        labelled: bool,
        frames: int,
        picks: Collection[int] = (),
    ) -> None:
        self.methods, self.params, self.labelled = methods, params, labelled
        self.recordings: list[str] = []
        self.timeline = Timeline()
        self.histories = [History(max(len(method.edges) - 1, 0)) for method in methods]
        self._choice: Choice[Sample] = Choice(frames)
        self._picks, self._picked = frozenset(picks), dict[int, Sample]()
        self._first_ns: int | None = None
        bytes_per_point = (3 * 2 + 1 + 1 + len(methods)) * 4 / 3
        self._points = min(_POINTS, int(_PAGE_BYTES / (frames + len(self._picks)) / bytes_per_point))

    def begin(self, recording: str) -> None:
        """Start a recording."""
        self.recordings.append(recording)
        self._first_ns = None

    def expect(self, frames: int) -> None:
        """Take the approximate number of frames, before the first of them."""
        if not self.timeline.frame:
            self._choice.expect(frames)

    def add(self, scored: ScoredFrame) -> None:
        """Take the statistics of a frame; its results are requested only if its points are stored."""
        frame = scored.frame
        if self._first_ns is None:
            self._first_ns = frame.log_time_ns
        row = len(self.timeline.frame)
        self.timeline.recording.append(len(self.recordings) - 1)
        self.timeline.frame.append(frame.index)
        self.timeline.seconds.append((frame.log_time_ns - self._first_ns) / _NANO)
        for history, own, score in zip(self.histories, scored.statistics, scored.scores, strict=True):
            history.add(own, score)

        def make() -> Sample:
            return take_sample(frame, scored.results(), scored.truth, self.params, self._points)

        if frame.index in self._picks:
            self._picked[row] = make()
        badness, merit = _by_alarms(scored.scores[0]) if self.labelled else _by_removal(scored.statistics[0])
        self._choice.offer(row, badness=badness, merit=merit, make=make)

    @property
    def chosen(self) -> list[Chosen[Sample]]:
        """Frames to show, the worst first."""
        history = self.histories[0]
        errors = np.nan_to_num(history.false_alarms) + np.nan_to_num(history.missed)
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
        return [sample for _, sample in self._choice.spread()]


def _by_alarms(score: FrameScore | None) -> tuple[float | None, float | None]:
    """Return badness and merit of a labelled frame: its errors and, if there are none, its detected targets."""
    if score is None or score.alarms is None:
        return None, None
    errors = score.alarms.false_alarms + score.alarms.missed
    return float(errors), None if errors else float(score.alarms.detected)


def _by_removal(statistics: FrameStatistics | None) -> tuple[float | None, float | None]:
    """Return badness and merit of an unlabelled frame: the share removed as clutter, and its negative."""
    if statistics is None:
        return None, None
    clutter = [Reason.LOW_INTENSITY, Reason.OUTLIER, Reason.UNCONFIRMED]
    removed = float(statistics.counts[clutter].sum())
    share = removed / max(float(statistics.counts.sum()), 1.0)
    return share, -share
