"""ROS 2 recordings (rosbag2): folders with storage files, in sqlite3 or MCAP, and a ``metadata.yaml``."""

import re
import sqlite3
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from seaclutter_cli.errors import OutputError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.messages.metadata import to_custom_data
from seaclutter_cli.records import Buffer, Channel
from seaclutter_cli.sinks.atomic import AtomicFolder, OutputGroup
from seaclutter_cli.sinks.log_output import LogOutput, LogWriter
from seaclutter_cli.sinks.mcap_writer import McapWriter, mcap_compression
from seaclutter_cli.sinks.options import ROSBAG2_METADATA

_VERSION = 8
"""Version of the metadata: that of ROS 2 Iron, which older and newer releases read."""

_POLICIES: Mapping[str, Sequence[str]] = {
    "history": ("system_default", "keep_last", "keep_all", "unknown"),
    "reliability": ("system_default", "reliable", "best_effort", "unknown", "best_available"),
    "durability": ("system_default", "transient_local", "volatile", "unknown", "best_available"),
    "liveliness": ("system_default", "automatic", "manual_by_node", "manual_by_topic", "unknown", "best_available"),
}
"""Policies of quality of service that ROS 2 has numbered until this version, and named since."""
_NAMED_POLICY = re.compile(rf"\b({'|'.join(_POLICIES)}): *([a-z_]+)")

_TABLES = """
CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);
CREATE TABLE metadata(id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL, metadata TEXT NOT NULL);
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
  serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL, type_description_hash TEXT NOT NULL);
CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL, encoding TEXT NOT NULL,
  encoded_message_definition TEXT NOT NULL, type_description_hash TEXT NOT NULL);
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL,
  data BLOB NOT NULL);
INSERT INTO schema(schema_version, ros_distro) VALUES (4, '');
"""


class Db3Output(LogOutput):
    """ROS 2 recordings in sqlite3 files: folders that also have a ``metadata.yaml``."""

    encoding = "cdr"
    joins_publishers = True
    storage, suffix = "sqlite3", ".db3"

    def __init__(self, path: Path, group: OutputGroup | None = None, *, split: bool = False) -> None:  # noqa: ARG002
        self._folder = AtomicFolder(path, group, last=ROSBAG2_METADATA)
        self._files: dict[str, LogWriter] = {}

    def part(self, source: Source, compression: str | None) -> LogWriter:
        """Return the writer of the next storage file."""
        name = f"{self._folder.path.name}_{len(self._files)}{self.suffix}"
        writer = self._files[name] = self._start(name, source, compression)
        return writer

    def _start(self, name: str, source: Source, compression: str | None) -> LogWriter:  # noqa: ARG002
        return _Db3Writer(self._folder.part / name, self._folder.path)

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if error is not None:
            self._folder.__exit__(kind, error, trace)
            return
        with self._folder, self._folder.open(ROSBAG2_METADATA) as file:
            file.write(_description(self.storage, self._files).encode())


class McapFolderOutput(Db3Output):
    """ROS 2 recordings in MCAP files."""

    storage, suffix = "mcap", ".mcap"

    def _start(self, name: str, source: Source, compression: str | None) -> LogWriter:
        stream = self._folder.open(name)
        return _McapFileWriter(stream, profile="ros2", compression=mcap_compression(source, compression))


class _McapFileWriter(McapWriter):
    def add_channel(self, channel: Channel) -> None:
        super().add_channel(_with_numbers(channel))

    def finish(self) -> None:
        super().finish()
        self._stream.close()
        self._summary.clear()  # this object is kept for what it counted

    def abort(self) -> None:
        super().abort()
        self._stream.close()


