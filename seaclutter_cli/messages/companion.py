"""Encodings of messages that are added to a log, chosen to match the encoding of its clouds."""

from collections.abc import Callable
from typing import Any

from seaclutter_cli.records import Schema


def companion_format(
    cloud_encoding: str, kind: str, typestore: Callable[[], Any], json_schema: Callable[[], tuple[str, str]]
) -> tuple[str, Schema]:
    """Return the message encoding and schema for a log, given the encoding of its clouds.

    Messages in ROS logs must use a ROS encoding, otherwise players and readers reject the log; other logs get JSON.

    Parameters
    ----------
    cloud_encoding : str
        Encoding of the clouds.
    kind : str
        ROS name of the message type, as in ``package/msg/Name``.
    typestore : callable
        Returns the ``rosbags`` type store with this type.
    json_schema : callable
        Returns the name and text of its JSON schema.
    """
    if cloud_encoding not in ("cdr", "ros1"):
        name, schema = json_schema()
        return "json", Schema(name, "jsonschema", schema.encode())
    version = 2 if cloud_encoding == "cdr" else 1
    text = typestore().generate_msgdef(kind, ros_version=version)[0].encode()
    return cloud_encoding, Schema(kind if version == 2 else kind.replace("/msg", ""), f"ros{version}msg", text)
