"""Random access to log files that other programs may truncate or replace.

Files are read, not mapped: touching a mapped page that no longer exists ends the process.
"""

import os
from pathlib import Path
from struct import Struct
from threading import Lock
from typing import Any

from seaclutter_cli.errors import InputError, opening
from seaclutter_cli.paths import open_regular
from seaclutter_cli.records import Bytes

_WINDOW = 16 * 2**10


class LostDataError(InputError):
    """A part of an open file can no longer be read."""

    def __init__(self, path: Path, problem: str) -> None:
        super().__init__(f"{path}: {problem}")
        self.problem = problem


def unpack(layout: Struct, data: Bytes, at: int) -> tuple[Any, ...]:
    """Return the values at an offset."""
    return layout.unpack(data[at : at + layout.size])


class LogFile:
    """A regular file that is read by slices; its size is that at opening. Slices can be taken in any thread.

    At least ``window`` bytes are read, and kept until data elsewhere is read. `InputError` if the file cannot be read,
    or is empty.
    """

    def __init__(self, path: Path, window: int = _WINDOW) -> None:
        self._path, self._least = path, window
        self._lock = Lock()
        with opening(path):
            self._file = open_regular(path)
        self._size = os.fstat(self._file.fileno()).st_size
        self._window = (0, memoryview(b""))
        if not self._size:
            self._file.close()
            raise InputError(f"{path}: the file is empty")

    def __len__(self) -> int:
        """Return the size of the file when it was opened."""
        return self._size

    def __getitem__(self, part: slice) -> memoryview:
        """Return a part of the file; `LostDataError` if it is no longer there."""
        start, stop, _ = part.indices(self._size)
        base, window = self._window
        if not base <= start <= stop <= base + len(window):
            base, window = start, self._read(start, min(max(stop, start + self._least), self._size), stop)
            if stop - start <= self._least:
                self._window = base, window
        return window[start - base : max(stop, start) - base]

    def _read(self, start: int, stop: int, needed: int) -> memoryview:
        """Return the bytes from ``start`` to ``stop``, or at least to ``needed``."""
        pieces = []
        try:
            while start < stop and (piece := self._read_at(start, stop - start)):
                pieces.append(piece)
                start += len(piece)
        except OSError as error:
            raise LostDataError(self._path, f"cannot be read ({error.strerror})") from error
        if start < needed:
            raise LostDataError(self._path, "the file was truncated while it was read")
        return memoryview(pieces[0] if len(pieces) == 1 else b"".join(pieces))

    def _read_at(self, start: int, size: int) -> bytes:
        if hasattr(os, "pread"):
            return os.pread(self._file.fileno(), size, start)
        with self._lock:  # Windows
            self._file.seek(start)
            return self._file.read(size)

    def close(self) -> None:
        """Close the file."""
        self._file.close()
