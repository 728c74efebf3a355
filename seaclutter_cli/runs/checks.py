"""Checks of the first frames of a topic against the configuration, each with at most one warning."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

from seaclutter_cli.config import Config, SensorParams
from seaclutter_cli.filters.threshold_check import ThresholdCheck
from seaclutter_cli.filters.zones import Zones
from seaclutter_cli.frame import FilterResult
from seaclutter_cli.records import SensorFacts
from seaclutter_cli.runs.topic_statistics import TopicStatistics
from seaclutter_cli.sensors.catalog import SENSORS, RecognisedSensor

if TYPE_CHECKING:
    from seaclutter_cli.filters.confirmation import ConfirmedParams
    from seaclutter_cli.water import Mounting

_FARTHEST_M = 10_000.0  # no lidar on a vessel measures farther
_SENSOR_FRAMES = 20


class _Check(Protocol):
    """A check of the frames of one topic."""

    def add(self, result: FilterResult) -> str | None:
        """Add a frame; return a warning once enough frames justify it."""
        ...

    def warning(self) -> str | None:
        """Return a warning about the frames so far; None once the check is complete."""
        ...


class Checks:
    """Checks of the frames of one topic.

    Parameters
    ----------
    config : Config
        The configuration.
    facts : mapping of str to SensorFacts
        Facts about the sensors of the recording; may grow while it is read.
    filtered : bool, optional
        Whether an earlier run filtered the frames, so that no weak points show whether the thresholds fit.
    """

    def __init__(self, config: Config, facts: Mapping[str, SensorFacts], *, filtered: bool = False) -> None:
        sensor = config.threshold_sensor
        model = sensor.model if sensor else None
        top = SENSORS[model].max_intensity if model and model in SENSORS else None
        # Another sensor explains thresholds that do not fit, so the first of these that warns is enough.
        thresholds: list[_Check] = [_SensorCheck(sensor, facts)] if sensor else []
        if not filtered:
            fit = ThresholdCheck(config.ring_edges, sensor=model, max_intensity=top, needs_water=config.has_water)
            thresholds.append(fit)
        self._waiting: list[list[_Check]] = [thresholds, [_RangeCheck(config.ring_edges)]]
        if config.needs_height:
            self._waiting.append([_PlaneCheck(config.method)])
        if config.has_water:
            self._waiting.append([_MountingCheck(config.filter)])

    def add(self, result: FilterResult) -> list[str]:
        """Add a frame; return the warnings that enough frames justify."""
        return self._warnings(lambda check: check.add(result))

    def finish(self) -> list[str]:
        """Return the warnings about the frames so far, without those that were already returned."""
        return self._warnings(lambda check: check.warning())

    def _warnings(self, ask: Callable[[_Check], str | None]) -> list[str]:
        """Return the first warning of each group of checks, and end the groups that warn."""
        found = []
        for checks in self._waiting:
            if text := next(filter(None, map(ask, checks)), None):
                found.append(text)
                checks.clear()
        return found


class _SensorCheck:
    """Check whether the thresholds are for the sensor of a topic."""

    def __init__(self, given: SensorParams, facts: Mapping[str, SensorFacts]) -> None:
        self._given, self._facts = given, facts
        self._seen, self._topic = TopicStatistics(), ""
        self._done = False

    def add(self, result: FilterResult) -> str | None:
        """Add a frame; return a warning once the sensor is known to be another one."""
        if self._done:
            return None
        self._topic = result.frame.topic
        self._seen.add(result.frame)
        return self.warning() if self._seen.frames >= _SENSOR_FRAMES else None

    def warning(self) -> str | None:
        """Return a warning if the sensor is known to be another one; None once the check is complete."""
        if self._done or not self._seen.frames:
            return None
        self._done = True
        return _difference(self._given, self._seen.sensor(self._facts.get(self._topic)))


def _difference(given: SensorParams, found: RecognisedSensor) -> str | None:
    """Return a warning if thresholds are not for a sensor; None if they are, or if that is unknown."""
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


class _RangeCheck:
    """Check whether any point is near enough for the method; it warns at the end."""

    def __init__(self, edges: Sequence[float]) -> None:
        self._end_m = edges[-1] if edges else _FARTHEST_M
        self._nearest_m = math.inf

    def add(self, result: FilterResult) -> None:
        """Add a frame."""
        if self._nearest_m >= self._end_m:
            frame = result.frame
            self._nearest_m = min(self._nearest_m, float(frame.range_m[frame.valid].min(initial=math.inf)))

    def warning(self) -> str | None:
        """Return a warning if no point of the frames so far is in range; None without points."""
        if self._nearest_m < self._end_m or self._nearest_m == math.inf:
            return None
        text = f"no point is in range: the nearest is {self._nearest_m:,.0f} m away, the limit {self._end_m:,.0f} m"
        if self._nearest_m < _FARTHEST_M:
            return f"{text} (filter.end_m)"
        return f"{text}; coordinates of a map are not relative to a lidar: for airborne tiles, see seaclutter classify"


class _PlaneCheck:
    """Check whether points have different heights, which the method needs; it warns at the end."""

    def __init__(self, method: str) -> None:
        self._method = method
        self._limits_m = math.inf, -math.inf

    def add(self, result: FilterResult) -> None:
        """Add a frame."""
        least, most = self._limits_m
        if least >= most:
            z = result.frame.coordinates[2][result.frame.valid]
            self._limits_m = float(z.min(initial=least)), float(z.max(initial=most))

    def warning(self) -> str | None:
        """Return a warning if all points so far are at one height; None without points."""
        if self._limits_m[0] != self._limits_m[1]:
            return None
        return f"all points are at one height, as in laser scans; {self._method} needs heights, so use another method"


class _MountingCheck:
    """Check whether the water is where the mounting of the configuration says."""

    def __init__(self, params: "ConfirmedParams") -> None:
        from seaclutter_cli.water import MountingSearch  # most methods need no water

        self._zones = Zones(params)
        self._given = params.mounting
        self._search = MountingSearch(self._given)
        self._done = False

    def add(self, result: FilterResult) -> str | None:
        """Add a frame; return a warning once enough frames show another mounting."""
        time_s = result.frame.stamp_ns / 1e9
        if self._search.wants(time_s):
            zone, _ = self._zones.divide(result.frame)
            used = (zone >= 1) & (zone <= self._zones.count + 1)  # range rings and beyond
            self._search.add(result.frame.coordinates[:, used], time_s)
        return self.warning() if self._search.complete else None

    def warning(self) -> str | None:
        """Return a warning if the frames so far show another mounting; None once the check is complete."""
        if self._done:
            return None
        self._done = self._search.complete
        found = self._search.found()
        return None if found is None else _other_mounting(found, self._given)


def _other_mounting(found: "Mounting", given: "Mounting") -> str:
    """Return a warning about a mounting that is not the given one."""
    tilt_deg = found.tilt_deg(given)
    seems = "upside down: the water is above it" if tilt_deg > 90 else f"tilted: the water slopes by {tilt_deg:.0f}°"
    angles = (("roll", found.roll_deg, given.roll_deg), ("pitch", found.pitch_deg, given.pitch_deg))
    keys = [f"filter.mounting_{axis}_deg to {angle:g}" for axis, angle, was in angles if angle != was]
    return f"the lidar seems to be mounted {seems}; set {' and '.join(keys)}"
