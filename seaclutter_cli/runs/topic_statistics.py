"""Statistics of a cloud topic: sizes, fields, extents of intensity and range, and possible sensors."""

from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np

from seaclutter_cli.cloud import PointField
from seaclutter_cli.errors import FieldError
from seaclutter_cli.frame import Frame
from seaclutter_cli.records import SensorFacts
from seaclutter_cli.runs.recordings import Outcome, data_of
from seaclutter_cli.sensors.catalog import RecognisedSensor, recognise

if TYPE_CHECKING:
    from seaclutter_cli.runs.surroundings import Surroundings

_NANO = 1_000_000_000
_FIRST_FRAMES = 20


@dataclass
class TopicStatistics:
    """Statistics over the frames of one topic, and its surroundings, if wanted; grows by a few bytes per frame."""

    frames: int = 0
    invalid: int = 0
    fields: Sequence[PointField] = ()
    shape: tuple[int, int] = (0, 0)
    frame_id: str = ""
    intensity_name: str | None = None
    other_intensity: str | None = None
    """Field that has values, if all those of the intensity are zero."""
    problem: str | None = None
    intensity: list[float] = field(default_factory=lambda: [np.inf, -np.inf])
    range_m: list[float] = field(default_factory=lambda: [np.inf, -np.inf])
    around: "Surroundings | None" = None
    _stamps_ns: "array[int]" = field(default_factory=lambda: array("q"))
    _sizes: "array[int]" = field(default_factory=lambda: array("L"))
    _rings: list[float] = field(default_factory=lambda: [np.inf, -np.inf])

    def add(self, frame: Frame) -> None:
        """Add a frame to the statistics."""
        cloud = frame.cloud
        self.frames += 1
        self._sizes.append(frame.size)
        if cloud.fields or not self.fields:
            self.fields, self.shape, self.frame_id = cloud.fields, (cloud.height, cloud.width), cloud.frame_id
        self._stamps_ns.append(frame.stamp_ns)
        try:
            self.intensity_name = frame.intensity_name
            valid = frame.valid
            self.invalid += frame.size - int(np.count_nonzero(valid))
            _extend(self.range_m, frame.range_m[valid])
            if self.intensity_name is not None:
                _extend(self.intensity, frame.intensity[valid])
                if self.intensity[1] == 0 and not self.other_intensity:
                    self.other_intensity = next(iter(frame.other_intensities()), None)
            if self.around is not None:
                self.around.add(frame)
        except FieldError as error:
            self.problem = str(error)
        name = cloud.ring_name
        if name and cloud.dtype[name].kind in "fiu":
            rings = cloud.points[name][np.isfinite(cloud.points[name])].astype(np.float64)
            _extend(self._rings, rings)

    @property
    def points(self) -> int:
        """Total number of points."""
        return sum(self._sizes)

    def sizes(self) -> tuple[int, float, int]:
        """Return the minimum, median and maximum number of points in a frame."""
        return (min(self._sizes), median(self._sizes), max(self._sizes)) if self._sizes else (0, 0, 0)

    @property
    def rate_hz(self) -> float | None:
        """Frames per second by the median of the intervals between stamps; None for fewer than two frames.

        A recording begins and ends within revolutions, and pauses; the median is that of whole revolutions.
        """
        intervals = np.diff(np.asarray(self._stamps_ns, np.int64))
        middle = float(np.median(intervals)) if len(intervals) else 0.0
        return _NANO / middle if middle > 0 else None

    @property
    def rings(self) -> int | None:
        """Number of rings up to the last one seen; None without a ring field."""
        first, last = self._rings
        return int(last - first) + 1 if first <= last else None

    def sensor(self, facts: SensorFacts | None = None) -> RecognisedSensor:
        """Return the sensor that recorded the topic, from the facts about it or from the layout of its clouds."""
        return recognise([item.name for item in self.fields], self.rings, round(self.sizes()[1]), facts)

    def as_dict(self) -> dict[str, Any]:
        """Return the statistics as values for JSON."""
        return {
            "frames": self.frames,
            "rate_hz": None if self.rate_hz is None else round(self.rate_hz, 3),
            "frame_id": self.frame_id,
            "shape": list(self.shape),
            "points": dict(zip(("min", "median", "max"), self.sizes(), strict=True)),
            "fields": [data_of(one, "name type offset count") for one in self.fields],
            "intensity_field": self.intensity_name,
            "intensity": _limits(self.intensity),
            "range_m": _limits(self.range_m),
            "invalid_share": self.invalid / self.points if self.points else None,
            "sensors": list(self.sensor().models),
            "own_ship_m": self.around.end_m if self.around else None,
            "problem": self.problem,
        }


@dataclass(kw_only=True)
class Described(Outcome):
    """Outcome with the log times of the first and last message or frame, and statistics of the clouds by topic."""

    times_ns: list[int] = field(default_factory=list)
    clouds: dict[str, TopicStatistics] = field(default_factory=dict, repr=False)

    def note_time(self, time_ns: int) -> None:
        """Extend the time span of the recording."""
        self.times_ns = [min([time_ns, *self.times_ns]), max([time_ns, *self.times_ns])]

    def note(self, frame: Frame) -> None:
        """Extend the time span, and add one of the first frames, which show the sensor, to the statistics."""
        self.note_time(frame.log_time_ns)
        cloud = self.clouds.setdefault(frame.topic, TopicStatistics())
        if cloud.frames < _FIRST_FRAMES:
            cloud.add(frame)

    @property
    def recognised(self) -> dict[str, RecognisedSensor]:
        """Sensor of each topic."""
        return {topic: cloud.sensor(self.facts.get(topic)) for topic, cloud in self.clouds.items()}


def _extend(limits: list[float], values: np.ndarray[Any, np.dtype[np.float64]]) -> None:
    if len(values):
        limits[:] = min(limits[0], float(values.min())), max(limits[1], float(values.max()))


def _limits(limits: Sequence[float]) -> list[float] | None:
    return list(limits) if limits[0] <= limits[1] else None
