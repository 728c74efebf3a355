"""Looks on while frames are filtered, and keeps what a report shows: numbers of all, points of some."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field

import numpy as np

from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.evaluation.scores import FrameScore
from seaclutter_cli.frame import FilterResult, Frame, Reason
from seaclutter_cli.reporting.choice import Choice, Chosen
from seaclutter_cli.reporting.history import History, Numbers
from seaclutter_cli.reporting.listener import ReplayListener
from seaclutter_cli.reporting.sample import Sample, take_sample
from seaclutter_cli.truth import Truth

_NANO = 1_000_000_000
_PAGE_BYTES = 7_500_000
_POINTS = 24_000


@dataclass(frozen=True)
class Method:
    """A method as the report names it.

    Parameters
    ----------
    name : str
        What it is called in tables.
    edges : sequence of float
        Ring edges in metres; empty without rings.
    config : str
        The effective configuration as YAML.
    """

    name: str
    edges: Sequence[float]
    config: str


@dataclass
class Timeline:
    """Where frames lie: for each one the recording, its number there, and seconds from the recording's start."""

    recording: list[int] = field(default_factory=list)
    frame: list[int] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)


class Collector(ReplayListener):
    """Keeps some hundred bytes of every frame and the points of a few dozen, whatever the length of the logs.

    The first method decides which frames are worst: those with the most false and omitted alarms; without labels,
    those of which the largest share is removed.

    Parameters
    ----------
    methods : sequence of Method
        Whose results it is told, in this order.
    params : EvaluationParams
        Limits of clusters and targets.
    labelled : bool
        Whether there are labels.
    frames : int
        Frames to choose for a look.
    picks : collection of int, optional
        Numbers of frames to show in any case.
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
        """Hear how many frames there will be."""
        if not self.timeline.frame:
            self._choice.expect(frames)

    def add(
        self,
        frame: Frame,
        numbers: Sequence[Numbers | None],
        truth: Truth | None,
        scores: Sequence[FrameScore | None],
        results: Callable[[], Sequence[FilterResult | None]],
    ) -> None:
        """Take the numbers of a frame; ``results`` is called only if its points are kept."""
        if self._first_ns is None:
            self._first_ns = frame.log_time_ns
        row = len(self.timeline.frame)
        self.timeline.recording.append(len(self.recordings) - 1)
        self.timeline.frame.append(frame.index)
        self.timeline.seconds.append((frame.log_time_ns - self._first_ns) / _NANO)
        for history, own, score in zip(self.histories, numbers, scores, strict=True):
            history.add(own, score)

        def make() -> Sample:
            return take_sample(frame, results(), truth, self.params, self._points)

        if frame.index in self._picks:
            self._picked[row] = make()
        badness, merit = _by_alarms(scores[0]) if self.labelled else _by_removal(numbers[0])
        self._choice.offer(row, badness=badness, merit=merit, make=make)

    @property
    def chosen(self) -> list[Chosen[Sample]]:
        """The frames to look at, those that went wrong first, the worst of them at the head."""
        history = self.histories[0]
        wrong = np.nan_to_num(history.false_alarms) + np.nan_to_num(history.omitted)
        found = [one for one in self._choice.chosen() if one.row not in self._picked]
        found += [Chosen(row, "picked", sample) for row, sample in self._picked.items()]
        return sorted(found, key=lambda one: (-float(wrong[one.row]), one.row if self.labelled else 0))

    @property
    def foremost(self) -> Sample:
        """The frame that figures show: the first that was asked for, else the worst."""
        return next(iter(self._picked.values()), None) or self.chosen[0].item

    @property
    def spread(self) -> list[Sample]:
        """Frames evenly spread, which stand for all."""
        return [sample for _, sample in self._choice.spread()]


def _by_alarms(score: FrameScore | None) -> tuple[float | None, float | None]:
    """Return how bad a labelled frame is and, if it is not bad, how good."""
    if score is None or score.alarms is None:
        return None, None
    wrong = score.alarms.false_alarms + score.alarms.omitted
    return float(wrong), None if wrong else float(score.alarms.detected)


def _by_removal(numbers: Numbers | None) -> tuple[float | None, float | None]:
    """Return how much of a frame is removed as clutter, and how little."""
    if numbers is None:
        return None, None
    removed = float(numbers.counts[Reason.LOW_INTENSITY] + numbers.counts[Reason.OUTLIER])
    share = removed / max(float(numbers.counts.sum()), 1.0)
    return share, -share
