"""Checks of the frames of a topic against the configuration, and of the sums over them, as warnings."""

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from seaclutter_cli.arrays import Floats, Mask
from seaclutter_cli.config import Config, SensorParams
from seaclutter_cli.filters.zones import ZoneParams, Zones
from seaclutter_cli.frame import FilterResult, Reason
from seaclutter_cli.interfaces import Source
from seaclutter_cli.messages.pointcloud2 import rewrapped
from seaclutter_cli.pipeline import TopicTally
from seaclutter_cli.records import SensorFacts
from seaclutter_cli.reporting.palette import reason_names
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.topic_statistics import TopicStatistics
from seaclutter_cli.selection import filtered_by
from seaclutter_cli.sensors.catalog import SENSORS
from seaclutter_cli.text import count, share

if TYPE_CHECKING:
    from seaclutter_cli.filters.confirmation import ConfirmedParams
    from seaclutter_cli.runs.surroundings import Surroundings

_NEAR_M, _FARTHEST_M = 1.0, 10_000.0  # a lidar on a vessel measures farther than the one, not than the other
_FRAMES = 20
_MIN_POINTS, _MIN_RING_POINTS = 200, 500
_FASTEST_HZ = 30.0
_UPRIGHT = 8.0  # a lock chamber has 3, and other water less than 1
_REMEDY = "find suitable thresholds with: seaclutter calibrate"
_FEW_WATER = 0.05
_MAX_GAP_NS, _MAX_STEP_BACK_NS = 5_000_000_000, 100_000_000
"""As in the method ``confirmed``."""
_ENOUGH_S = 2.0
_SHOWS_BEAMS = 10
"""Number of the frame that shows sensor and beams."""
_BEGIN, _EVERY = 50, 5
"""Number of the frame from which on surroundings are looked at, and of the frames to one that is."""


class _Check(Protocol):
    """A check of the frames of one topic, which has a warning once enough frames justify it."""

    def add(self, result: FilterResult) -> str | None: ...

    def warning(self) -> str | None: ...


class Checks:
    """Checks of the frames of one topic, given facts about the sensors of the recording, which may grow meanwhile.

    ``filtered`` is whether an earlier run filtered the frames, so that no weak points show whether the thresholds fit.
    """

    def __init__(self, config: Config, facts: Mapping[str, SensorFacts], *, filtered: bool = False) -> None:
        self._config, self._tally = config, TopicTally()
        sensor = config.threshold_sensor
        # Another sensor explains thresholds that do not fit, so the first of these that warns is enough.
        thresholds: list[_Check] = [_SensorCheck(sensor, facts)] if sensor else []
        if not filtered:
            thresholds.append(_ThresholdCheck(config, sensor.model if sensor else None))
        self._waiting: list[list[_Check]] = [thresholds, [_RangeCheck(config.ring_edges)], [_ScanCheck()]]
        if config.kind.needs_height:
            self._waiting.append([_PlaneCheck(config)])
        if config.kind.has_water:
            self._waiting += [[_MountingCheck(config.filter)], [_LandCheck(config.filter)]]

    def add(self, result: FilterResult) -> list[str]:
        """Add a frame; return the warnings that enough frames justify."""
        self._tally.add(result, 0.0)
        return self._warnings(lambda check: check.add(result))

    def finish(self, cause: str = "") -> list[str]:
        """Return the warnings about the frames so far that were not returned; if there are none, about their sums.

        ``cause`` is why objects were not followed for long enough, for the end of a warning.
        """
        return self._warnings(lambda check: check.warning()) or list(self._of_sums(cause))

    def _warnings(self, ask: "Callable[[_Check], str | None]") -> list[str]:
        """Return the first warning of each group of checks, and end the groups that warn."""
        found = []
        for checks in self._waiting:
            if text := next(filter(None, map(ask, checks)), None):
                found.append(text)
                checks.clear()
        return found

    def _of_sums(self, cause: str) -> Iterator[str]:
        tally = self._tally
        most, without = Reason(int(tally.counts.argmax())), tally.frames - tally.water_frames
        if not tally.frames:
            return
        if not tally.points_in:
            yield "all clouds are empty"
        elif not tally.counts[Reason.KEPT]:
            removed = f"{share(int(tally.counts[most]), tally.points_in)} were removed"
            yield f"no points are left; {removed}: {reason_names(self._config.ring_edges)[most]}"
        elif self._config.kind.has_water and tally.water_frames <= _FEW_WATER * tally.frames:
            frames = f"{without:,} of {count(tally.frames, 'frame')}"
            yield f"no water seen in {frames}; heights are then unknown, and every object that stays is kept"
        elif 3 * (undecided := int(tally.undecided[1, 1])) > (kept := int(tally.counts[Reason.KEPT])):
            part = share(undecided, kept)
            yield f"{part} of the points kept are of objects that evidence does not decide{cause}"


