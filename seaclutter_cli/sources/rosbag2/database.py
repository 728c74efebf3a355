"""Read-only access to sqlite3 files, intact or damaged."""

import sqlite3
import sys
from array import array
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from shutil import copy
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from seaclutter_cli.limits import limits

BROKEN = (sqlite3.Error, MemoryError, OverflowError, UnicodeError)
"""Errors that sqlite3 raises on a damaged file."""

Row = tuple[int, Any, Any, Any]
"""Number, time in nanoseconds, topic and data of a message.

Time and topic of a damaged row are None; its data are None, or their size if they are above the limit of a message.
"""

# Only whole numbers and data within the limit are loaded; larger data are represented by their size.
_COLUMNS = (
    "rowid, CASE typeof(timestamp) WHEN 'integer' THEN timestamp END, CASE typeof(topic_id) WHEN 'integer' THEN "
    "topic_id END, CASE WHEN typeof(data) <> 'blob' THEN NULL WHEN length(data) > {most} THEN length(data) "
    "ELSE data END FROM messages"
)
_TIMES = "SELECT rowid, CASE typeof(timestamp) WHEN 'integer' THEN timestamp END FROM messages NOT INDEXED"
_INDEXED = "SELECT count(*) FROM messages INDEXED BY timestamp_idx WHERE timestamp IS NOT NULL"
_MAX_MISSES = 100_000
_ANY_TIME = 2**63 - 1
_PROBE = "SELECT name FROM sqlite_master LIMIT 1"
_HANDLER_STEPS = 100_000
_STEPS_LEAST, _STEPS_PER_BYTE = 10_000_000, 50
_HEAP_LEAST, _HEAP_MORE = 192 * 2**20, 32 * 2**20


def open_database(path: Path, stack: ExitStack) -> sqlite3.Connection:
    """Open a database read-only, with the ``-wal`` or ``-journal`` file of a crashed recorder; the stack closes it.

    A single file is opened as immutable, which works in read-only folders and leaves no file next to it.
    """
    beside = [path.with_name(path.name + end) for end in ("-wal", "-journal")]
    beside = [file for file in beside if file.exists() and file.stat().st_size]
    if not beside:
        return _connect(path, "mode=ro&immutable=1", stack)
    with suppress(sqlite3.OperationalError):
        shared = path.with_name(path.name + "-shm")
        if not shared.exists():
            stack.callback(shared.unlink, missing_ok=True)
        return _connect(path, "mode=ro", stack)
    folder = Path(stack.enter_context(TemporaryDirectory(prefix="seaclutter-")))
    for file in (path, *beside):
        copy(file, folder)
    return _connect(folder / path.name, "mode=rw", stack)


class _GuardedConnection(sqlite3.Connection):
    """A connection that interrupts endless statements: pages of a damaged file may refer to one another in circles."""

    def guard(self, size: int) -> None:
        self._most = (_STEPS_LEAST + _STEPS_PER_BYTE * size) // _HANDLER_STEPS
        self._taken = 0
        self.set_progress_handler(self._is_endless, _HANDLER_STEPS)
        heap = max(_HEAP_LEAST, 2 * limits().message_bytes + _HEAP_MORE)
        for setting in ("trusted_schema = OFF", "mmap_size = 0", f"hard_heap_limit = {heap}"):
            super().execute(f"PRAGMA {setting}")

    def execute(self, *arguments: Any) -> sqlite3.Cursor:
        self._taken = 0
        return super().execute(*arguments)

    def _is_endless(self) -> bool:
        self._taken += 1
        return self._taken > self._most


def has_table(database: sqlite3.Connection, name: str) -> bool:
    """Return whether a table exists that only stores data: not a view, not virtual, without computed columns."""
    query = "SELECT type, rootpage FROM sqlite_master WHERE name = ? COLLATE NOCASE AND type IN ('table', 'view')"
    found = database.execute(query, (name,)).fetchmany(2)
    is_stored = len(found) == 1 and found[0][0] == "table" and isinstance(found[0][1], int) and found[0][1] > 0
    return is_stored and not any(row[6] for row in database.execute(f"PRAGMA table_xinfo({name})"))


def _connect(path: Path, options: str, stack: ExitStack) -> sqlite3.Connection:
    address = f"{path.absolute().as_uri()}?{options}"
    database = sqlite3.connect(address, uri=True, check_same_thread=False, factory=_GuardedConnection)
    stack.callback(database.close)
    database.guard(sum(file.stat().st_size for file in (path, path.with_name(path.name + "-wal")) if file.exists()))
    database.text_factory = lambda text: text.decode("utf-8", "replace")
    try:
        database.execute(_PROBE).fetchone()
    except sqlite3.DatabaseError as error:
        if error.sqlite_errorcode != sqlite3.SQLITE_CORRUPT:
            raise
        # With this setting, sqlite3 opens truncated files.
        database.execute("PRAGMA writable_schema=ON")
        database.execute(_PROBE).fetchone()
    return database


