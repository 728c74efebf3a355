"""Copies of objects, fetched by threads while the program does something else."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from typing import IO

from seaclutter_cli.errors import InputError, SeaclutterError, opening
from seaclutter_cli.storage.objects import StoredObject, explained, range_options, store_of

_RANGE = 32 * 2**20
_PIECE = 4 * 2**20
_AT_ONCE = 8
_WAKE_SECONDS = 0.5


class Download:
    """Copies of objects, complete after `wait`.

    Every range is requested with the version of the object, so a copy never mixes two of them. ``files`` are pairs of
    an object and the file that becomes its copy.
    """

    def __init__(self, files: list[tuple[StoredObject, Path]]) -> None:
        self.files = files
        self._error: BaseException | None = None
        self._stopped = False
        for found, path in files:
            with _opened(found, path, "wb"):
                pass
        ranges = [(*file, start) for file in files for start in range(0, file[0].size, _RANGE)]
        self._ranges = iter(ranges)
        self._threads = [Thread(target=self._run, daemon=True) for _ in ranges[:_AT_ONCE]]
        for thread in self._threads:
            thread.start()

    def wait(self) -> None:
        """Return when all copies are complete; raise the error that prevented it."""
        for thread in self._threads:
            while thread.is_alive():
                thread.join(_WAKE_SECONDS)  # lets Windows handle Ctrl-C
        if self._error:
            raise self._error

    def stop(self) -> None:
        """Stop the transfer; a thread that waits for the service writes nothing any more."""
        self._stopped = True

    def _run(self) -> None:
        for found, path, start in self._ranges:
            try:
                self._fetch(found, path, start)
            except BaseException as error:  # noqa: BLE001 - it must not get lost with the thread
                failed = InputError(f"{found.url}: the copy failed ({type(error).__name__})")
                self._error = self._error or (error if isinstance(error, SeaclutterError) else failed)
                self._stopped = True
            if self._stopped:
                return

    def _fetch(self, found: StoredObject, path: Path, start: int) -> None:
        at, stop = start, min(start + _RANGE, found.size)
        with explained(found.url):
            result = store_of(found.url).get(found.url.key, options=range_options(found, start, stop))
            pieces = iter(result.stream(_PIECE))
            piece = next(pieces, b"")
        while piece and not self._stopped:
            with _opened(found, path, "r+b") as file:  # not while waiting: some systems do not remove open files
                file.seek(at)
                file.write(piece)
            at += len(piece)
            with explained(found.url):
                piece = next(pieces, b"")
        if not self._stopped and (at != stop or result.meta["size"] != found.size):
            raise InputError(f"{found.url}: the object changed while it was read")


@contextmanager
def _opened(found: StoredObject, path: Path, mode: str) -> Iterator[IO[bytes]]:
    with opening(found.url, problem="the copy in the scratch folder failed"), path.open(mode) as file:
        yield file
