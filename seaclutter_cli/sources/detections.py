"""Detections of the Autoferry sensor fusion data set: positions that detectors found, as clouds of a few points.

See https://github.com/Autoferry/sensor_fusion_dataset. Positions are relative to own ship in axes that point north,
east and down. Here x points north, y west and z up, as clouds have it.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.cloud import from_array
from seaclutter_cli.documents import DocumentError, load_json, read_document
from seaclutter_cli.errors import InputError, about
from seaclutter_cli.messages import CODECS
from seaclutter_cli.messages.definitions import POINT_CLOUD, POSE, ros2_schema
from seaclutter_cli.records import Channel, Message
from seaclutter_cli.sources.frame_files.sidecars import Pose, pose_message
from seaclutter_cli.sources.shared import TimedSource

_SUFFIX = "_detections.json"
_TOPICS = {1: "/lidar/detections", 2: "/radar/detections"}
"""Topics by ``sensorID``; cameras (3 and 4) give bearings only."""
_FRAME_ID, _MAP_ID = "own_ship", "map"
_POINT = np.dtype([(axis, "<f8") for axis in "xyz"])


@dataclass(frozen=True, slots=True)
class _Detections:
    topic: str
    stamp_ns: int
    own_ship: tuple[float, float]
    places: NDArray[np.float64]


class DetectionSource(TimedSource):
    """Detections as clouds on a topic for each sensor, own ship on ``/pose``; `InputError` for other files."""

    format = "Autoferry detections"

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.name = path.name.removesuffix(_SUFFIX) or path.stem
        self._found, bearings = [], 0
        with about(path, InputError, DocumentError):
            items = load_json(read_document(path))
        if not isinstance(items, list):
            raise InputError(f"{path}: must be a list of detections, as in the Autoferry sensor fusion data set")
        for number, item in enumerate(items):
            try:
                found = _parsed(item)
            except (KeyError, TypeError, ValueError, OverflowError):
                self.report(f"detection {number} is not valid", 0, 1, path=path)
                continue
            self._found += [found] if found else []
            bearings += found is None
        if bearings:
            self.warnings.append(f"{self.name}: {bearings:,} detections of cameras are left out; they are bearings")
        self._found.sort(key=lambda one: one.stamp_ns)
        kinds = dict.fromkeys(_TOPICS.values(), POINT_CLOUD) | {"/pose": POSE}
        self.channels = [Channel(k, topic, "cdr", ros2_schema(kinds[topic])) for k, topic in enumerate(kinds, 1)]
        self._channels = {channel.topic: channel for channel in self.channels}
        self._times_ns = {
            channel.id: [one.stamp_ns for one in self._found if channel.topic in ("/pose", one.topic)]
            for channel in self.channels
        }

    def records(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Message]:
        """Yield the messages with log times in ``[start_ns, end_ns)`` in order; own ship's position comes first."""
        for index, one in enumerate(self._found):
            if (start_ns is not None and one.stamp_ns < start_ns) or (end_ns is not None and one.stamp_ns >= end_ns):
                continue
            pose = Pose((*one.own_ship, 0.0), (0.0, 0.0, 0.0, 1.0))
            yield self._message("/pose", one, index, pose_message(pose, one.stamp_ns, _MAP_ID))
            points = np.zeros(one.places.shape[1], _POINT)
            points["x"], points["y"] = one.places[0], -one.places[1]
            cloud = from_array(points, stamp_ns=one.stamp_ns, frame_id=_FRAME_ID)
            yield self._message(one.topic, one, index, CODECS[POINT_CLOUD, "cdr"].encode(cloud))

    def _message(self, topic: str, one: _Detections, index: int, data: bytes) -> Message:
        return Message(self._channels[topic], one.stamp_ns, one.stamp_ns, index, data)


def _parsed(item: Any) -> _Detections | None:
    """Return the detections of a sensor at one time; None for bearings of a camera."""
    if (topic := _TOPICS.get(item["sensorID"])) is None:
        return None
    # MATLAB writes one position as a list of two numbers, several as two lists, and none as an empty list.
    places = np.array(item["measurement"], np.float64).reshape(2, -1)
    north, east = (float(value) for value in item["ownshipPosition"])
    if not np.isfinite([*places.ravel(), north, east]).all():
        raise ValueError("not finite")
    stamp_ns = round(float(item["time"]) * 1e6) * 1000
    if not 0 <= stamp_ns < 2**31 * 10**9:
        raise ValueError("not a time")
    return _Detections(topic, stamp_ns, (north, -east), places)