def read_rows(
    database: sqlite3.Connection,
    report: Callable[[str, int | None], None],
    start_ns: int | None = None,
    end_ns: int | None = None,
) -> Iterator[Row]:
    """Yield the messages in ``[start_ns, end_ns)`` in time order; from a damaged file, all that can be read.

    Rows are read through the index of their times; if it is damaged, those not yielded yet, of which each has a bit,
    one by one. ``report`` then receives a description of the damage and the number of lost messages, if known.
    """
    seen: defaultdict[int, int] = defaultdict(int)
    bounds = (-_ANY_TIME if start_ns is None else start_ns, _ANY_TIME if end_ns is None else end_ns)
    try:
        for row in _in_time_order(database, bounds if start_ns is not None or end_ns is not None else None):
            block, bit = row[0] >> 10, 1 << (row[0] & 1023)
            if seen[block] & bit:
                raise sqlite3.DatabaseError("the index lists a message twice")
            seen[block] |= bit
            yield row
    except BROKEN as error:
        rows, lost = _FoundRows(database), 0
        try:
            for index in np.lexsort((rows.numbers, rows.times)):
                number = rows.numbers[index]
                if bounds[0] <= rows.times[index] < bounds[1] and not seen[number >> 10] & 1 << (number & 1023):
                    try:
                        yield from _row(database, number).fetchall()
                    except BROKEN:
                        lost += 1
        finally:
            report(f"the database is damaged ({error})", None if rows.missing is None else rows.missing + lost)


def _in_time_order(database: sqlite3.Connection, bounds: tuple[int, int] | None) -> Iterator[Row]:
    inside, given = ("WHERE timestamp >= ? AND timestamp < ?", bounds) if bounds else ("", ())
    query = f"SELECT {_columns()} {inside} ORDER BY timestamp, rowid"
    if not any("TEMP B-TREE" in row[3] for row in database.execute(f"EXPLAIN QUERY PLAN {query}", given)):
        return database.execute(query, given)
    # Without an index of the times, sort the numbers only: sorting rows would copy all data to a temporary file.
    numbers = database.execute(f"SELECT rowid FROM messages {inside} ORDER BY timestamp, rowid", given)  # noqa: S608
    return (row for (number,) in numbers for row in _row(database, number))


def latest_row(database: sqlite3.Connection, topic: int, before_ns: int) -> Row | None:
    """Return the last message of a topic before a time; None if there is none."""
    query = (
        "SELECT rowid FROM messages WHERE topic_id = ? AND timestamp < ? ORDER BY timestamp DESC, rowid DESC LIMIT 1"
    )
    number = database.execute(query, (topic, before_ns)).fetchone()
    return _row(database, number[0]).fetchone() if number else None


def _row(database: sqlite3.Connection, number: int) -> sqlite3.Cursor:
    return database.execute(f"SELECT {_columns()} WHERE rowid = ?", (number,))


def _columns() -> str:
    return _COLUMNS.format(most=limits().message_bytes)


class _FoundRows:
    """Numbers and times in nanoseconds of the readable rows; each takes 16 bytes.

    They are searched from both ends of the table, and between them one by one. ``missing`` is the number of rows that
    cannot be read; None if it is unknown.
    """

    def __init__(self, database: sqlite3.Connection) -> None:
        self.numbers = array("q")
        self.times = array("q")
        self.missing: int | None = 0
        self._database = database
        if self._scan("ASC", 0):
            return
        count = len(self.numbers)
        last = self.numbers[-1] if count else 0
        self._scan("DESC", last)
        end_found = len(self.numbers) > count
        self._probe(last + 1, self.numbers[-1] if end_found else sys.maxsize)
        total = max(self.numbers) if end_found else None  # the recorder numbers its messages from 1
        with suppress(*BROKEN):
            total = int(database.execute(_INDEXED).fetchone()[0])
        self.missing = None if total is None else max(total - len(self.numbers), 0)

    def _scan(self, order: str, above: int) -> bool:
        """Add the rows above a number, from one end of the table on; return whether all of them can be read."""
        last = None
        with suppress(*BROKEN):
            for number, time_ns in self._database.execute(f"{_TIMES} ORDER BY rowid {order}"):
                if last is not None and (number > last) != (order == "ASC"):
                    return False
                if number <= above and order == "DESC":
                    return True
                last = number
                self._add(number, time_ns)
            return True
        return False

    def _probe(self, first: int, end: int) -> None:
        """Add the readable rows of a range of numbers; stop after a long series of missing rows."""
        misses, broken, query = 0, suppress(*BROKEN), f"{_TIMES} WHERE rowid = ?"
        for number in range(first, end):
            misses += 1
            with broken:
                for found in self._database.execute(query, (number,)):
                    self._add(*found)
                    misses = 0
            if misses > _MAX_MISSES:
                return

    def _add(self, number: int, time_ns: object) -> None:
        if isinstance(time_ns, int):
            self.numbers.append(number)
            self.times.append(time_ns)
