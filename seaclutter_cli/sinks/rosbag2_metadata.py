"""The file ``metadata.yaml`` of a ROS 2 recording."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import yaml

from seaclutter_cli.messages.metadata import to_custom_data
from seaclutter_cli.records import Channel, Metadata

NAME = "metadata.yaml"
VERSION = 8
"""Version of the file: that of ROS 2 Iron, which older and newer releases read."""


@dataclass
class StoredFile:
    """A storage file of a recording.

    Parameters
    ----------
    name : str
        Name of the file.
    start_ns, end_ns : int
        Log times of the first and the last message.
    messages : int
        Number of messages.
    """

    name: str
    start_ns: int = 2**63 - 1
    end_ns: int = 0
    messages: int = 0

    @property
    def _times(self) -> dict[str, Any]:
        duration = {"nanoseconds": max(self.end_ns - self.start_ns, 0)}
        return {"starting_time": {"nanoseconds_since_epoch": self.start_ns}, "duration": duration}

    def as_dict(self) -> dict[str, Any]:
        """Return the entry of the file."""
        return {"path": self.name, **self._times, "message_count": self.messages}

    def totals(self) -> dict[str, Any]:
        """Return the same entries for a recording."""
        return {**self._times, "message_count": self.messages}


@dataclass
class Contents:
    """What the storage files of a recording contain.

    Parameters
    ----------
    storage : str
        Kind of storage: ``sqlite3`` or ``mcap``.
    files : list of StoredFile
        The files.
    channels : dict of int to Channel
        Channels by id.
    counts : counter of int
        Messages by id of the channel.
    metadata : list of Metadata
        Metadata records.
    """

    storage: str
    files: list[StoredFile] = field(default_factory=list)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    metadata: list[Metadata] = field(default_factory=list)

    def count(self, channel: int, log_time_ns: int) -> None:
        """Count a message in the last file."""
        file = self.files[-1]
        file.start_ns, file.end_ns = min(file.start_ns, log_time_ns), max(file.end_ns, log_time_ns)
        file.messages += 1
        self.counts[channel] += 1

    def to_text(self) -> str:
        """Return the content of the file."""
        total = StoredFile("", min(f.start_ns for f in self.files), max(f.end_ns for f in self.files))
        total.messages = self.counts.total()
        information = {
            "version": VERSION,
            "storage_identifier": self.storage,
            **total.totals(),
            "topics_with_message_count": [
                {"topic_metadata": _topic(channel), "message_count": self.counts[number]}
                for number, channel in self.channels.items()
            ],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [file.name for file in self.files],
            "files": [file.as_dict() for file in self.files],
            "custom_data": to_custom_data(self.metadata) or None,
            "ros_distro": "",
        }
        return to_yaml({"rosbag2_bagfile_information": information})


def _topic(channel: Channel) -> dict[str, str]:
    metadata = dict(channel.metadata)
    return {
        "name": channel.topic,
        "type": channel.schema.name if channel.schema else "",
        "serialization_format": channel.message_encoding,
        "offered_qos_profiles": metadata.get("offered_qos_profiles", ""),
        "type_description_hash": metadata.get("topic_type_hash", ""),
    }


def to_yaml(values: Mapping[str, Any]) -> str:
    """Return values as YAML."""
    return str(yaml.safe_dump(values, sort_keys=False, allow_unicode=True, width=10**6))
