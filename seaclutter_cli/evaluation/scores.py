"""Scores of frames and recordings: the rates of [Li2023], Table 4 (Eq. 9 and 10), and others; the best of them."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, field, fields
from operator import add
from typing import Any, TypeVar

import numpy as np

from seaclutter_cli.arrays import Floats, Ints
from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.evaluation.matching import Alarms, finder_of, match, point_truth, targets_of
from seaclutter_cli.frame import FilterResult, Frame, Reason
from seaclutter_cli.truth import CLUTTER, IGNORED, Truth

ALARM_COLUMNS = (
    *("targets", "visible", "detected", "omitted_alarms"),
    *("clusters", "false_alarms", "points_in", "points_out"),
)
POINT_COLUMNS = ("target_points_in", "target_points_out", "clutter_points_in", "clutter_points_out")

K = TypeVar("K")
_MIN_S, _STEP, _BINS = 1e-7, 1.01, 2400
_MAX_PARTS = 64


@dataclass(frozen=True)
class PointCounts:
    """Number of target and clutter points before and after a filter, without invalid and ignored points.

    Rates are None if there is nothing to count. Precision and recall refer to the *removal of clutter*, as in papers on
    snow and spray.
    """

    target_in: int = 0
    target_out: int = 0
    clutter_in: int = 0
    clutter_out: int = 0

    def __add__(self, other: "PointCounts") -> "PointCounts":
        return PointCounts(*map(add, astuple(self), astuple(other)))

    @property
    def clutter_removal(self) -> float | None:
        """Share of the clutter points that were removed; also the recall."""
        return _ratio(self.clutter_in - self.clutter_out, self.clutter_in)

    @property
    def target_loss(self) -> float | None:
        """Share of the target points that were removed."""
        return _ratio(self.target_in - self.target_out, self.target_in)

    @property
    def precision(self) -> float | None:
        """Share of clutter among the removed points."""
        clutter = self.clutter_in - self.clutter_out
        return _ratio(clutter, clutter + self.target_in - self.target_out)

    @property
    def f1(self) -> float | None:
        """Harmonic mean of precision and recall; None without clutter."""
        clutter = self.clutter_in - self.clutter_out
        return _ratio(2 * clutter, self.clutter_in and clutter + self.target_in - self.target_out + self.clutter_in)

    @property
    def clutter_share(self) -> float | None:
        """Share of clutter among the remaining points, R_c ([Li2023], Table 3)."""
        return _ratio(self.clutter_out, self.clutter_out + self.target_out)


@dataclass(frozen=True)
class FrameScore:
    """Score of a method in one frame: points before and after it, clusters, and what labels tell, None without them.

    Clusters are those of the kept points, ``unclustered`` the valid kept points in none.
    """

    points_in: int
    points_out: int
    clusters: int
    unclustered: int
    alarms: Alarms | None
    points: PointCounts | None

    def cells(self) -> list[int | str]:
        """Return the values of `ALARM_COLUMNS` and `POINT_COLUMNS`; empty where unknown."""
        known: list[int | str] = [""] * 5
        if one := self.alarms:
            known = [one.targets, one.visible, one.detected, one.missed, one.false_alarms]
        points = [""] * len(POINT_COLUMNS) if self.points is None else astuple(self.points)
        return [*known[:4], self.clusters, known[4], self.points_in, self.points_out, *points]


def score_frame(
    frame: Frame, results: Sequence[FilterResult | None], truth: Truth | None, params: EvaluationParams
) -> list[FrameScore | None]:
    """Return the score of each of several methods in one frame; None for a method that could not process it.

    All valid kept points are clustered, at any range. The truth is None if the frame is not labelled.
    """
    targets = None if truth is None else targets_of(frame, truth, params)
    finder = finder_of(frame, (result.keep for result in results if result is not None), params)

    def score(result: FilterResult) -> FrameScore:
        keep = result.keep & frame.valid
        clusters = finder.clusters(keep, params.min_cluster_points)
        return FrameScore(
            points_in=frame.size,
            points_out=int(result.counts[Reason.KEPT]),
            clusters=int(clusters.max(initial=-1)) + 1,
            unclustered=int(np.count_nonzero(keep & (clusters < 0))),
            alarms=None if targets is None else match(clusters, targets, params),
            points=None if truth is None else _points(result, truth),
        )

    return [None if result is None else score(result) for result in results]


def ideal(frame: Frame, truth: Truth, params: EvaluationParams) -> FilterResult:
    """Return the result of `IDEAL` for a frame."""
    points = point_truth(frame, truth, params)
    kept = frame.valid & (points != CLUTTER) & (points != IGNORED)
    return FilterResult(frame, np.where(kept, Reason.KEPT, Reason.OUTLIER).astype(np.uint8))


def _points(result: FilterResult, truth: Truth) -> PointCounts | None:
    if truth.points is None:
        return None
    clutter = (truth.points == CLUTTER) & result.frame.valid
    target = (truth.points != CLUTTER) & (truth.points != IGNORED) & result.frame.valid
    masks = (target, target & result.keep, clutter, clutter & result.keep)
    return PointCounts(*(int(np.count_nonzero(mask)) for mask in masks))


@dataclass
class Summary:
    """Sums over the frames of one method, in constant memory.

    Rates over frames refer to all labelled frames, as in Table 4 of [Li2023]: 13 of 196 is 6.63 %. Over objects, a
    detected target is a true positive, a false alarm a false positive and a missed target a false negative. Rates are
    None if there is nothing to count: those of false alarms without labelled frames, those of missed targets without
    visible targets.

    Parameters
    ----------
    frames, unlabelled : int
        Labelled frames, to which all other counts refer, and unlabelled frames.
    n_fp, n_fn : int
        Frames with a false alarm, and frames with a missed target.
    targets, visible, detected, false_alarms, clusters, unclustered : int
        Sums of the counts of the frames.
    points : PointCounts or None
        Sums over the frames with labelled points; None without such frames.
    durations : Counter of int
        Processing times of the filter, including unlabelled frames: bins of 1 %, from 0.1 µs to half an hour.
    """

    frames: int = 0
    unlabelled: int = 0
    n_fp: int = 0
    n_fn: int = 0
    targets: int = 0
    visible: int = 0
    detected: int = 0
    false_alarms: int = 0
    clusters: int = 0
    unclustered: int = 0
    points: PointCounts | None = None
    durations: Counter[int] = field(default_factory=Counter)

    def add(self, frame: FrameScore, seconds: float | None) -> None:
        """Add a frame and the processing time of the filter in seconds; None if it is unknown."""
        if seconds is not None:
            number = math.log(max(seconds, _MIN_S) / _MIN_S) / math.log(_STEP)
            self.durations[min(int(number), _BINS - 1)] += 1
        if frame.points is not None:
            self.points = frame.points + (self.points or PointCounts())
        if frame.alarms is None:
            self.unlabelled += 1
            return
        self.frames += 1
        self.n_fp += frame.alarms.false_alarms > 0
        self.n_fn += frame.alarms.missed > 0
        self.unclustered += frame.unclustered
        for item in fields(frame.alarms):
            setattr(self, item.name, getattr(self, item.name) + getattr(frame.alarms, item.name))

    def update(self, other: "Summary") -> None:
        """Add the frames of another recording."""
        self.durations.update(other.durations)
        if other.points is not None:
            self.points = other.points + (self.points or PointCounts())
        for item in fields(self)[:-2]:
            setattr(self, item.name, getattr(self, item.name) + getattr(other, item.name))

    @property
    def missed(self) -> int:
        """Number of missed targets."""
        return self.visible - self.detected

    @property
    def r_fp(self) -> float | None:
        """Share of frames with a false alarm."""
        return _ratio(self.n_fp, self.frames)

    @property
    def r_fn(self) -> float | None:
        """Share of frames with a missed target; None without visible targets."""
        return _ratio(self.n_fn, self.visible and self.frames)

    @property
    def precision(self) -> float | None:
        """Share of detected targets among all alarms."""
        return _ratio(self.detected, self.detected + self.false_alarms)

    @property
    def recall(self) -> float | None:
        """Share of visible targets that were detected."""
        return _ratio(self.detected, self.visible)

    @property
    def f1(self) -> float | None:
        """Harmonic mean of precision and recall; None without visible targets."""
        return _ratio(2 * self.detected, self.visible and self.detected + self.false_alarms + self.visible)

    @property
    def false_alarms_per_frame(self) -> float | None:
        """Mean number of false alarms per frame."""
        return _ratio(self.false_alarms, self.frames)

    @property
    def unclustered_per_frame(self) -> float | None:
        """Mean number of kept points in no cluster per frame."""
        return _ratio(self.unclustered, self.frames)

    def milliseconds(self, share: float) -> float | None:
        """Return a quantile of the filter's processing time per frame in milliseconds, accurate to 1 %."""
        rank, below = max(1, math.ceil(share * self.durations.total() - 1e-9)), 0
        for number, count in sorted(self.durations.items()):
            below += count
            if below >= rank:
                return float(1000 * _MIN_S * _STEP ** (number + 0.5))
        return None

    def as_dict(self, *, timed: bool = True) -> dict[str, Any]:
        """Return all scores by their JSON keys; rates are shares from 0 to 1. Times differ from run to run."""
        points: dict[str, Any] = {}
        if found := self.points:
            points = {
                **dict(zip(POINT_COLUMNS, astuple(found), strict=True)),
                "clutter_removal": found.clutter_removal,
                "target_loss": found.target_loss,
                "point_precision": found.precision,
                "point_recall": found.clutter_removal,
                "point_f1": found.f1,
                "R_c": found.clutter_share,
            }
        milliseconds = {name: self.milliseconds(share) for name, share in (("median", 0.5), ("p99", 0.99))}
        times = {name: ms and round(ms, 4) for name, ms in milliseconds.items()}
        return {
            "frames": self.frames,
            "unlabelled_frames": self.unlabelled,
            "N_FP": self.n_fp,
            "N_FN": self.n_fn,
            "R_FP": self.r_fp,
            "R_FN": self.r_fn,
            "targets": self.targets,
            "not_visible": self.targets - self.visible,
            "detected": self.detected,
            "omitted_alarms": self.missed,
            "false_alarms": self.false_alarms,
            "precision": self.precision,
            "recall": self.recall,
            "f1": self.f1,
            "false_alarms_per_frame": self.false_alarms_per_frame,
            "clusters_per_frame": _ratio(self.clusters, self.frames),
            "unclustered_points_per_frame": self.unclustered_per_frame,
            **points,
            **({"filter_ms": times} if timed else {}),
        }