class _SensorCheck:
    """Check whether the thresholds are for the sensor of a topic, which its first frames show."""

    def __init__(self, given: SensorParams, facts: Mapping[str, SensorFacts]) -> None:
        self._given, self._facts = given, facts
        self._seen, self._topic = TopicStatistics(), ""

    def add(self, result: FilterResult) -> str | None:
        if self._seen.frames >= _FRAMES:
            return None
        self._topic = result.frame.topic
        self._seen.add(result.frame)
        return self.warning() if self._seen.frames == _FRAMES else None

    def warning(self) -> str | None:
        if not self._seen.frames:
            return None
        given, found = self._given, self._seen.sensor(self._facts.get(self._topic))
        remedy = "find thresholds for it with: seaclutter calibrate"
        if found.is_other_than(given.model):
            seen = f"the log is from {found}" if found.is_stated else f"the log {found}"
            return f"the thresholds are for {given.model}, but {seen}; {remedy}"
        if found.is_other_than(None, given.intensity):
            return (
                f"the thresholds are for intensities of the kind '{given.intensity}', but the log has "
                f"'{found.intensity}'; {remedy}"
            )
        return None


class _ThresholdCheck:
    """Check whether the thresholds of the range rings suit the intensities; a threshold of 30 is useless up to 1."""

    def __init__(self, config: Config, sensor: str | None) -> None:
        self._edges, self._needs_water = np.asarray(config.ring_edges, np.float64), config.kind.has_water
        # What rises out of the water needs no intensity.
        self._passes = "reaches its threshold" if self._needs_water else "can pass"
        top = SENSORS[sensor].max_intensity if sensor and sensor in SENSORS else None
        self._sensor, self._top = sensor, np.inf if top is None else top
        rings = max(0, len(self._edges) - 1)
        self._frames = 0
        self._points, self._low = np.zeros(rings, np.int64), np.zeros(rings, np.int64)
        self._ring_least, self._ring_most = np.full(rings, np.inf), np.full(rings, -np.inf)
        self._least, self._most = np.inf, -np.inf
        self._other: str | None = None

    def add(self, result: FilterResult) -> str | None:
        if self._frames >= _FRAMES or result.rings is None or not result.rings.points.any():
            return None
        if self._needs_water and result.water is None:
            return None
        if self._frames == 0:
            self._thresholds = result.rings.thresholds  # later ones are corrected, and fit the log
        self._frames += 1
        frame = result.frame
        intensity = frame.intensity[frame.valid]
        self._least, self._most = min(self._least, intensity.min()), max(self._most, intensity.max())
        if not self._most and not self._other:
            self._other = next(iter(frame.other_intensities()), None)
        ring = np.searchsorted(self._edges, frame.range_m[frame.valid], side="right") - 1
        inside = (ring >= 0) & (ring < len(self._points))
        ring, intensity = ring[inside], intensity[inside]
        self._points += np.bincount(ring, minlength=len(self._points))
        self._low += np.bincount(ring[intensity < self._thresholds[ring]], minlength=len(self._points))
        np.minimum.at(self._ring_least, ring, intensity)
        np.maximum.at(self._ring_most, ring, intensity)
        return self.warning() if self._frames >= _FRAMES else None

    def warning(self) -> str | None:
        if not self._frames:
            return None
        least, most = float(self._thresholds.min()), float(self._thresholds.max())
        ranges = f"intensities are {self._least:g} to {self._most:g}, thresholds {least:g} to {most:g}"
        if self._most > self._top:
            return (
                f"the thresholds are for {self._sensor}, whose intensities end at {self._top:g}, but those of the log "
                f"reach {self._most:g}; find thresholds for this sensor with: seaclutter calibrate"
            )
        if self._most < least:
            other = f"; use --intensity-field {self._other}" if self._other else ""
            fitting = f"{ranges}; find thresholds for this sensor with: seaclutter calibrate"
            return f"no point {self._passes}: {fitting if self._most else f'the intensities are always 0{other}'}"
        if self._least < 0 <= least:
            return f"some intensities are negative, as unsigned numbers are that were recorded as signed: {ranges}"
        if not self._low.any() and self._points.sum() >= _MIN_POINTS:
            return f"no point is below its threshold: {ranges}; {_REMEDY}"
        many = self._points >= _MIN_RING_POINTS
        useless = many & (self._low == 0)
        blind = many & (2 * self._ring_most < self._thresholds)
        rings, problem = (useless, "is below the threshold") if useless.any() else (blind, self._passes)
        return self._in_ring(rings, problem) if rings.any() else None

    def _in_ring(self, rings: Mask, problem: str) -> str:
        k = int(np.flatnonzero(rings)[0])
        others = int(np.count_nonzero(rings)) - 1
        more = f" (and {count(others, 'other range ring')})" if others else ""
        start, end, threshold = self._edges[k], self._edges[k + 1], self._thresholds[k]
        ranges = f"intensities are {self._ring_least[k]:g} to {self._ring_most[k]:g}, the threshold {threshold:g}"
        return f"no point from {start:g} to {end:g} m{more} {problem}: {ranges}; {_REMEDY}"


