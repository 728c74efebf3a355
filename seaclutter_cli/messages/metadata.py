"""Metadata records of filtered logs: what they say about topics, and their form in logs that have no such records."""

import json
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Any

from seaclutter_cli.documents import DocumentError, load_json
from seaclutter_cli.records import Channel, Metadata

METADATA_TOPIC = "/seaclutter/metadata"
"""Topic of the message with the metadata records in a ROS 1 bag."""

SIDECAR = "seaclutter.json"
"""Name of the file with the metadata records in a folder of frames."""

STRING = "std_msgs/String"

RUN = "seaclutter.run"
"""Name of the metadata record of the run that wrote a log."""

TOPICS_RECORD = "seaclutter.topics"
"""Name of the metadata record about topics; its entries are JSON by topic."""

FILTERED, REMOVED, RAW, DIAGNOSTICS = "filtered", "removed", "raw", "diagnostics"


@dataclass(frozen=True)
class RecordedTopic:
    """A topic of a filtered log.

    Its content is ``filtered`` or ``removed`` points, ``raw`` clouds, or ``diagnostics``. ``clouds`` is the topic of
    the raw clouds, ``methods`` filtered them, one for each run. ``first_frame`` is the number of the first frame in the
    recording from which the log was made; ``is_part`` says whether the log was made from a part of it.
    """

    content: str
    clouds: str
    methods: tuple[str, ...] = ()
    first_frame: int = 0
    is_part: bool = False


def to_metadata(topics: Mapping[str, RecordedTopic]) -> Metadata:
    """Return the metadata record about topics."""
    entries = {name: json.dumps(asdict(topic), sort_keys=True) for name, topic in sorted(topics.items())}
    return Metadata(TOPICS_RECORD, entries)


def recorded_topics(metadata: Iterable[Metadata]) -> dict[str, RecordedTopic]:
    """Return what metadata records say about topics; the last record of several runs counts, damaged ones do not."""
    found: dict[str, RecordedTopic] = {}
    for record in metadata:
        if record.name == TOPICS_RECORD:
            found |= {name: topic for name, text in record.entries.items() if (topic := _topic(text))}
    return found


def _topic(text: str) -> RecordedTopic | None:
    with suppress(DocumentError, KeyError, TypeError, ValueError):
        stored: dict[str, Any] = load_json(text)
        content, clouds, first_frame = str(stored["content"]), str(stored["clouds"]), int(stored["first_frame"])
        methods = tuple(map(str, stored["methods"]))
        if first_frame >= 0:
            return RecordedTopic(content, clouds, methods, first_frame, bool(stored["is_part"]))
    return None


def to_text(metadata: Sequence[Metadata]) -> str:
    """Return metadata records as JSON."""
    return json.dumps({"metadata": [{"name": one.name, "entries": one.entries} for one in metadata]}, indent=1)


def from_text(text: str | bytes) -> list[Metadata]:
    """Return the metadata records in a text of `to_text`; none if it is something else."""
    with suppress(DocumentError, KeyError, TypeError, AttributeError):
        return [_metadata(one["name"], one["entries"]) for one in load_json(text)["metadata"]]
    return []


def _metadata(name: object, entries: Mapping[Any, Any]) -> Metadata:
    return Metadata(str(name), {str(key): str(value) for key, value in entries.items()})


def is_carrier(channel: Channel) -> bool:
    """Return whether a channel of a ROS 1 bag has the messages of `to_message`."""
    return channel.topic == METADATA_TOPIC and channel.schema is not None and channel.schema.name == STRING


def to_message(metadata: Sequence[Metadata]) -> bytes:
    """Return metadata records as a ROS 1 message with their text, after its length in four bytes."""
    text = to_text(metadata).encode()
    return len(text).to_bytes(4, "little") + text


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
                found.append(_metadata(name, entries))
    return found
