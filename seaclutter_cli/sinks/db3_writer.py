"""Writer for the sqlite3 files of rosbag2, with the schema that ROS 2 has had since Iron."""

import sqlite3
from collections.abc import Sequence
from pathlib import Path

from seaclutter_cli.errors import OutputError
from seaclutter_cli.messages.metadata import to_custom_data
from seaclutter_cli.records import Buffer, Channel, Metadata
from seaclutter_cli.sinks.rosbag2_metadata import VERSION, to_yaml
from seaclutter_cli.storage.locations import Location

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


class Db3Writer:
    """Storage in one sqlite3 file.

    Parameters
    ----------
    path : Path
        New file.
    target : Path or Url
        Recording to which it belongs, for messages.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """

    def __init__(self, path: Path, target: Location) -> None:
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
        """Declare a channel under its own id, before its first message."""
        assert channel.schema is not None  # noqa: S101 - translated channels have one
        metadata, schema = dict(channel.metadata), channel.schema
        checksum, qos = metadata.get("topic_type_hash", ""), metadata.get("offered_qos_profiles", "")
        row = (channel.id, channel.topic, schema.name, channel.message_encoding, qos, checksum)
        self._run("INSERT INTO topics VALUES (?, ?, ?, ?, ?, ?)", row)
        if schema.name not in self._types:
            self._types.add(schema.name)
            columns = "(topic_type, encoding, encoded_message_definition, type_description_hash)"
            text = schema.data.decode("utf-8", "replace")
            self._run(
                f"INSERT INTO message_definitions {columns} VALUES (?, ?, ?, ?)",  # noqa: S608 - no values
                (schema.name, schema.encoding, text, checksum),
            )

    def write(self, channel: int, log_time_ns: int, data: Buffer) -> None:
        """Write a message of a declared channel."""
        if not 0 <= log_time_ns < 2**63:
            raise OutputError(f"{self._target}: a ROS 2 bag cannot contain the log time {log_time_ns} ns")
        self._run("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", (channel, log_time_ns, data))

    def finish(self, metadata: Sequence[Metadata]) -> None:
        """Write the metadata records, and the index of times."""
        text = to_yaml({"custom_data": to_custom_data(metadata)})
        self._run("INSERT INTO metadata (metadata_version, metadata) VALUES (?, ?)", (VERSION, text))
        self._run("CREATE INDEX timestamp_idx ON messages (timestamp ASC)")
        self._run("COMMIT")
        self._db.close()

    def abort(self) -> None:
        """Close the file, which is incomplete."""
        self._db.close()

    def _run(self, statement: str, values: Sequence[object] = ()) -> None:
        try:
            self._db.execute(statement, values)
        except sqlite3.Error as error:
            raise OutputError(f"{self._target}: writing failed ({error}); the incomplete folder was removed") from error