def impossible(least_m: float, most_m: float) -> str | None:
    """Return why ranges are not those of a lidar on a vessel; None if they may be."""
    if _FARTHEST_M <= least_m < math.inf:
        return "coordinates of a map are not relative to a lidar: for airborne tiles, see seaclutter classify"
    if least_m > most_m or _NEAR_M < most_m < _FARTHEST_M:
        return None
    return f"ranges reach {most_m:g} m: coordinates must be in metres, and those of shots without an echo NaN or 0"


class _RangeCheck:
    """Check whether ranges are possible, and any near enough for the method; it warns at the end."""

    def __init__(self, edges: Sequence[float]) -> None:
        self._end_m = edges[-1] if edges else _FARTHEST_M
        self._least_m, self._most_m = math.inf, 0.0

    def add(self, result: FilterResult) -> None:
        range_m, valid = result.frame.range_m, result.frame.valid
        self._least_m = float(range_m.min(where=valid, initial=self._least_m))
        self._most_m = float(range_m.max(where=valid, initial=self._most_m))

    def warning(self) -> str | None:
        why = impossible(self._least_m, self._most_m)
        if self._least_m < self._end_m or self._least_m == math.inf:
            return why
        text = f"no point is in range: the nearest is {self._least_m:,.0f} m away, the limit {self._end_m:,.0f} m"
        return f"{text}; {why}" if why else f"{text} (filter.end_m)"


class _ScanCheck:
    """Check whether frames are whole scans, of which no lidar makes more than 30 per second."""

    def __init__(self) -> None:
        self._frames, self._first_ns = 0, 0

    def add(self, result: FilterResult) -> str | None:
        self._frames += 1
        if self._frames == 1:
            self._first_ns = result.frame.stamp_ns
        span_s = (result.frame.stamp_ns - self._first_ns) / 1e9
        if self._frames != _FRAMES or not 0 < span_s * _FASTEST_HZ < _FRAMES - 1:
            return None
        rate = f"{(_FRAMES - 1) / span_s:.0f} frames per second are more than a lidar scans"
        return f"{rate}; if they are parts of scans, join them with --integrate 100"

    def warning(self) -> None:
        return None


class _PlaneCheck:
    """Check whether points have different heights, which the method needs, and z is upwards; it warns at the end."""

    def __init__(self, config: Config) -> None:
        self._method, self._mounting = config.method, getattr(config.filter, "mounting", None)
        self._limits_m = math.inf, -math.inf
        self._spreads_m: list[Floats] = []

    def add(self, result: FilterResult) -> None:
        least, most = self._limits_m
        if least < most and len(self._spreads_m) >= _FRAMES:
            return
        xyz = result.frame.coordinates[:, result.frame.valid]
        self._limits_m = float(xyz[2].min(initial=least)), float(xyz[2].max(initial=most))
        if xyz.shape[1] >= _MIN_POINTS:
            xyz = self._mounting.levelled(xyz) if self._mounting else xyz
            self._spreads_m.append(np.median(np.abs(xyz - np.median(xyz, axis=1, keepdims=True)), axis=1))

    def warning(self) -> str | None:
        if self._limits_m[0] == self._limits_m[1]:
            return (
                f"all points are at one height, as in laser scans; {self._method} needs heights, so use another method"
            )
        x, y, z = np.median(self._spreads_m, axis=0).tolist() if self._spreads_m else (0, 0, 0)
        least, most = sorted((x, y))
        if z <= _UPRIGHT * least or most >= _UPRIGHT * z:  # points in a line do not tell
            return None
        found = f"points spread by {z:.1f} m in z, but {least:.1f} m in {'x' if x < y else 'y'}"
        key = f"filter.mounting_{'pitch' if x < y else 'roll'}_deg"
        return f"z does not seem to point upwards: {found}; turn them, or set {key} to 90 or -90"


