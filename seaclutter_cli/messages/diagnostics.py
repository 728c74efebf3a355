"""Statistics of a filtered frame as a message for plotting tools."""

import math
from collections.abc import Callable
from dataclasses import astuple, dataclass
from functools import cache
from typing import Any

import numpy as np

from seaclutter_cli.arrays import Ints
from seaclutter_cli.documents import load_json
from seaclutter_cli.errors import InputError
from seaclutter_cli.frame import WATER_COLUMNS, WATER_REASONS, FilterResult, Reason, Rings, WaterState
from seaclutter_cli.messages.definitions import Content, Time, companion_format, make_typestore
from seaclutter_cli.messages.serialisation import NANO
from seaclutter_cli.records import Message, Schema

TOPIC = "/seaclutter/diagnostics"

_REASONS = tuple(reason.name.lower() for reason in Reason if reason)
_ARRAYS = {
    "thresholds": "float64",
    "corrections": "float64",
    "ring_points": "uint32",
    "ring_low_intensity": "uint32",
    "ring_outliers": "uint32",
}


@dataclass(frozen=True)
class Layout:
    """Fields of the messages of a method: whole ``numbers``, the arrays of all layouts, ``measures`` of water."""

    name: str
    numbers: tuple[str, ...]
    measures: tuple[str, ...] = ()

    @property
    def type(self) -> str:
        """ROS name of the message type."""
        return f"seaclutter_msgs/msg/{self.name}"


_SIZES = ("frame", "points_in", "points_out")
_DRY_REASONS = tuple(reason.name.lower() for reason in Reason if reason and reason not in WATER_REASONS)
PLAIN = Layout("Diagnostics", (*_SIZES, *_DRY_REASONS))
WATER = Layout("WaterDiagnostics", (*_SIZES, *_REASONS), WATER_COLUMNS)


@dataclass(frozen=True)
class Diagnostics:
    """Statistics of one frame: its place in a recording, and what a `FilterResult` has beside its points."""

    topic: str
    frame: int
    stamp_ns: int
    points_in: int
    counts: Ints
    rings: Rings | None
    scene: str | None
    water: WaterState | None

    @classmethod
    def of(cls, result: FilterResult) -> "Diagnostics":
        """Return the statistics of a filtered frame."""
        frame = result.frame
        place = frame.topic, frame.index, frame.stamp_ns, frame.size
        return cls(*place, result.counts, result.rings, result.scene, result.water)

    def content(self, layout: Layout = PLAIN) -> Content:
        """Return the values of the fields of a message.

        The arrays have one value per range ring and are empty without range rings, the scene is empty for methods that
        do not distinguish scenes, and the measures of the water are NaN where no water is seen.
        """
        known = dict(zip((*_SIZES, *_REASONS), (self.frame, self.points_in, *self.counts.tolist()), strict=True))
        rings = vars(self.rings).values() if self.rings else [()] * len(_ARRAYS)
        water = astuple(self.water) if self.water else [math.nan] * len(WATER_COLUMNS)
        return {
            "stamp": Time(self.stamp_ns),
            "topic": self.topic,
            "scene": self.scene or "",
            **{name: known[name] for name in layout.numbers},
            **{name: np.asarray(one, _ARRAYS[name]) for name, one in zip(_ARRAYS, rings, strict=False)},
            **dict(zip(layout.measures, water, strict=False)),
        }


def _definition(layout: Layout) -> str:
    lines = ["builtin_interfaces/Time stamp", "string topic"]
    lines += [f"uint32 {name}" for name in layout.numbers]
    lines += [f"{dtype}[] {name}" for name, dtype in _ARRAYS.items()]
    lines += [f"float64 {name}" for name in layout.measures]
    lines += ["string scene"]
    return "\n".join(lines) + "\n"


@cache
def _typestore() -> Any:
    time = {"builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec\n"}
    return make_typestore(time | {layout.type: _definition(layout) for layout in (PLAIN, WATER)}, "EMPTY")


def _json_schema(layout: Layout) -> Content:
    integer = {"type": "integer"}
    stamp = {"type": "object", "title": "time", "properties": {"sec": integer, "nsec": integer}}
    numbers = dict.fromkeys(layout.numbers, integer)
    measures = {name: {"type": ["number", "null"]} for name in layout.measures}
    arrays = {name: {"type": "array", "items": {"type": "number"}} for name in _ARRAYS}
    texts = {name: {"type": "string"} for name in ("topic", "scene")}
    properties = {"stamp": stamp, **texts, **numbers, **arrays, **measures}
    return {"title": f"seaclutter.{layout.name}", "type": "object", "properties": properties}


@cache
def diagnostics_format(cloud_encoding: str, layout: Layout = PLAIN) -> tuple[str, Schema, Callable[[Content], bytes]]:
    """Return the message encoding, schema and serialiser for a log, given the encoding of its clouds."""
    return companion_format(cloud_encoding, layout.type, _typestore, lambda: _json_schema(layout))


def read_diagnostics(message: Message) -> Diagnostics:
    """Return the statistics in a message; `InputError` if it is not valid."""
    data, encoding, schema = message.data, message.channel.message_encoding, message.channel.schema
    layout = WATER if schema and schema.name.endswith(WATER.name) else PLAIN
    try:
        if encoding == "json":
            found = load_json(bytes(data))
            stamp_ns = found["stamp"]["sec"] * NANO + found["stamp"]["nsec"]
        else:
            store = _typestore()
            read = store.deserialize_cdr if encoding == "cdr" else store.deserialize_ros1
            found = vars(read(data, layout.type))
            stamp_ns = found["stamp"].sec * NANO + found["stamp"].nanosec
        numbers = {name: int(found[name]) for name in layout.numbers}
        measures = [math.nan if found[name] is None else float(found[name]) for name in layout.measures]
        arrays = [np.asarray(found[name], dtype) for name, dtype in _ARRAYS.items()]
        place, scene = (str(found["topic"]), numbers["frame"], stamp_ns, numbers["points_in"]), str(found["scene"])
    except Exception as error:  # the library does not document its errors for invalid bytes
        raise InputError(f"{TOPIC}: invalid message ({error!r})") from error
    counts = np.array([numbers.get(name, 0) for name in ("points_out", *_REASONS)], np.int64)
    water = WaterState(*measures) if measures and not any(map(math.isnan, measures)) else None
    rings = Rings(*arrays[:2], *(one.astype(np.int64) for one in arrays[2:])) if len(arrays[0]) else None
    return Diagnostics(*place, counts, rings, scene or None, water)
