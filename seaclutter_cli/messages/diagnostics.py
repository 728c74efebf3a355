"""Statistics of a filtered frame as a message for plotting tools: one definition, three encodings."""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import InputError
from seaclutter_cli.frame import FilterResult, Reason, Rings
from seaclutter_cli.messages.companion import companion_format
from seaclutter_cli.records import Buffer, Schema

TOPIC = "/seaclutter/diagnostics"
TYPE = "seaclutter_msgs/msg/Diagnostics"

_NUMBERS = ("frame", "points_in", "points_out", *(reason.name.lower() for reason in Reason if reason))
_ARRAYS = {
    "thresholds": "float64",
    "corrections": "float64",
    "ring_points": "uint32",
    "ring_low_intensity": "uint32",
    "ring_outliers": "uint32",
}
_NANO = 1_000_000_000


@dataclass(frozen=True)
class Diagnostics:
    """Statistics of one frame.

    The arrays have one value per range ring and are empty for methods without range rings. The scene is empty for
    methods that do not distinguish scenes.
    """

    stamp_ns: int
    topic: str
    numbers: dict[str, int]
    arrays: dict[str, NDArray[Any]]
    scene: str

    @classmethod
    def of(cls, result: FilterResult) -> "Diagnostics":
        """Return the statistics of a filtered frame."""
        frame, counts = result.frame, [int(count) for count in result.counts]
        numbers = dict(zip(_NUMBERS, (frame.index, frame.size, *counts), strict=True))
        rings = asdict(result.rings) if result.rings else {}
        names = ("thresholds", "corrections", "points", "low_intensity", "outliers")
        arrays = {
            name: np.asarray(rings.get(ring, ()), dtype)
            for (name, dtype), ring in zip(_ARRAYS.items(), names, strict=True)
        }
        return cls(frame.stamp_ns, frame.topic, numbers, arrays, result.scene or "")

    @property
    def counts(self) -> NDArray[np.int64]:
        """Points for each `Reason`, shape (7,), as in `FilterResult.counts`."""
        return np.array([self.numbers[name] for name in _NUMBERS[2:]], np.int64)

    @property
    def rings(self) -> Rings | None:
        """Values of the range rings; None for methods without range rings."""
        if not len(self.arrays["thresholds"]):
            return None
        integers = (self.arrays[name].astype(np.int64) for name in list(_ARRAYS)[2:])
        return Rings(self.arrays["thresholds"], self.arrays["corrections"], *integers)


def definition() -> str:
    """Return the ROS message definition."""
    lines = ["builtin_interfaces/Time stamp", "string topic"]
    lines += [f"uint32 {name}" for name in _NUMBERS]
    lines += [f"{dtype}[] {name}" for name, dtype in _ARRAYS.items()]
    lines += ["string scene"]
    return "\n".join(lines) + "\n"


@cache
def _typestore() -> Any:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg("int32 sec\nuint32 nanosec\n", "builtin_interfaces/msg/Time"))
    store.register(get_types_from_msg(definition(), TYPE))
    return store


def _message(diagnostics: Diagnostics, least_s: int, most_s: int) -> Any:
    """Return the message as an object of the type store; a stamp outside the range of ROS time is clipped."""
    types = _typestore().types
    seconds, nanoseconds = divmod(diagnostics.stamp_ns, _NANO)
    seconds = min(max(seconds, least_s), most_s)
    signed = seconds - 2**32 if seconds >= 2**31 else seconds
    stamp = types["builtin_interfaces/msg/Time"](signed, nanoseconds)
    return types[TYPE](stamp, diagnostics.topic, **diagnostics.numbers, **diagnostics.arrays, scene=diagnostics.scene)


def _cdr(diagnostics: Diagnostics) -> bytes:
    return bytes(_typestore().serialize_cdr(_message(diagnostics, -(2**31), 2**31 - 1), TYPE))


def _ros1(diagnostics: Diagnostics) -> bytes:
    return bytes(_typestore().serialize_ros1(_message(diagnostics, 0, 2**32 - 1), TYPE))


def _json(diagnostics: Diagnostics) -> bytes:
    seconds, nanoseconds = divmod(diagnostics.stamp_ns, _NANO)
    arrays = {name: values.tolist() for name, values in diagnostics.arrays.items()}
    stamp = {"sec": seconds, "nsec": nanoseconds}
    texts = {"topic": diagnostics.topic, "scene": diagnostics.scene}
    return json.dumps({"stamp": stamp, **texts, **diagnostics.numbers, **arrays}).encode()


def _json_schema() -> str:
    integer = {"type": "integer"}
    stamp = {"type": "object", "title": "time", "properties": {"sec": integer, "nsec": integer}}
    numbers = dict.fromkeys(_NUMBERS, integer)
    arrays = {name: {"type": "array", "items": {"type": "number"}} for name in _ARRAYS}
    texts = {name: {"type": "string"} for name in ("topic", "scene")}
    properties = {"stamp": stamp, **texts, **numbers, **arrays}
    return json.dumps({"title": "seaclutter.Diagnostics", "type": "object", "properties": properties})


@cache
def diagnostics_format(cloud_encoding: str) -> tuple[str, Schema, Callable[[Diagnostics], bytes]]:
    """Return the message encoding, schema and serialiser for a log, given the encoding of its clouds."""
    json_schema = lambda: ("seaclutter.Diagnostics", _json_schema())
    encoding, schema = companion_format(cloud_encoding, TYPE, _typestore, json_schema)
    return encoding, schema, {"cdr": _cdr, "ros1": _ros1, "json": _json}[encoding]


def read_diagnostics(data: Buffer, encoding: str) -> Diagnostics:
    """Return the statistics in a diagnostics message.

    Parameters
    ----------
    data : bytes or memoryview
        Bytes of the message.
    encoding : str
        Its encoding: ``cdr``, ``ros1`` or ``json``.

    Raises
    ------
    InputError
        If the bytes are not a valid diagnostics message.
    """
    try:
        if encoding == "json":
            found = json.loads(bytes(data))
            stamp_ns = found["stamp"]["sec"] * _NANO + found["stamp"]["nsec"]
        else:
            store = _typestore()
            found = vars(store.deserialize_cdr(data, TYPE) if encoding == "cdr" else store.deserialize_ros1(data, TYPE))
            stamp_ns = found["stamp"].sec * _NANO + found["stamp"].nanosec
        numbers = {name: int(found[name]) for name in _NUMBERS}
        arrays = {name: np.asarray(found[name], dtype) for name, dtype in _ARRAYS.items()}
        texts = [str(found[name]) for name in ("topic", "scene")]
    except Exception as error:  # the library does not document its errors for invalid bytes
        raise InputError(f"{TOPIC}: invalid message ({error!r})") from error
    return Diagnostics(stamp_ns, texts[0], numbers, arrays, texts[1])
