"""Messages that are added to a log, in an encoding that matches its clouds: one content, three encodings."""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from seaclutter_cli.messages.serialisation import NANO
from seaclutter_cli.records import Schema

Content = Mapping[str, Any]
"""Values of a message by field: numbers, strings, arrays, `Time`, and lists and mappings of these."""


@dataclass(frozen=True, slots=True)
class Time:
    """A time or duration in nanoseconds; outside the range of ROS times it is clipped."""

    ns: int


def companion_format(
    cloud_encoding: str, kind: str, typestore: Callable[[], Any], json_schema: Callable[[], Content]
) -> tuple[str, Schema, Callable[[Content], bytes]]:
    """Return the message encoding, schema and serialiser for a log, given the encoding of its clouds.

    Messages in ROS logs must use a ROS encoding, otherwise players and readers reject the log; other logs get JSON. The
    message has a ROS type (``package/msg/Name``) in a type store of ``rosbags``, and a JSON schema whose title is its
    name.
    """
    if cloud_encoding not in ("cdr", "ros1"):
        schema = json_schema()
        return "json", Schema(schema["title"], "jsonschema", json.dumps(schema).encode()), _json
    store, version = typestore(), 2 if cloud_encoding == "cdr" else 1
    text = store.generate_msgdef(kind, ros_version=version)[0].encode()
    schema_name = kind if version == 2 else kind.replace("/msg", "")
    serialise, least_s = (store.serialize_cdr, -(2**31)) if version == 2 else (store.serialize_ros1, 0)

    def ros(content: Content) -> bytes:
        return bytes(serialise(_message(store, content, kind, least_s), kind))

    return cloud_encoding, Schema(schema_name, f"ros{version}msg", text), ros


def _json(content: Content) -> bytes:
    values = content.items()
    # JSON has no NaN.
    finite = {name: None if isinstance(value, float) and not math.isfinite(value) else value for name, value in values}
    return json.dumps(finite, default=_plain).encode()


def _plain(value: Any) -> Any:
    if isinstance(value, Time):
        seconds, nanoseconds = divmod(value.ns, NANO)
        return {"sec": min(max(seconds, -(2**63)), 2**63), "nsec": nanoseconds}
    return value.tolist()


def _message(store: Any, content: Any, kind: str, least_s: int) -> Any:
    """Return the content of a message as an object of the type store."""
    from rosbags.interfaces import Nodetype

    if isinstance(content, Time):
        seconds, nanoseconds = divmod(content.ns, NANO)
        seconds = min(max(seconds, least_s), least_s + 2**32 - 1)
        # The type store has only the signed time of ROS 2; the bytes are the same.
        return store.types[kind](seconds - 2**32 if seconds >= 2**31 else seconds, nanoseconds)
    values = {}
    for field, (base, detail) in store.fielddefs[kind][1]:
        value = content[field]
        if base == Nodetype.NAME:
            value = _message(store, value, detail, least_s)
        elif base == Nodetype.SEQUENCE and detail[0][0] == Nodetype.NAME:
            value = [_message(store, item, detail[0][1], least_s) for item in value]
        values[field] = value
    return store.types[kind](**values)
