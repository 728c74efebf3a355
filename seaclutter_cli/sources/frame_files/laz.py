"""Points of LAZ files, decompressed in another process.

lazrs does not check all indices, so that damaged points can end its process; if it is another one, only their file is
lost. It also works ahead: the next points are decompressed while these are used.
"""

import atexit
import os
import pickle
import subprocess
import sys
from contextlib import AbstractContextManager, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any, BinaryIO, cast

from seaclutter_cli.errors import CloudError
from seaclutter_cli.sources.frame_files.laz_worker import SIZE

_PROGRAM = Path(__file__).with_name("laz_worker.py")
_Chunks = list[tuple[int, int, int]]
"""Offset, size in bytes and number of points of each chunk."""


class LazBackend(AbstractContextManager["LazBackend"]):
    """Backend and reader of laspy for one LAZ file; the other process works for it until the context exits."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._worker: _Worker | None = None

    def is_available(self) -> bool:
        """Return whether lazrs is installed."""
        return find_spec("lazrs") is not None

    def create_reader(self, source: BinaryIO, header: Any, decompression_selection: Any = None) -> "LazBackend":
        """Start to decompress all points of a file that is open at the first one."""
        del decompression_selection  # all dimensions
        return self.start(header, source.tell(), header.point_count)

    def start(self, header: Any, place: int | _Chunks, points: int) -> "LazBackend":
        """Start to decompress a number of points, which begin at an offset or are those of some chunks."""
        described, self._point_size = header.vlrs.get("LasZipVlr")[0].record_data, header.point_format.size
        self._left, self._read = points * self._point_size, bytearray()
        self._worker = _IDLE.pop() if _IDLE else _Worker()
        self._worker.request((str(self._path.absolute()), place, described, self._point_size, points))
        return self

    def read_n_points(self, n: int) -> bytearray:
        """Return the bytes of the next points."""
        size = n * self._point_size
        while self._worker and len(self._read) < size and self._left:
            block = self._worker.block()
            self._left -= len(block)
            self._read = self._read + block if self._read else block  # in most cases, what is asked for is one block
        read, self._read = self._read[:size], self._read[size:]
        return read

    def __exit__(self, *_: object) -> None:
        """Keep the process for the next file, or end it if it has not answered completely."""
        if self._worker is not None:
            if self._left:
                self._worker.end()
            else:
                _IDLE.append(self._worker)


class _Worker:
    """The other process."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(  # noqa: S603 - fixed arguments
            [sys.executable, "-P", str(_PROGRAM)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        self._requests = cast("BinaryIO", self._process.stdin)
        self._answers = cast("BinaryIO", self._process.stdout)

    def request(self, request: tuple[str, int | _Chunks, bytes, int, int]) -> None:
        with suppress(BrokenPipeError):  # noticed when the answer is read
            pickle.dump(request, self._requests)
            self._requests.flush()

    def block(self) -> bytearray:
        (size,) = SIZE.unpack(self._read(SIZE.size))
        if size < 0:
            raise CloudError(f"the compressed points are damaged: {self._read(-size).decode()}")
        return self._read(size)

    def _read(self, size: int) -> bytearray:
        data = bytearray(size)
        if self._answers.readinto(data) < size:  # type: ignore[attr-defined]
            raise CloudError("the compressed points are damaged; their decoder crashed")
        return data

    def end(self) -> None:
        self._process.kill()
        with suppress(BrokenPipeError):
            self._requests.close()
        self._answers.close()
        self._process.wait()


_IDLE: list[_Worker] = []


@atexit.register
def _end_idle() -> None:
    while _IDLE:
        _IDLE.pop().end()


if hasattr(os, "register_at_fork"):  # a fork must not talk to the processes of its parent
    os.register_at_fork(after_in_child=_IDLE.clear)