class _MountingCheck:
    """Check whether the water is where the mounting of the configuration says."""

    def __init__(self, params: "ConfirmedParams") -> None:
        from seaclutter_cli.water import MountingSearch  # most methods need no water

        self._zones = Zones(params)
        self._given = params.mounting
        self._search = MountingSearch(self._given)

    def add(self, result: FilterResult) -> str | None:
        time_s = result.frame.stamp_ns / 1e9
        if not self._search.wants(time_s):
            return None
        zone, _ = self._zones.divide(result.frame)
        used = (zone >= 1) & (zone <= self._zones.count + 1)  # range rings and beyond
        self._search.add(result.frame.coordinates[:, used], time_s)
        return self.warning() if self._search.complete else None

    def warning(self) -> str | None:
        found, given = self._search.found(), self._given
        if found is None:
            return None
        tilt_deg = found.tilt_deg(given)
        seems = (
            "upside down: the water is above it" if tilt_deg > 90 else f"tilted: the water slopes by {tilt_deg:.0f}°"
        )
        angles = (("roll", found.roll_deg, given.roll_deg), ("pitch", found.pitch_deg, given.pitch_deg))
        keys = [f"filter.mounting_{axis}_deg to {angle:g}" for axis, angle, was in angles if angle != was]
        return f"the lidar seems to be mounted {seems}; set {' and '.join(keys)}"


class _LandCheck:
    """Check whether what the method takes for water is land; it warns at the end."""

    def __init__(self, params: "ConfirmedParams") -> None:
        from seaclutter_cli.runs.surroundings import Ground

        self._ground = Ground(params.mounting)

    def add(self, result: FilterResult) -> None:
        if result.water is not None:
            self._ground.add(result.frame, result.water)

    def warning(self) -> str | None:
        return self._ground.warning()


def warn_if_filtered(source: Source, topics: Collection[str], config: Config, observer: Observer) -> None:
    """Warn if a method other than ``none`` filters clouds again that an earlier run filtered."""
    if config.method != "none" and (by := filtered_by(source, topics)) is not None:
        observer.warn(f"{source.name}: already filtered{by}; this run only filters the remaining points")


class FitChecks(Checks):
    """Checks of the frames of a topic, and of the sums over them; an observer receives the warnings."""

    def __init__(self, config: Config, source: Source, topic: str, observer: Observer) -> None:
        super().__init__(config, source.facts, filtered=filtered_by(source, [topic]) is not None)
        self._topic, self._observer, self._facts = topic, observer, source.facts
        self._written_anew: str | None = None
        self._sensor = TopicStatistics()
        self._beams_deg: Floats | None = None
        self._around: Surroundings | None = None
        self._first_ns = self._last_ns = self._restarts = 0

    def see(self, result: FilterResult) -> None:
        """Check a frame."""
        self._warn(self.add(result))
        stamp_ns, frames = result.frame.stamp_ns, self._tally.frames
        if frames == 1:
            self._first_ns = stamp_ns
        elif not -_MAX_STEP_BACK_NS <= stamp_ns - self._last_ns <= _MAX_GAP_NS:
            self._restarts += 1
        self._last_ns = stamp_ns
        if not self._written_anew and (change := rewrapped(result.frame.cloud)):
            self._written_anew = change
            self._warn([change])
        if frames == _SHOWS_BEAMS and self._config.kind.has_water and result.frame.valid.any():
            from seaclutter_cli.structure.search import BeamGrid

            self._sensor.add(result.frame)
            self._beams_deg = BeamGrid.of(result.frame).beams_deg
        params, is_due = self._config.filter, frames >= _BEGIN and frames % _EVERY == 0
        if is_due and isinstance(params, ZoneParams) and params.start_m != "auto" and params.near != "keep":
            from seaclutter_cli.runs.surroundings import MOST_M, Surroundings  # short logs do not show them

            self._around = self._around or Surroundings(min(params.own_ship_m, MOST_M))
            self._around.add(result.frame)

    def end(self) -> str | None:
        """Check all frames.

        Return a line for the summary about the least that the lidar sees, if the method finds objects on water.
        """
        self._warn(self.finish(self.cause))
        if self._around is not None:
            self._warn(filter(None, [self._around.warning()]))
        water = self._tally.mean_water
        if self._tally.frames < _SHOWS_BEAMS or water is None:
            return None
        from seaclutter_cli.runs.surroundings import smallest

        models = self._sensor.sensor(self._facts.get(self._topic)).models
        return smallest(models, self._beams_deg, water.level_m)

    @property
    def cause(self) -> str:
        """Why objects were not followed for long enough, if stamps tell it, for the end of a warning."""
        if self._restarts:
            frames = f"{self._restarts:,} of {count(self._tally.frames, 'frame')}"
            return f"; the stamps of {frames} step back or by more than 5 s, and objects are followed anew from there"
        seconds = abs(self._last_ns - self._first_ns) / 1e9
        return f"; the frames span only {seconds:.1f} s" if seconds < _ENOUGH_S else ""

    def _warn(self, texts: Iterable[str]) -> None:
        for text in texts:
            self._observer.warn(f"{self._topic}: {text}")
