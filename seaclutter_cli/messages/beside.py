"""Messages written beside the clouds of a log: in an encoding that its readers know already."""

from collections.abc import Callable
from typing import Any

from seaclutter_cli.records import Schema


def fitting_format(
    cloud_encoding: str, kind: str, typestore: Callable[[], Any], plain: Callable[[], tuple[str, str]]
) -> tuple[str, Schema]:
    """Return message encoding and schema that fit a log whose clouds have an encoding.

    A ROS log must stay one, or its players and readers refuse it; all others get JSON.

    Parameters
    ----------
    cloud_encoding : str
        Encoding of the clouds.
    kind : str
        ROS name of the message, as in ``package/msg/Name``.
    typestore : callable
        Returns the type store of ``rosbags`` that knows it.
    plain : callable
        Returns name and text of its JSON schema.
    """
    if cloud_encoding not in ("cdr", "ros1"):
        name, schema = plain()
        return "json", Schema(name, "jsonschema", schema.encode())
    version = 2 if cloud_encoding == "cdr" else 1
    text = typestore().generate_msgdef(kind, ros_version=version)[0].encode()
    return cloud_encoding, Schema(kind if version == 2 else kind.replace("/msg", ""), f"ros{version}msg", text)
