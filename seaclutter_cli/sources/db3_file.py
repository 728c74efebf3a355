"""Opening sqlite3 files without writing to them, and reading the messages of damaged ones."""

import sqlite3
import sys
from array import array
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from shutil import copy
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

BROKEN = (sqlite3.Error, MemoryError, OverflowError)
"""What sqlite3 raises over a damaged file."""

Row = tuple[int, Any, Any, Any]
"""Number, time in nanoseconds, topic and data of a message; but for the number, of any type in a damaged file."""

_COLUMNS = "id, timestamp, topic_id, data FROM messages"
_TIMES = "SELECT id, timestamp FROM messages NOT INDEXED"
_MAX_MISSES = 100_000


def open_database(path: Path, stack: ExitStack) -> sqlite3.Connection:
    """Open a database read-only; the stack closes it again.

    Notes
    -----
    A file alone is opened as immutable: in read-only folders too, and with nothing left beside it. Where a crashed
    recorder left a ``-wal`` or ``-journal`` file, what it holds is read as well, in a temporary copy if need be.

    Raises
    ------
    sqlite3.Error
        If it is no database.
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


def _connect(path: Path, options: str, stack: ExitStack) -> sqlite3.Connection:
    database = sqlite3.connect(f"{path.absolute().as_uri()}?{options}", uri=True, check_same_thread=False)
    stack.callback(database.close)
    database.text_factory = lambda text: text.decode("utf-8", "replace")
    database.execute("SELECT count(*) FROM sqlite_master").fetchone()
    return database


def read_rows(database: sqlite3.Connection, report: Callable[[str, int | None], None]) -> Iterator[Row]:
    """Yield the messages in the order of their times, and all that can be read of a damaged file.

    Parameters
    ----------
    database : Connection
        With the tables of rosbag2.
    report : callable
        Takes what is wrong, and the number of lost messages if it is known, once reading ends.

    Notes
    -----
    Rows come through the index over their times. Where that breaks, the rest is looked up row by row.
    """
    seen: defaultdict[int, int] = defaultdict(int)
    try:
        for row in _in_time_order(database):
            seen[row[0] >> 10] |= 1 << (row[0] & 1023)
            yield row
    except BROKEN as error:
        yield from _salvage(database, seen, partial(report, f"the database is damaged ({error})"))


def _in_time_order(database: sqlite3.Connection) -> Iterator[Row]:
    query = f"SELECT {_COLUMNS} ORDER BY timestamp, id"
    if not any("TEMP B-TREE" in row[3] for row in database.execute(f"EXPLAIN QUERY PLAN {query}")):
        return database.execute(query)
    # No index over the times: sort the numbers only, since sorting rows would copy all data to a temporary file.
    numbers = database.execute("SELECT id FROM messages ORDER BY timestamp, id")
    return (row for (number,) in numbers for row in _row(database, number))


def _row(database: sqlite3.Connection, number: int) -> sqlite3.Cursor:
    return database.execute(f"SELECT {_COLUMNS} WHERE id = ?", (number,))


def _salvage(
    database: sqlite3.Connection, seen: defaultdict[int, int], report: Callable[[int | None], None]
) -> Iterator[Row]:
    """Yield the rows that are not seen yet and can be read, in the order of their times."""
    times, numbers = array("q"), array("q")
    for number, time_ns in _listing(database):
        if not seen.get(number >> 10, 0) >> (number & 1023) & 1:
            times.append(time_ns)
            numbers.append(number)
    read = len(numbers) + sum(bits.bit_count() for bits in seen.values())
    lost = max(_expected(database, numbers) - read, 0)
    try:
        for place in np.lexsort((numbers, times)):
            try:
                yield from _row(database, numbers[place]).fetchall()
            except BROKEN:
                lost += 1
    finally:
        report(lost)


def _expected(database: sqlite3.Connection, readable: Sequence[int]) -> int:
    """Return how many messages there should be: by the index over their times, else by their numbers."""
    with suppress(*BROKEN):
        query = "SELECT count(*) FROM messages INDEXED BY timestamp_idx WHERE timestamp IS NOT NULL"
        (count,) = database.execute(query).fetchone()
        return int(count)
    return max(readable, default=0)


def _listing(database: sqlite3.Connection) -> Iterator[tuple[int, int]]:
    """Yield number and time of every row that can be reached: from both ends, and between them one by one."""
    last = 0
    for last, time_ns in _scan(database, "ASC"):
        yield last, time_ns
    first = None
    for number, time_ns in _scan(database, "DESC"):
        if number <= last:
            return
        first = number
        yield number, time_ns
    misses = 0
    for number in range(last + 1, first or sys.maxsize):
        found = _time(database, number)
        if found is not None:
            yield number, found
        misses = 0 if found is not None else misses + 1
        if misses > _MAX_MISSES:
            return


def _scan(database: sqlite3.Connection, order: str) -> Iterator[tuple[int, int]]:
    """Yield number and time of the rows from one end until something is broken."""
    last = None
    with suppress(*BROKEN):
        for number, time_ns in database.execute(f"{_TIMES} ORDER BY id {order}"):
            if last is not None and (number > last) != (order == "ASC"):
                return
            last = number
            if isinstance(time_ns, int):
                yield number, time_ns


def _time(database: sqlite3.Connection, number: int) -> int | None:
    with suppress(*BROKEN):
        for _, time_ns in database.execute(f"{_TIMES} WHERE id = ?", (number,)):
            return time_ns if isinstance(time_ns, int) else None
    return None
