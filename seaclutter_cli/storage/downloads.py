"""Copies of objects, fetched by a thread while the program does something else."""

import asyncio
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Thread
from typing import IO

from seaclutter_cli.errors import InputError, SeaclutterError
from seaclutter_cli.storage.objects import StoredObject, range_options
from seaclutter_cli.storage.stores import explained, store_of

_RANGE = 32 * 2**20
_PIECE = 4 * 2**20
_AT_ONCE = 4
_STOP_SECONDS = 10
_WAKE_SECONDS = 0.5


class Download:
    """Copies of objects, complete after `wait`.

    Every range is requested with the version of the object, so a copy never mixes two of them. ``files`` are pairs of
    an object and the file that becomes its copy.
    """

    def __init__(self, files: list[tuple[StoredObject, Path]]) -> None:
        self.files = files
        self._result: Future[None] = Future()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._task: asyncio.Task[None] | None = None
        self._stopped = False
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    def wait(self) -> None:
        """Return when all copies are complete; raise the error that prevented it."""
        while not self._result.done():
            with suppress(TimeoutError):
                self._result.exception(_WAKE_SECONDS)  # lets Windows handle Ctrl-C
        self._result.result()

    def stop(self) -> None:
        """Stop the transfer."""
        self._stopped = True
        if self._loop is not None and self._task is not None:
            with suppress(RuntimeError):  # the loop has ended
                self._loop.call_soon_threadsafe(self._task.cancel)
        self._thread.join(_STOP_SECONDS)

    def _run(self) -> None:
        try:
            asyncio.run(self._fetch_all())
        except SeaclutterError as error:
            self._result.set_exception(error)
        except BaseException as error:  # noqa: BLE001 - it must not get lost with the thread
            text = f"{self.files[0][0].url}: the copy failed ({type(error).__name__})"
            self._result.set_exception(InputError(text))
        else:
            self._result.set_result(None)

    async def _fetch_all(self) -> None:
        self._loop, self._task = asyncio.get_running_loop(), asyncio.current_task()
        if self._stopped:
            return
        limit, tasks = asyncio.Semaphore(_AT_ONCE), []
        for found, path in self.files:
            with _opened(found, path, "wb"):
                ranges = range(0, found.size, _RANGE)
            tasks += [asyncio.ensure_future(_fetch(found, start, path, limit)) for start in ranges]
        try:
            await asyncio.gather(*tasks)
        finally:
            for task in tasks:
                task.cancel()


async def _fetch(found: StoredObject, start: int, path: Path, limit: asyncio.Semaphore) -> None:
    """Copy a range of an object."""
    stop = min(start + _RANGE, found.size)
    options = range_options(found, start, stop)
    at = start
    async with limit:
        with explained(found.url):
            result = await store_of(found.url).get_async(found.url.key, options=options)
            pieces = result.stream(_PIECE)
        with _opened(found, path, "r+b") as file:
            file.seek(start)
            while True:
                with explained(found.url):
                    piece = await anext(pieces, b"")
                if not piece:
                    break
                file.write(piece)
                at += len(piece)
    if at != stop or result.meta["size"] != found.size:
        raise InputError(f"{found.url}: the object changed while it was read")


@contextmanager
def _opened(found: StoredObject, path: Path, mode: str) -> Iterator[IO[bytes]]:
    try:
        with path.open(mode) as file:
            yield file
    except OSError as error:
        raise InputError(f"{found.url}: the copy in the scratch folder failed ({error.strerror})") from error
