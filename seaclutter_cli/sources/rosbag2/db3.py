"""ROS 2 recordings in sqlite3 files, of every schema version of rosbag2."""

import sqlite3
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

from seaclutter_cli.documents import DocumentError, load_yaml
from seaclutter_cli.errors import InputError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.limits import CHANNEL_BYTES, above, above_in_file, limits
from seaclutter_cli.messages.definitions import full_name, ros2_schema
from seaclutter_cli.messages.metadata import from_custom_data
from seaclutter_cli.records import Channel, Message, Metadata, Record, Schema
from seaclutter_cli.sources.rosbag2.database import BROKEN, has_table, latest_row, open_database, read_rows
from seaclutter_cli.sources.shared.unpacking import is_large, unpack_message, unpacked_file

_USUAL_ENCODING = "cdr"  # also if none is stated: not every program that writes recordings states it
# Optional columns of topics, and their names in rosbag2's MCAP storage.
_METADATA = {"offered_qos_profiles": "offered_qos_profiles", "type_description_hash": "topic_type_hash"}

_COUNT = "SELECT topic_id, count(*) FROM messages"


class Db3Source(Source):
    """One sqlite3 storage file of rosbag2; `InputError` if its topics cannot be read.

    A file that is compressed as a whole (``.db3.zstd``) is unpacked to a temporary file, which `close` removes.
    """

    format = "ROS 2 bag (sqlite3)"
    channels: Sequence[Channel] = ()

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.name = path.name.removesuffix(".zstd").removesuffix(".db3")
        self.compression = "zstd" if path.suffix == ".zstd" else None
        self._path = path
        with ExitStack() as stack:
            file = stack.enter_context(unpacked_file(path, self.damage))
            try:
                self._db = open_database(file, stack)
                self._channels = self._read_channels()
                self.channels = list(self._channels.values())
                self.metadata = self._read_metadata()
            except BROKEN as error:
                raise InputError(f"{path}: not a readable ROS 2 recording: {error}") from error
            self._stack = stack.pop_all()
        self._at_opening = len(self.damage)

    @property
    def counts(self) -> dict[int, int]:
        """Messages per channel id; empty if damage prevents counting."""
        with suppress(*BROKEN):
            found = dict(self._db.execute(f"{_COUNT} GROUP BY topic_id"))
            return {channel: found.get(channel, 0) for channel in self._channels}
        return {}

    def records(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Record]:
        """Yield metadata, then the messages with log times in ``[start_ns, end_ns)`` in order; can be called again."""
        yield from self.metadata
        self.restore_damage(self.damage[: self._at_opening])
        size = self._path.stat().st_size
        lost, large, most = 0, 0, limits().bytes_of("message", size)
        try:
            for _, time_ns, topic, data in read_rows(self._db, self._report, start_ns, end_ns):
                if (message := self._message(time_ns, topic, data, most)) is not None:
                    yield message
                elif is_large(data, most):
                    large += 1
                else:
                    lost += 1
        finally:
            if lost:
                self._report("messages that are damaged or of unknown topics", lost)
            if large:
                self._report(f"messages of {above_in_file('more bytes', 'message', size)}", large)

    def skipped(self, start_ns: int) -> Mapping[int, int]:
        """Return the number of messages per channel id before ``start_ns``; empty if damage prevents counting."""
        with suppress(*BROKEN):
            return dict(self._db.execute(f"{_COUNT} WHERE timestamp < ? GROUP BY topic_id", (start_ns,)))
        return {}

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """Log times of the first and the last message; None if damage prevents finding them."""
        with suppress(*BROKEN):
            first, last = self._db.execute("SELECT min(timestamp), max(timestamp) FROM messages").fetchone()
            return (first, last) if isinstance(first, int) and isinstance(last, int) else None
        return None

    def latest(self, channels: Collection[int], before_ns: int) -> list[Message]:
        """Return the last message before a time of each of some channels; none where damage prevents finding it."""
        found, most = [], limits().bytes_of("message", self._path.stat().st_size)
        for channel in channels:
            with suppress(*BROKEN):
                row = latest_row(self._db, channel, before_ns)
                message = self._message(*row[1:], most) if row else None
                found += [message] if message else []
        return sorted(found, key=lambda message: (message.log_time_ns, message.channel.id))

    def close(self) -> None:
        """Close the file, and remove the temporary file."""
        self._stack.close()

    def _message(self, time_ns: Any, topic: Any, data: Any, most: int) -> Message | None:
        """Return the message of a row; None if the row is not valid, or its data have more than ``most`` bytes."""
        channel = self._channels.get(topic)
        if channel is None or not isinstance(time_ns, int) or time_ns < 0 or not isinstance(data, bytes):
            return None
        unpacked = unpack_message(data, most)
        return None if unpacked is None else Message(channel, time_ns, time_ns, 0, unpacked)

    def _report(self, problem: str, lost_messages: int | None) -> None:
        if lost_messages is None:
            problem += "; the number of lost messages is unknown"
        self.report(problem, 0, lost_messages, path=self._path)

    def _read_channels(self) -> dict[int, Channel]:
        if not (has_table(self._db, "topics") and has_table(self._db, "messages")):
            raise InputError(f"{self._path}: not a ROS 2 recording: the database has no tables of topics and messages")
        columns = {row[1] for row in self._db.execute("PRAGMA table_info(topics)")}
        extra = [column for column in _METADATA if column in columns]
        definitions = self._read_definitions()
        channels = {}
        rows = self._texts(f"SELECT {', '.join(('rowid, name, type, serialization_format', *extra))} FROM topics")  # noqa: S608
        for number, *texts in rows:
            topic, typename, encoding, *values = map(str, texts)
            schema = self._schema(topic, typename, definitions)
            metadata = tuple((_METADATA[name], text) for name, text in zip(extra, values, strict=True) if text)
            channels[number] = Channel(number, topic, encoding or _USUAL_ENCODING, schema, metadata)
        return channels

    def _read_definitions(self) -> dict[str, Schema]:
        """Return the message definitions in the file; recorders store them since ROS 2 Iron."""
        query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions ORDER BY rowid"
        if not has_table(self._db, "message_definitions"):
            return {}
        try:
            rows = self._texts(query)
        except BROKEN:
            return {}
        return {row[0]: Schema(row[0], row[1], row[2].encode()) for row in rows if all(map(_is_text, row))}

    def _read_metadata(self) -> Sequence[Metadata]:
        """Return the records of this program in the custom data of the recording."""
        columns = {row[1] for row in self._db.execute("PRAGMA table_info(metadata)")}
        if not has_table(self._db, "metadata") or "metadata" not in columns:
            return ()
        try:
            rows = self._texts("SELECT metadata FROM metadata ORDER BY rowid DESC LIMIT 1")
            document = load_yaml(rows[0][0]) if rows and _is_text(rows[0][0]) else None
        except (*BROKEN, DocumentError):
            return ()
        return from_custom_data(document.get("custom_data")) if isinstance(document, dict) else ()

    def _texts(self, query: str) -> list[tuple[Any, ...]]:
        """Return the rows of a query, which must not exceed the limit of declarations."""
        room, rows = limits().message_bytes, []
        before = self._db.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, room)
        try:
            for row in self._db.execute(query):
                room -= CHANNEL_BYTES + sum(len(value) for value in row if isinstance(value, str | bytes))
                if room < 0:
                    raise sqlite3.DataError(f"topics and definitions of {above('more bytes', 'message_mib')}")
                rows.append(row)
        finally:
            self._db.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, before)
        return rows

    def _schema(self, topic: str, typename: str, definitions: dict[str, Schema]) -> Schema:
        typename = full_name(typename)
        if typename in definitions:
            return definitions[typename]
        try:
            return ros2_schema(typename)
        except KeyError:
            self.warnings.append(f"{topic}: the definition of {typename} is unknown; the output will lack it")
            return Schema(typename, "ros2msg", b"")


def _is_text(value: object) -> bool:
    return isinstance(value, str) and value != ""
