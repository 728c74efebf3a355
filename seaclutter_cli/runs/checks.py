"""Checks of the first frames of a topic against the configuration, each with at most one warning."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from seaclutter_cli.config import Config
from seaclutter_cli.filters.confirmation.params import ConfirmedParams
from seaclutter_cli.filters.fit import ThresholdCheck
from seaclutter_cli.filters.zones import Zones
from seaclutter_cli.frame import FilterResult
from seaclutter_cli.records import SensorFacts
from seaclutter_cli.runs.sensor_match import SensorCheck
from seaclutter_cli.sensors.catalog import SENSORS
from seaclutter_cli.water import Mounting, MountingSearch

_FARTHEST_M = 10_000.0  # no lidar on a vessel measures farther


class Check(Protocol):
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
        self._thresholds: list[Check] = [SensorCheck(sensor, facts)] if sensor else []
        if not filtered:
            self._thresholds.append(
                ThresholdCheck(config.ring_edges, sensor=model, max_intensity=top, needs_water=config.has_water)
            )
        self._others: list[Check] = [RangeCheck(config.ring_edges)]
        if config.needs_height:
            self._others.append(PlaneCheck(config.method))
        if config.has_water:
            self._others.append(MountingCheck(config.filter))

    def add(self, result: FilterResult) -> list[str]:
        """Add a frame; return the warnings that enough frames justify."""
        return self._warnings(lambda check: check.add(result))

    def finish(self) -> list[str]:
        """Return the warnings about the frames so far, without those that were already returned."""
        return self._warnings(lambda check: check.warning())

    def _warnings(self, ask: Callable[[Check], str | None]) -> list[str]:
        found = [text for check in self._others if (text := ask(check))]
        first = next((text for check in self._thresholds if (text := ask(check))), None)
        if first is None:
            return found
        self._thresholds = []
        return [first, *found]


class RangeCheck:
    """Check whether any point is near enough for the method, with at most one warning.

    Parameters
    ----------
    edges : sequence of float
        Edges of the range rings in metres; empty for methods without range rings.
    """

    def __init__(self, edges: Sequence[float]) -> None:
        self._end_m = edges[-1] if edges else _FARTHEST_M
        self._nearest_m, self._done = math.inf, False

    def add(self, result: FilterResult) -> str | None:
        """Add a frame; there is no warning before the end."""
        if not self._done:
            frame = result.frame
            self._nearest_m = min(self._nearest_m, float(frame.range_m[frame.valid].min(initial=math.inf)))
            self._done = self._nearest_m < self._end_m
        return None

    def warning(self) -> str | None:
        """Return a warning if no point of the frames so far is in range; None without points."""
        if self._done or self._nearest_m == math.inf:
            return None
        self._done = True
        text = f"no point is in range: the nearest is {self._nearest_m:,.0f} m away, the limit {self._end_m:,.0f} m"
        if self._nearest_m < _FARTHEST_M:
            return f"{text} (filter.end_m)"
        return f"{text}; coordinates of a map are not relative to a lidar: for airborne tiles, see seaclutter classify"


class PlaneCheck:
    """Check whether points have different heights, with at most one warning.

    Parameters
    ----------
    method : str
        Name of a method that depends on them.
    """

    def __init__(self, method: str) -> None:
        self._method = method
        self._limits_m = math.inf, -math.inf
        self._done = False

    def add(self, result: FilterResult) -> str | None:
        """Add a frame; there is no warning before the end."""
        if not self._done:
            z = result.frame.coordinates[2][result.frame.valid]
            least, most = self._limits_m
            self._limits_m = float(z.min(initial=least)), float(z.max(initial=most))
            self._done = self._limits_m[0] < self._limits_m[1]
        return None

    def warning(self) -> str | None:
        """Return a warning if all points so far are at one height; None without points."""
        if self._done or self._limits_m[0] == math.inf:
            return None
        self._done = True
        return f"all points are at one height, as in laser scans; {self._method} needs heights, so use another method"


class MountingCheck:
    """Check whether the water is where the mounting of the configuration says.

    Parameters
    ----------
    params : ConfirmedParams
        Mounting, range limits and boxes of own structure.
    """

    def __init__(self, params: ConfirmedParams) -> None:
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


def _other_mounting(found: Mounting, given: Mounting) -> str:
    """Return a warning about a mounting that is not the given one."""
    tilt_deg = found.tilt_deg(given)
    seems = "upside down: the water is above it" if tilt_deg > 90 else f"tilted: the water slopes by {tilt_deg:.0f}°"
    keys = [
        f"filter.mounting_{axis}_deg to {angle:g}"
        for axis, angle, was in (
            ("roll", found.roll_deg, given.roll_deg),
            ("pitch", found.pitch_deg, given.pitch_deg),
        )
        if angle != was
    ]
    return f"the lidar seems to be mounted {seems}; set {' and '.join(keys)}"
