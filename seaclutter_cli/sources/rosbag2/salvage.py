"""Search for the readable messages of a damaged sqlite3 file."""

import sqlite3
import sys
from array import array
from contextlib import suppress

BROKEN = (sqlite3.Error, MemoryError, OverflowError, UnicodeError)
"""Errors that sqlite3 raises on a damaged file."""

_QUERY = "SELECT rowid, CASE typeof(timestamp) WHEN 'integer' THEN timestamp END FROM messages NOT INDEXED"
_MAX_MISSES = 100_000


class FoundRows:
    """Rows found in the messages table; each takes 16 bytes.

    Attributes
    ----------
    numbers, times : array of int
        Number and time in nanoseconds of each readable row.
    missing : int or None
        Number of rows that cannot be read; None if it is unknown.
    """

    def __init__(self, database: sqlite3.Connection) -> None:
        self.numbers = array("q")
        self.times = array("q")
        self.missing: int | None = 0
        self._database = database

    def scan(self, order: str, above: int) -> bool:
        """Add the rows above a number, from one end of the table on; return whether all of them can be read."""
        last = None
        with suppress(*BROKEN):
            for number, time_ns in self._database.execute(f"{_QUERY} ORDER BY rowid {order}"):
                if last is not None and (number > last) != (order == "ASC"):
                    return False
                if number <= above and order == "DESC":
                    return True
                last = number
                self._add(number, time_ns)
            return True
        return False

    def probe(self, first: int, end: int) -> None:
        """Add the readable rows of a range of numbers; stop after a long series of missing rows."""
        misses = 0
        for number in range(first, end):
            misses += 1
            with suppress(*BROKEN):
                for found in self._database.execute(f"{_QUERY} WHERE rowid = ?", (number,)):
                    self._add(*found)
                    misses = 0
            if misses > _MAX_MISSES:
                return

    def _add(self, number: int, time_ns: object) -> None:
        if isinstance(time_ns, int):
            self.numbers.append(number)
            self.times.append(time_ns)


def find_rows(database: sqlite3.Connection) -> FoundRows:
    """Return the readable rows, searched from both ends of the table, and between them one by one."""
    rows = FoundRows(database)
    if rows.scan("ASC", 0):
        return rows
    count = len(rows.numbers)
    last = rows.numbers[-1] if count else 0
    rows.scan("DESC", last)
    end_found = len(rows.numbers) > count
    rows.probe(last + 1, rows.numbers[-1] if end_found else sys.maxsize)
    total = _indexed(database)
    if total is None and end_found:
        # The recorder numbers its messages from 1.
        total = max(rows.numbers)
    rows.missing = None if total is None else max(total - len(rows.numbers), 0)
    return rows


def _indexed(database: sqlite3.Connection) -> int | None:
    """Return the number of messages in the index of their times; None if it is damaged or missing."""
    with suppress(*BROKEN):
        query = "SELECT count(*) FROM messages INDEXED BY timestamp_idx WHERE timestamp IS NOT NULL"
        return int(database.execute(query).fetchone()[0])
    return None
