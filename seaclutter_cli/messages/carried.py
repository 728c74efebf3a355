"""Metadata records as text, for logs that have no such records."""

import json
from collections.abc import Sequence

from seaclutter_cli.documents import DocumentError, load_json
from seaclutter_cli.records import Metadata

TOPIC = "/seaclutter/metadata"
"""Topic of the message with the metadata records in a ROS 1 bag."""


def to_text(metadata: Sequence[Metadata]) -> str:
    """Return metadata records as JSON."""
    return json.dumps({"metadata": [{"name": one.name, "entries": one.entries} for one in metadata]}, indent=1)


def from_text(text: str) -> list[Metadata]:
    """Return the metadata records in a text of `to_text`; none if it is something else."""
    try:
        return [
            Metadata(str(one["name"]), {str(key): str(value) for key, value in one["entries"].items()})
            for one in load_json(text)["metadata"]
        ]
    except (DocumentError, KeyError, TypeError, AttributeError):
        return []
