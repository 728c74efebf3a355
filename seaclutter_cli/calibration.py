"""Thresholds and far limit from recordings that contain clutter ([Li2023], section 4.1).

One pass in constant memory: a histogram for each range ring, and the extent of the clutter in bins of half a metre.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from decimal import ROUND_CEILING, Context
from itertools import pairwise
from typing import Any, Self

import numpy as np

from seaclutter_cli.arrays import Floats, Indices
from seaclutter_cli.errors import InputError
from seaclutter_cli.filters.histogram import IntensityHistogram
from seaclutter_cli.filters.joint import RingIntensityParams
from seaclutter_cli.filters.zones import MAX_RINGS, Zones
from seaclutter_cli.frame import Frame
from seaclutter_cli.interfaces import Labels
from seaclutter_cli.truth import CLUTTER

GAP_M = 1.0
MAX_RANGE_M = 10_000.0
_BIN_M = 0.5
_FEW_POINTS = 100
_FEW_ABOVE = 20


class FarLimit:
    """Search for the first range past which all consecutive sorted ranges differ by more than 1 m.

    This is the rule of [Li2023], which finds 61.65 m. Gaps at shorter ranges, as between the circles that the beams of
    a lidar draw on a calm sea, do not count.

    Each bin of half a metre keeps only its count, minimum and maximum. The result is exact: two ranges in a bin differ
    by less than a metre, so a gap can only be next to the minimum or maximum. Ranges of 10 km or more are left out.
    """

    def __init__(self) -> None:
        bins = math.ceil(MAX_RANGE_M / _BIN_M)
        self._counts = np.zeros(bins, np.int64)
        self._least, self._most = np.full(bins, np.inf), np.full(bins, -np.inf)

    def add(self, range_m: Floats) -> None:
        """Add ranges in metres, shape (N,)."""
        near = range_m[range_m < MAX_RANGE_M]
        bin_index = (near / _BIN_M).astype(np.intp)
        np.add.at(self._counts, bin_index, 1)
        np.minimum.at(self._least, bin_index, near)
        np.maximum.at(self._most, bin_index, near)

    def __iadd__(self, other: Self) -> Self:
        self._counts += other._counts
        np.minimum(self._least, other._least, out=self._least)
        np.maximum(self._most, other._most, out=self._most)
        return self

    @property
    def last_m(self) -> float | None:
        """The range found, in metres; None without ranges."""
        occupied = np.flatnonzero(self._counts)
        if not len(occupied):
            return None
        least, most = self._least[occupied], self._most[occupied]
        joined = np.append(False, least[1:] - most[:-1] <= GAP_M)
        # The last range in each bin that has a predecessor at most a metre before it.
        close = np.where(self._counts[occupied] > 1, most, np.where(joined, least, least[0]))
        return float(close.max())


@dataclass(frozen=True)
class RingCalibration:
    """The initial threshold, :math:`I_0`, of one range ring from ``start_m`` to before ``end_m``.

    ``below`` is the number of its clutter points whose intensity is below the threshold. If these are too ``few``
    for a threshold of its own, ``source`` has the numbers, from 1, of the first and last range ring whose points
    determine it. If more points than may be left have the highest intensity, it is ``saturated`` there.
    """

    start_m: float
    end_m: float
    points: int
    threshold: float
    below: int
    few: bool = False
    source: tuple[int, int] = (1, 1)
    saturated: bool = False

    @property
    def filter_rate(self) -> float | None:
        """Share of the clutter points below the threshold; None without points."""
        return self.below / self.points if self.points else None


@dataclass(frozen=True)
class Thresholds:
    """The range rings from ``start_m`` to the far limit, :math:`d_e`, which is ``end_m``.

    Past ``last_m``, all consecutive clutter ranges differ by more than 1 m. ``beyond`` is the number of clutter points
    at ``end_m`` or farther.
    """

    rings: tuple[RingCalibration, ...]
    end_m: float
    last_m: float | None
    beyond: int

    @property
    def start_m(self) -> float:
        """Where the first range ring begins, in metres."""
        return self.rings[0].start_m

    @property
    def initial_thresholds(self) -> tuple[float, ...]:
        """Threshold of each range ring; whole numbers are integers."""
        values = (ring.threshold for ring in self.rings)
        return tuple(int(value) if value.is_integer() and abs(value) < 2**53 else value for value in values)

    def applied_to(self, params: Any) -> Any:
        """Return the parameters of a method with the thresholds and the far limit."""
        return replace(params, end_m=self.end_m, initial_thresholds=self.initial_thresholds)


class Calibration:
    """Clutter points of several recordings, from which thresholds are derived.

    A histogram is created when the first point appears in a range ring, for at most 250 range rings and up to 10 km.
    A histogram takes at most 5 MB.

    ``filter_rate`` is the share of the clutter points of each range ring to remove. Where more than ``max_left`` points
    per frame would be left, it is higher. With ``keep_end``, ``params.end_m`` is not derived.
    """

    def __init__(
        self, params: RingIntensityParams, *, filter_rate: float, max_left: float | None = None, keep_end: bool = False
    ) -> None:
        params = replace(params, start_m=params.own_ship_m)  # range rings begin at one range
        self.params, self.filter_rate, self.max_left, self.keep_end = params, filter_rate, max_left, keep_end
        self.frames = 0
        count = max(1, min(MAX_RINGS, math.ceil((MAX_RANGE_M - params.own_ship_m) / params.ring_width_m)))
        whole_rings = np.asarray(params.own_ship_m + np.arange(count + 1) * params.ring_width_m, np.float64)
        self._edges: Floats = params.edges if keep_end else whole_rings
        self._limit = FarLimit()
        self._rings: dict[int, IntensityHistogram] = {}
        self.points = 0
        self.intensity = [math.inf, -math.inf]
        """Minimum and maximum intensity of all clutter points."""
        self.highest = -math.inf
        """Maximum intensity of all points, which no threshold exceeds unless the filter rate is 1."""

    def add(self, range_m: Floats, intensity: Floats) -> None:
        """Add clutter points at ``start_m`` or beyond: ranges in metres and intensities, both of shape (N,)."""
        self.points += len(range_m)
        least, most = self.intensity
        self.intensity = [float(intensity.min(initial=least)), float(intensity.max(initial=most))]
        self.highest = max(self.highest, self.intensity[1])
        self._limit.add(range_m)
        ring = np.searchsorted(self._edges, range_m, side="right") - 1
        for number in np.unique(ring[ring < len(self._edges) - 1]).tolist():
            self._rings.setdefault(number, IntensityHistogram()).add(intensity[ring == number])

    def __iadd__(self, other: Self) -> Self:
        """Add the clutter points of another calibration with the same parameters, which must not be used afterwards.

        The result is exact if the histograms are; beyond that, it depends on the order.
        """
        self.points += other.points
        self.intensity = [min(self.intensity[0], other.intensity[0]), max(self.intensity[1], other.intensity[1])]
        self.highest = max(self.highest, other.highest)
        self.frames += other.frames
        self._limit += other._limit
        for number, histogram in other._rings.items():
            if (own := self._rings.setdefault(number, histogram)) is not histogram:
                own += histogram
        return self

    def see(self, intensity: Floats) -> None:
        """Note the intensities of all valid points of a frame, shape (N,), clutter or not; call it for each frame."""
        self.frames += 1
        self.highest = float(intensity.max(initial=self.highest))

    def thresholds(self) -> Thresholds:
        """Return the thresholds and the far limit of the points added so far; depends on attributes set meanwhile.

        Raise `InputError` if there are no points, or if they are farther than the maximum number of range rings.
        """
        last_m = self._limit.last_m
        edges = self._edges if self.keep_end else self._up_to(last_m)
        count = len(edges) - 1
        if not any(number < count for number in self._rings):
            span = f"between {edges[0]:g} and {edges[-1]:g} m" if self.keep_end else f"from {edges[0]:g} m on"
            raise InputError(f"no clutter point {span}; thresholds need recordings with clutter there")
        points = [self._rings[number].points if number in self._rings else 0 for number in range(count)]
        sources = _ring_sources(points, few_points(self.filter_rate))
        rings = tuple(self._ring(number, edges, sources[number]) for number in range(count))
        return Thresholds(rings, float(edges[-1]), last_m, self.points - sum(ring.points for ring in rings))

    def _up_to(self, last_m: float | None) -> Floats:
        start_m, width_m = self.params.own_ship_m, self.params.ring_width_m
        count = max(1, math.ceil((last_m - start_m) / width_m - 1e-9)) if last_m is not None else 1
        if count >= len(self._edges):
            raise InputError(
                f"clutter reaches {last_m:.2f} m, but {len(self._edges) - 1} range rings of {width_m:g} m only reach "
                f"{self._edges[-1]:g} m; increase ring_width_m or keep end_m"
            )
        return np.append(self._edges[:count], round(float(self._edges[count]), 9))

    def _ring(self, number: int, edges: Floats, source: range) -> RingCalibration:
        """Return the calibration of a range ring from the points of those in ``source``."""
        histogram, rate = IntensityHistogram(), self.filter_rate
        for one in filter(self._rings.__contains__, source):
            histogram += self._rings[one]
        if self.max_left is not None:
            left = max(self.max_left * self.frames, _FEW_ABOVE)
            rate = max(rate, 1 - left / histogram.points)
        threshold = self._threshold(histogram, rate)
        if saturated := self.filter_rate < 1 and threshold > self.highest:
            threshold = self.highest
        values, counts = self._rings[number].distribution() if number in self._rings else (np.zeros(0), np.zeros(0))
        points, below = int(counts.sum()), int(counts[values < threshold].sum())
        few = points < few_points(self.filter_rate)
        span = float(edges[number]), float(edges[number + 1])
        return RingCalibration(*span, points, threshold, below, few, (source[0] + 1, source[-1] + 1), saturated)

    def _threshold(self, histogram: IntensityHistogram, filter_rate: float) -> float:
        whole = all(ring.all_whole for ring in self._rings.values())
        threshold = histogram.threshold(filter_rate, whole=whole)
        values, _ = histogram.distribution()
        return threshold if whole else _shortened(threshold, float(values[values >= threshold].min(initial=math.inf)))


def _ring_sources(points: Sequence[int], enough: int) -> list[range]:
    """Return the range rings whose points determine the threshold of each one.

    Neighbours with few points are pooled, from the lidar outwards, until they have enough. If they do not, they take
    the threshold of the nearest range ring with enough, rather towards the lidar.

    Examples
    --------
    >>> _ring_sources([900, 60, 40, 12, 500], 100)
    [range(0, 1), range(1, 3), range(1, 3), range(1, 3), range(4, 5)]
    >>> _ring_sources([900, 60, 0], 100), _ring_sources([8, 900], 100), _ring_sources([8, 9], 100)
    ([range(0, 1), range(0, 1), range(0, 1)], [range(1, 2), range(1, 2)], [range(0, 2), range(0, 2)])
    """
    starts = [0]
    for number, one in enumerate(points):
        if number > starts[-1] and (one >= enough or sum(points[starts[-1] : number]) >= enough):
            starts.append(number)
    groups = [range(*bounds) for bounds in pairwise((*starts, len(points)))]
    filled = [sum(points[number] for number in group) >= enough for group in groups]
    if not any(filled):
        return [range(len(points))] * len(points)
    sources: list[range] = []
    for index, group in enumerate(groups):
        nearest = index if filled[index] else index - 1 if index else 1
        sources += [groups[nearest]] * len(group)
    return sources


def few_points(filter_rate: float) -> int:
    r"""Return the number of points that a range ring needs for a reliable threshold.

    The share that a threshold removes in other recordings has a standard deviation of :math:`\sqrt{p (1 - p) / n}`:
    4 % for 100 points and p = 0.8. With fewer than 20 points above or below the threshold, a few bright points of one
    wave determine it.

    Examples
    --------
    >>> few_points(0.8), few_points(0.95)
    (100, 400)
    """
    rare = min(filter_rate, 1 - filter_rate)
    return max(_FEW_POINTS, math.ceil(_FEW_ABOVE / rare - 1e-9)) if rare > 0 else _FEW_POINTS


def _shortened(threshold: float, limit: float) -> float:
    """Return the shortest decimal from a threshold to a limit, both inclusive; it separates the same points.

    Examples
    --------
    >>> _shortened(0.11764706671237946, 0.12156862)
    0.118
    """
    for digits in range(3, 18):
        short = float(Context(prec=digits, rounding=ROUND_CEILING).create_decimal(threshold))
        if threshold <= short <= limit:
            return short
    return threshold


class ClutterSelector:
    """Selection of the clutter points of one recording.

    Clutter is every valid point at ``start_m`` or beyond outside the excluded boxes. With labels, frames without them
    are left out, and points in boxes of targets and ignored areas, inflated by a margin on every side, and points
    labelled as such, are not clutter either.
    """

    def __init__(self, params: RingIntensityParams, labels: Labels | None = None, margin_m: float = 0.0) -> None:
        self._zones = Zones(replace(params, start_m=params.own_ship_m))
        self._labels, self._margin_m = labels, margin_m
        self.frames = self.unlabelled = self.marked = 0
        """Frames used; frames left out because they have no labels; points left out because of their labels."""

    def clutter(self, frame: Frame) -> Indices:
        """Return the indices of the clutter points of a frame; empty if labels exist but not for this frame.

        Raise `FieldError` if the frame has no intensities.
        """
        _ = frame.intensity
        truth = self._labels.truth(frame) if self._labels else None
        if self._labels and truth is None:
            self.unlabelled += 1
            return np.empty(0, np.intp)
        self.frames += 1
        zone, _ = self._zones.divide(frame)
        clutter = np.flatnonzero((zone >= 1) & (zone <= self._zones.count + 1))  # range rings and beyond
        if truth is not None:
            positions = frame.coordinates[:, clutter]
            marked = truth.ignored.covers(positions, self._margin_m)
            if truth.targets is not None:
                marked |= truth.targets.covers(positions, self._margin_m)
            if truth.points is not None:
                marked |= truth.points[clutter] != CLUTTER
            self.marked += int(np.count_nonzero(marked))
            clutter = clutter[~marked]
        return clutter