def _ratio(part: float, whole: float) -> float | None:
    return part / whole if whole else None


def best(summaries: Mapping[K, Summary]) -> K | None:
    """Return the name of the best summary; None without labelled frames.

    The best summary has the lowest rate of frames with a false alarm plus frames with a missed target
    (:math:`N_{FP} + N_{FN}`). Ties are resolved by the rate of false alarms plus missed targets, then by order.
    """
    # Rates, since a method may be unable to process some frames.
    known = [(name, one) for name, one in summaries.items() if one.frames]
    errors = [((one.n_fp + one.n_fn) / one.frames, (one.false_alarms + one.missed) / one.frames) for _, one in known]
    return known[errors.index(min(errors))][0] if known else None


def ideal_threshold(intensity: Floats, points: Ints) -> float | None:
    """Return the intensity threshold that best separates clutter from targets in one range ring.

    It is the lowest target intensity T that maximises the sum of the share of clutter below T and the share of target
    points at or above T, which is Youden's index plus one; None without clutter or without target points. [Li2023]
    marks it by hand (Fig. 7). The labels of the points are those of `Truth.points`; both arrays have shape (N,).
    """
    clutter = np.sort(intensity[points == CLUTTER])
    target = np.sort(intensity[(points != CLUTTER) & (points != IGNORED)])
    if not len(clutter) or not len(target):
        return None
    # A higher threshold loses a target point only above its intensity, so target intensities are the candidates.
    thresholds = np.unique(target)
    below = np.searchsorted(clutter, thresholds, side="left") / len(clutter)
    kept = 1 - np.searchsorted(target, thresholds, side="left") / len(target)
    return float(thresholds[np.argmax(np.round(below + kept, 12))])


