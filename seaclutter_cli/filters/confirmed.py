"""Confirmed objects: what rises out of the water and stays."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Bytes, Indices
from seaclutter_cli.errors import FieldError
from seaclutter_cli.filters.confirmation import ConfirmedParams
from seaclutter_cli.filters.confirmation.echoes import Echoes, Heights, Sea, repeated
from seaclutter_cli.filters.confirmation.evidence import OF_VOLUME
from seaclutter_cli.filters.confirmation.objects import DetectedObject, find_objects
from seaclutter_cli.filters.confirmation.tracks import Track, Tracker
from seaclutter_cli.filters.zones import Zones
from seaclutter_cli.frame import FilterResult, Frame, Reason, WaterState
from seaclutter_cli.interfaces import Filter
from seaclutter_cli.neighbors import nearest
from seaclutter_cli.structure.search import MIN_FRAMES
from seaclutter_cli.water.plane import NEAREST_M

_GROWTH_RATIO = 0.01
_SURE = 1.5
"""Score above which most objects are targets; from 0 to this, about as many are as are not."""
_MAX_GAP_S, _MAX_STEP_BACK_S = 5.0, 0.1
_SLACK_S = 1e-6
_MAX_WAITING = 3 << 19


@dataclass(frozen=True, eq=False)
class _Undecided:
    """A frame whose objects wait for the evidence of later frames.

    ``grows`` are the indices of the points of the frame that may return, ``awaited`` probable targets that it does not
    show, with the points where they may be; objects refer to points of the frame as well.
    """

    frame: Frame
    time_s: float
    zone: Bytes
    reason: Bytes
    grows: NDArray[np.int32]
    objects: Sequence[DetectedObject]
    tracks: Sequence[Track]
    awaited: Sequence[tuple[Track, NDArray[np.int32]]]
    repeats: tuple[Indices, Indices]
    water: WaterState | None


class Confirmed(Filter):
    r"""Confirmed objects: what rises out of the water and stays.

    Notes
    -----
    For each frame, in order, in the levelled frame of the mounting:

    1. *Water*: the surface and its deviation :math:`\sigma`, from the echoes of the water itself (`WaterTracker`).
    2. *Band*: points higher above the water than :math:`\max(0.2\,\mathrm{m}, 4\sigma)` stand out.
    3. *Candidates*: points in faces, which are echoes above each other in one direction at nearly one range (`Faces`);
       points that stand out; bright ones in the band, which reach their thresholds or four times the mean intensity of
       the water at their range; all where the water has no echoes; and rows of eight or more that are longer than the
       water's at their range. Where much water is bright, only the brightest at each range are candidates, as many as
       do not join.
    4. *Objects*: Euclidean clusters, in which the echoes of neighbouring beams stay together. What is beside no face is
       an object of its own, so that wash does not belong to the hull before it, and bright water joins only what it is
       near. The evidence of a frame is the logarithm of the odds that an object is a target: the sum of one curve for
       each of ten features (`FEATURES`), learned from logs of four simulators; without intensities, of eight.
    5. *Confirmation*: objects are followed over time, in a frame that turns with own ship: the turn is the angle that
       most tracks have in common, by their evidence. Two more curves count in the evidence of a frame: how far an
       object is from where it was expected, since crests and foam have no steady course, and how many objects like it
       appeared in a second (`Arrivals`). The score of a track is the evidence that it collected before, that within
       ``look_ahead_s`` after the frame, and 0.35 times that of the frame, less 1. As in the track score of Sittler
       [1]_, independent looks add up, one in the time in which the water becomes independent of what it was, about a
       second. Evidence is forgotten over ``memory_s`` and lies between -1 and 3. That an object was not there before
       counts as evidence against it, so what is soon gone is not kept. Without later frames, as with ``causal``,
       evidence is at least -0.35. An object is missed only where a beam would have met it. One that fills a volume in a
       frame, such as spray, rain and fog, of which few neighbours lie on one surface, is not kept in it.
    6. *Growth*: points near a confirmed object return to it, so that hulls keep their shape: those above the water,
       and all where the water has no echoes. If a frame does not show the object, but a later one does, so do rows of
       echoes where it is expected.

    The result of a frame is complete ``look_ahead_s`` later, at once with ``causal``, and earlier where more than 1.5
    million points would wait.

    Within own ship, which ends at ``start_m`` or, with auto, where constant returns end (`OwnShip`), only objects are
    kept that were confirmed outside. The first 20 frames wait until they show where that is. At rest, a quay is as
    constant, and belongs to own ship until the vessel moves. More than 1.5 million points do not wait, nor any with
    ``causal``: it is 10 m then. What is constant is no water.

    **State**: own ship, the water and its echoes, the elevations of the beams, the tracks, and the frames that wait.

    References
    ----------
    .. [1] Sittler (1964). "An optimal data association problem in surveillance theory". IEEE Transactions on Military
       Electronics 8(2).
    """

    Params: ClassVar[type[ConfirmedParams]] = ConfirmedParams
    has_water = True
    needs_height = True
    uses_attitude = True

    def __init__(self, params: ConfirmedParams) -> None:
        self._params, self._zones = params, Zones(params, finds_water=False)
        self._thresholds = np.asarray(params.initial_thresholds, np.float64)
        self.reset()

    @property
    def look_ahead_s(self) -> float:  # type: ignore[override] # constant in the base
        """Time after a frame on which its result depends, in seconds: longer while own ship is searched."""
        if self._is_beginning and self._zones.own_ship:
            return _MAX_GAP_S
        return 0.0 if self._params.causal else self._params.look_ahead_s

    @property
    def warnings(self) -> Sequence[str]:  # type: ignore[override] # constant in the base
        """A warning if own ship's attitude in the log does not agree with the water."""
        return self._sea.water.trial.warnings

    def reset(self) -> None:
        """Forget own ship, the water, the beams, the tracks and the frames that wait."""
        self._zones.reset()
        self._sea, self._tracker = Sea(self._params), Tracker(self._params)
        self._first: deque[Frame] = deque()
        self._is_beginning = not self._params.causal
        self._undecided: deque[_Undecided] = deque()
        self._time_s: float | None = None
        self._origin_ns: int | None = None

    def process(self, frame: Frame) -> list[FilterResult]:
        """Receive the next frame and return the results that are complete."""
        _ = frame.valid  # errors come before any change
        try:
            _ = self._params.use_intensity and frame.intensity
        except FieldError as error:
            raise FieldError(f"{error}, or filter without: -s filter.use_intensity=false") from error
        self._first.append(frame)
        if self._is_beginning and self._zones.own_ship:
            self._zones.own_ship.add(frame)
            frame.release()
            waiting = sum(one.size for one in self._first)
            if len(self._first) < MIN_FRAMES and waiting + frame.size <= _MAX_WAITING:
                return []
        return self._receive_first()

    def _receive_first(self) -> list[FilterResult]:
        """Return the results that are complete after the frames that waited until they showed where own ship ends."""
        own_ship, complete = self._zones.own_ship, []
        if self._is_beginning and self._first and own_ship and not own_ship.is_known:
            own_ship.reset()  # it sees these frames again
        self._is_beginning = False
        while self._first:
            complete += self._receive(self._first.popleft())
        return complete

    def _receive(self, frame: Frame) -> list[FilterResult]:
        """Receive a frame and return the results that are complete."""
        if self._origin_ns is None:  # times from there on are exact to a nanosecond
            self._origin_ns = frame.stamp_ns
        time_s, last_s, complete = (frame.stamp_ns - self._origin_ns) / 1e9, self._time_s, []
        if last_s is not None and 0 < last_s - time_s <= _MAX_STEP_BACK_S:
            time_s = last_s
        if last_s is not None and not 0 <= time_s - last_s <= _MAX_GAP_S:
            complete = self._decided(math.inf)
            self._tracker = Tracker(self._params)
        self._undecided.append(self._examine(frame, time_s))
        self._time_s = time_s
        return complete + self._decided(time_s - self.look_ahead_s + _SLACK_S)

    def flush(self) -> list[FilterResult]:
        """Return the results of all frames that wait."""
        return [*self._receive_first(), *self._decided(math.inf)]

    def _decided(self, until_s: float) -> list[FilterResult]:
        """Return the results of the frames up to a time, and of more if too many points wait for later frames."""
        complete, waiting = [], sum(one.frame.size for one in self._undecided)
        while self._undecided:
            first, too_many = self._undecided[0], len(self._undecided) > 1 and waiting > _MAX_WAITING
            if first.time_s > until_s and not too_many:
                break
            waiting -= first.frame.size
            complete.append(self._decide(self._undecided.popleft()))
        return complete

    def step(self, frame: Frame) -> FilterResult:
        """Return the reason of every point of a frame, without later frames."""
        return [*self.process(frame), *self.flush()][-1]

    def _examine(self, frame: Frame, time_s: float) -> _Undecided:
        """Find the objects of a frame and their tracks (steps 1 to 5)."""
        zone, reason = self._zones.divide(frame)
        repeats = repeated(frame)
        seen = reason.copy() if len(repeats[0]) else reason
        seen[repeats[0]] = Reason.INVALID
        echoes = Echoes.of(frame, zone, seen, self._params)
        own, own_ship = np.zeros(echoes.size, np.bool_), self._zones.own_ship
        if own_ship:
            used = np.flatnonzero((echoes.range_m >= NEAREST_M) & (echoes.range_m < own_ship.reach_m))
            own[used] = own_ship.is_structure(frame, echoes.index[used])
        frame.release()
        # 1. Water, 2. Band
        attitude = frame.attitude and frame.attitude.of_axes(self._params.mounting.rotation)
        threshold = self._zones.per_point(self._thresholds, echoes.zone)
        threshold[echoes.is_near] = self._thresholds[0]
        heights = self._sea.measure(echoes, threshold, time_s, attitude, own)
        if own_ship:
            own_ship.see(frame, heights.water, echoes.index[heights.upright])
        # 3. Candidates
        candidates = heights.upright | heights.high | heights.bright | heights.isolated
        # 4. Objects
        near = echoes.is_near
        objects = find_objects(self._sea, echoes, candidates & ~near, heights, near=False)
        if self._tracker.approached(self._params.own_ship_m, time_s):  # all else there is own ship
            objects += find_objects(self._sea, echoes, candidates & near, heights, near=True)
            objects.sort(key=lambda one: tuple(one.center))
        # 5. Confirmation: evidence is collected now and judged when the later frames are known.
        since_s = self._undecided[0].time_s if self._undecided else time_s
        meets = partial(self._sea.beams.meet, heights.water) if heights.water else None  # or everything is in sight
        tracks = self._tracker.step(objects, time_s, since_s, meets)
        reason[echoes.index] = self._reasons(reason[echoes.index], echoes, heights, objects)
        index = echoes.index.astype(np.int32)  # less to hold
        least = self._params.min_cluster_points
        in_rows = (heights.run >= least) & (heights.height_m > -heights.rise_m)
        rows = np.flatnonzero(in_rows & ~candidates & ~near)
        expected = self._tracker.awaited(echoes.xyz[:2].take(rows, axis=1), time_s)
        awaited = [(track, index[rows[points]]) for track, points in expected if len(points) >= least]
        state = heights.water.state if heights.water else None
        objects = [replace(one, points=index[one.points]) for one in objects]
        grows = index[heights.grows & ~near]
        return _Undecided(frame, time_s, zone, reason, grows, objects, tracks, awaited, repeats, state)

    def _reasons(self, by_zone: Bytes, echoes: Echoes, heights: Heights, objects: Sequence[DetectedObject]) -> Bytes:
        """Return the reasons of the echoes if no object is confirmed; near ones keep the reasons of their zone."""
        low = Reason.LOW_INTENSITY if self._params.use_intensity else Reason.UNCONFIRMED
        reason = np.where(heights.low & ~heights.high, np.uint8(low), np.uint8(Reason.OUTLIER))
        reason[heights.mirrored] = Reason.MIRRORED
        for one in objects:
            reason[one.points] = Reason.UNCONFIRMED
        return np.where(echoes.is_near, by_zone, reason)

    def _decide(self, one: _Undecided) -> FilterResult:
        """Confirm the objects of a frame and let them grow (steps 5 and 6)."""
        reason = one.reason
        confirmed: list[NDArray[np.integer]] = [np.empty(0, np.int32)]
        undecided = np.zeros((2, 2), np.int64)
        for found, track in zip(one.objects, one.tracks, strict=True):
            score = self._tracker.score(track, one.time_s)
            is_kept = score > self._params.score_threshold and found.evidence > OF_VOLUME
            if 0 < score <= _SURE:
                undecided[int(is_kept)] += 1, len(found.points)
            if not is_kept:
                continue
            track.from_outside |= not found.near or (track.part_of is not None and track.part_of.from_outside)
            if track.from_outside:
                confirmed.append(found.points)
        for track, points in one.awaited:
            is_back = track.seen_s > one.time_s and track.from_outside
            if is_back and self._tracker.score(track, one.time_s) > self._params.score_threshold:
                confirmed.append(points)
        kept = np.concatenate(confirmed)
        reason[kept] = Reason.KEPT
        # 6. Growth
        if len(kept):
            reason[self._grown(one, kept)] = Reason.KEPT
        again, first = one.repeats
        reason[again] = reason[first]
        rings = self._zones.rings(one.zone, reason, self._thresholds) if self._params.use_intensity else None
        return FilterResult(one.frame, reason, rings, water=one.water, undecided=undecided)

    def _grown(self, one: _Undecided, kept: NDArray[np.integer]) -> NDArray[np.int32]:
        """Return the points above the water that are near enough to confirmed objects."""
        others: NDArray[np.int32] = one.grows[one.reason[one.grows] != Reason.KEPT]
        if not len(others):
            return others
        limit = self._params.growth_m + _GROWTH_RATIO * one.frame.range_m[others]
        near, far = (self._params.mounting.levelled(one.frame.coordinates_of(points)).T for points in (kept, others))
        _, distance = nearest(near, far)
        return np.asarray(others[distance <= limit])
