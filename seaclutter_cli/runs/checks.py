"""Checks of the first frames of a topic against the configuration, each with at most one warning."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from seaclutter_cli.config import Config, SensorParams
from seaclutter_cli.filters.threshold_check import ThresholdCheck
from seaclutter_cli.filters.zones import Zones
from seaclutter_cli.frame import FilterResult
from seaclutter_cli.records import SensorFacts
from seaclutter_cli.runs.topic_statistics import TopicStatistics
from seaclutter_cli.sensors.catalog import SENSORS

if TYPE_CHECKING:
    from seaclutter_cli.filters.confirmation import ConfirmedParams

_FARTHEST_M = 10_000.0  # no lidar on a vessel measures farther
_SENSOR_FRAMES = 20


class _Check(ABC):
    """A check of the frames of one topic."""

    @abstractmethod
    def add(self, result: FilterResult) -> str | None:
        """Add a frame; return a warning once enough frames justify it."""

    @abstractmethod
    def warning(self) -> str | None:
        """Return a warning about the frames so far; None without one."""


class Checks:
    """Checks of the frames of one topic, given facts about the sensors of the recording, which may grow meanwhile.

    ``filtered`` is whether an earlier run filtered the frames, so that no weak points show whether the thresholds fit.
    """

    def __init__(self, config: Config, facts: Mapping[str, SensorFacts], *, filtered: bool = False) -> None:
        sensor = config.threshold_sensor
        model = sensor.model if sensor else None
        top = SENSORS[model].max_intensity if model and model in SENSORS else None
        # Another sensor explains thresholds that do not fit, so the first of these that warns is enough.
        thresholds: list[_Check | ThresholdCheck] = [_SensorCheck(sensor, facts)] if sensor else []
        if not filtered:
            fit = ThresholdCheck(config.ring_edges, sensor=model, max_intensity=top, needs_water=config.has_water)
            thresholds.append(fit)
        self._waiting: list[list[_Check | ThresholdCheck]] = [thresholds, [_RangeCheck(config.ring_edges)]]
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

    def _warnings(self, ask: "Callable[[_Check | ThresholdCheck], str | None]") -> list[str]:
        """Return the first warning of each group of checks, and end the groups that warn."""
        found = []
        for checks in self._waiting:
            if text := next(filter(None, map(ask, checks)), None):
                found.append(text)
                checks.clear()
        return found


class _SensorCheck(_Check):
    """Check whether the thresholds are for the sensor of a topic, which its first frames show."""

    def __init__(self, given: SensorParams, facts: Mapping[str, SensorFacts]) -> None:
        self._given, self._facts = given, facts
        self._seen, self._topic = TopicStatistics(), ""

    def add(self, result: FilterResult) -> str | None:
        if self._seen.frames >= _SENSOR_FRAMES:
            return None
        self._topic = result.frame.topic
        self._seen.add(result.frame)
        return self.warning() if self._seen.frames == _SENSOR_FRAMES else None

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


class _RangeCheck(_Check):
    """Check whether any point is near enough for the method; it warns at the end."""

    def __init__(self, edges: Sequence[float]) -> None:
        self._end_m = edges[-1] if edges else _FARTHEST_M
        self._nearest_m = math.inf

    def add(self, result: FilterResult) -> None:
        if self._nearest_m >= self._end_m:
            frame = result.frame
            self._nearest_m = min(self._nearest_m, float(frame.range_m[frame.valid].min(initial=math.inf)))

    def warning(self) -> str | None:
        if self._nearest_m < self._end_m or self._nearest_m == math.inf:
            return None
        text = f"no point is in range: the nearest is {self._nearest_m:,.0f} m away, the limit {self._end_m:,.0f} m"
        if self._nearest_m < _FARTHEST_M:
            return f"{text} (filter.end_m)"
        return f"{text}; coordinates of a map are not relative to a lidar: for airborne tiles, see seaclutter classify"


class _PlaneCheck(_Check):
    """Check whether points have different heights, which the method needs; it warns at the end."""

    def __init__(self, method: str) -> None:
        self._method = method
        self._limits_m = math.inf, -math.inf

    def add(self, result: FilterResult) -> None:
        least, most = self._limits_m
        if least >= most:
            z = result.frame.coordinates[2][result.frame.valid]
            self._limits_m = float(z.min(initial=least)), float(z.max(initial=most))

    def warning(self) -> str | None:
        if self._limits_m[0] != self._limits_m[1]:
            return None
        return f"all points are at one height, as in laser scans; {self._method} needs heights, so use another method"


class _MountingCheck(_Check):
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