class Parts:
    """Scores of several methods in consecutive parts of a recording, in bounded memory, to hold out its end.

    All parts but the last have the same number of labelled frames: one, until there are 64 parts; then every two parts
    are joined.
    """

    def __init__(self, methods: int) -> None:
        self._methods = methods
        self._parts: list[list[Summary]] = []
        self._part_frames, self._frames_in_last = 1, 1

    def add(self, scores: Sequence[FrameScore | None]) -> None:
        """Add a labelled frame: the score of each method, None for a method that could not use it."""
        if self._frames_in_last == self._part_frames:
            if len(self._parts) == _MAX_PARTS:
                self._parts = [self._sums(self._parts[k : k + 2]) for k in range(0, _MAX_PARTS, 2)]
                self._part_frames *= 2
            self._parts.append(self._sums([]))
            self._frames_in_last = 0
        self._frames_in_last += 1
        for summary, score in zip(self._parts[-1], scores, strict=True):
            if score is not None:
                summary.add(score, None)

    def split(self, share: float) -> tuple[list[Summary], list[Summary]]:
        """Return the sums of the frames before the end, and of a share of the frames at the end, for each method.

        With a share between 0 and 1, both sums have a frame if there are two.
        """
        end = round(share * len(self._parts))
        if 0 < share < 1:
            end = min(max(end, 1), len(self._parts) - 1)
        first = len(self._parts) - end
        return self._sums(self._parts[:first]), self._sums(self._parts[first:])

    def _sums(self, parts: Sequence[Sequence[Summary]]) -> list[Summary]:
        sums = [Summary() for _ in range(self._methods)]
        for part in parts:
            for total, summary in zip(sums, part, strict=True):
                total.update(summary)
        return sums