class _Db3Writer(LogWriter):
    """Writer for a new sqlite3 file of a recording, with the schema that ROS 2 has had since Iron."""

    def __init__(self, path: Path, target: Path) -> None:
        super().__init__()
        self._target = target
        self._types: set[str] = set()
        # Without a journal, since an incomplete file never gets its name; one transaction, which needs little memory.
        self._db = sqlite3.connect(path, isolation_level=None, cached_statements=8)
        self._run("PRAGMA journal_mode=OFF")
        self._run("PRAGMA synchronous=OFF")
        self._run("BEGIN")
        for statement in _TABLES.split(";")[:-1]:
            self._run(statement)

    def add_channel(self, channel: Channel) -> None:
        self.channels[channel.id] = channel = _with_numbers(channel)
        assert channel.schema is not None  # noqa: S101 - translated channels have one
        topic, schema = _topic(channel), channel.schema
        self._run("INSERT INTO topics VALUES (?, ?, ?, ?, ?, ?)", (channel.id, *topic.values()))
        if schema.name not in self._types:
            self._types.add(schema.name)
            values = schema.name, schema.encoding, schema.data.decode("utf-8", "replace")
            hashed = topic["type_description_hash"]
            self._run("INSERT INTO message_definitions VALUES (NULL, ?, ?, ?, ?)", (*values, hashed))

    def put(self, channel: int, times_ns: tuple[int, int], sequence: int, data: Buffer) -> None:  # noqa: ARG002
        log_time_ns = times_ns[0]
        if not 0 <= log_time_ns < 2**63:
            raise OutputError(f"{self._target}: a ROS 2 bag cannot contain the log time {log_time_ns} ns")
        self._run("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", (channel, log_time_ns, data))

    def finish(self) -> None:
        text = _to_yaml({"custom_data": to_custom_data(self.metadata)})
        self._run("INSERT INTO metadata (metadata_version, metadata) VALUES (?, ?)", (_VERSION, text))
        self._run("CREATE INDEX timestamp_idx ON messages (timestamp ASC)")
        self._run("COMMIT")
        self._db.close()

    def abort(self) -> None:
        self._db.close()

    def _run(self, statement: str, values: Sequence[object] = ()) -> None:
        try:
            self._db.execute(statement, values)
        except sqlite3.Error as error:
            raise OutputError(f"{self._target}: writing failed ({error}); the incomplete folder was removed") from error


def _with_numbers(channel: Channel) -> Channel:
    """Return a channel whose quality of service has numbers instead of names."""

    def numbered(match: re.Match[str]) -> str:
        policy, name = match.groups()
        return f"{policy}: {_POLICIES[policy].index(name)}" if name in _POLICIES[policy] else match[0]

    kept = dict(channel.metadata)
    if "offered_qos_profiles" not in kept:
        return channel
    profiles = _NAMED_POLICY.sub(numbered, kept["offered_qos_profiles"])
    return replace(channel, metadata=tuple({**kept, "offered_qos_profiles": profiles}.items()))


def _description(storage: str, files: Mapping[str, LogWriter]) -> str:
    """Return the content of ``metadata.yaml``, given the writers of the storage files by name."""
    writers = list(files.values())
    counts = sum((writer.counts for writer in writers), Counter[int]())
    channels = {number: channel for writer in writers for number, channel in writer.channels.items()}
    start_ns, end_ns = min(writer.start_ns for writer in writers), max(writer.end_ns for writer in writers)
    information = {
        "version": _VERSION,
        "storage_identifier": storage,
        **_span(start_ns, end_ns, counts.total()),
        "topics_with_message_count": [
            {"topic_metadata": _topic(channel), "message_count": counts[number]} for number, channel in channels.items()
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": list(files),
        "files": [{"path": name, **_span(one.start_ns, one.end_ns, one.messages)} for name, one in files.items()],
        "custom_data": to_custom_data(writers[0].metadata) or None,
        "ros_distro": "",
    }
    return _to_yaml({"rosbag2_bagfile_information": information})


def _span(start_ns: int, end_ns: int, messages: int) -> dict[str, Any]:
    return {
        "starting_time": {"nanoseconds_since_epoch": min(start_ns, 2**63 - 1)},
        "duration": {"nanoseconds": max(end_ns - start_ns, 0)},
        "message_count": messages,
    }


def _topic(channel: Channel) -> dict[str, str]:
    metadata = dict(channel.metadata)
    return {
        "name": channel.topic,
        "type": channel.schema.name if channel.schema else "",
        "serialization_format": channel.message_encoding,
        "offered_qos_profiles": metadata.get("offered_qos_profiles", ""),
        "type_description_hash": metadata.get("topic_type_hash", ""),
    }


def _to_yaml(values: Mapping[str, Any]) -> str:
    return str(yaml.safe_dump(values, sort_keys=False, allow_unicode=True, width=10**6))
