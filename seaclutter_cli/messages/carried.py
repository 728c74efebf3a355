"""Metadata records as text, for logs that have no such records."""

import json
from collections.abc import Sequence
from contextlib import suppress

from seaclutter_cli.documents import DocumentError, load_json
from seaclutter_cli.records import Buffer, Channel, Metadata

TOPIC = "/seaclutter/metadata"
"""Topic of the message with the metadata records in a ROS 1 bag."""


SIDECAR = "seaclutter.json"
"""Name of the file with the metadata records in a folder of frames."""

STRING = "std_msgs/String"


def to_text(metadata: Sequence[Metadata]) -> str:
    """Return metadata records as JSON."""
    return json.dumps({"metadata": [{"name": one.name, "entries": one.entries} for one in metadata]}, indent=1)


def from_text(text: str | bytes) -> list[Metadata]:
    """Return the metadata records in a text of `to_text`; none if it is something else."""
    try:
        return [
            Metadata(str(one["name"]), {str(key): str(value) for key, value in one["entries"].items()})
            for one in load_json(text)["metadata"]
        ]
    except (DocumentError, KeyError, TypeError, AttributeError):
        return []


def is_carrier(channel: Channel) -> bool:
    """Return whether a channel of a ROS 1 bag has the messages of `to_message`."""
    return channel.topic == TOPIC and channel.schema is not None and channel.schema.name == STRING


def to_message(metadata: Sequence[Metadata]) -> bytes:
    """Return metadata records as a ROS 1 message with their text."""
    text = to_text(metadata).encode()
    return len(text).to_bytes(4, "little") + text


def from_message(data: Buffer) -> list[Metadata]:
    """Return the metadata records in a message of `to_message`; none if it is something else."""
    return from_text(bytes(data[4:]))


def to_custom_data(metadata: Sequence[Metadata]) -> dict[str, str]:
    """Return metadata records as the custom data of a ROS 2 recording: texts by name, of equal names the last."""
    return {one.name: json.dumps(one.entries) for one in metadata}


def from_custom_data(texts: object) -> list[Metadata]:
    """Return the metadata records in custom data; what is not a record of `to_custom_data` is left out."""
    found: list[Metadata] = []
    for name, text in texts.items() if isinstance(texts, dict) else ():
        with suppress(DocumentError):
            entries = load_json(text) if isinstance(text, str) else None
            if isinstance(entries, dict):
                found.append(Metadata(str(name), {str(key): str(value) for key, value in entries.items()}))
    return found
