"""Copies of objects, fetched by a thread while the program does something else."""

import asyncio
import threading
import weakref
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from io import BufferedRandom
from pathlib import Path

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
        self._work = _Work(files)
        thread = threading.Thread(target=self._work.run, daemon=True)
        self.stop = weakref.finalize(self, _stop, self._work, thread)
        """Stop the transfer."""
        thread.start()

    def wait(self) -> None:
        """Return when all copies are complete; raise the error that prevented it."""
        while not self._work.done.wait(_WAKE_SECONDS):  # lets Windows handle Ctrl-C
            pass
        if self._work.error:
            raise self._work.error


@dataclass
class _Work:
    """What the thread does. It has no reference to the download, which ends it."""

    files: list[tuple[StoredObject, Path]]
    done: threading.Event = field(default_factory=threading.Event)
    error: SeaclutterError | None = None
    loop: asyncio.AbstractEventLoop | None = None
    task: "asyncio.Task[None] | None" = None
    stopped: bool = False

    def run(self) -> None:
        try:
            asyncio.run(self._fetch_all())
        except SeaclutterError as error:
            self.error = error
        except BaseException as error:  # noqa: BLE001 - it must not get lost with the thread
            self.error = InputError(f"{self.files[0][0].url}: the copy failed ({type(error).__name__})")
        finally:
            self.done.set()

    async def _fetch_all(self) -> None:
        self.loop, self.task = asyncio.get_running_loop(), asyncio.current_task()
        if self.stopped:
            return
        limit = asyncio.Semaphore(_AT_ONCE)
        tasks = []
        for found, path in self.files:
            _create(found, path)
            for start in range(0, found.size, _RANGE):
                tasks.append(asyncio.ensure_future(_fetch(found, start, path, limit)))  # noqa: PERF401 - reads better
        try:
            await asyncio.gather(*tasks)
        finally:
            for task in tasks:
                task.cancel()


def _create(found: StoredObject, path: Path) -> None:
    try:
        path.write_bytes(b"")
    except OSError as error:
        raise _lost(found, error) from error


async def _fetch(found: StoredObject, start: int, path: Path, limit: asyncio.Semaphore) -> None:
    """Copy a range of an object."""
    stop = min(start + _RANGE, found.size)
    options = range_options(found, start, stop)
    at = start
    async with limit:
        with explained(found.url):
            result = await store_of(found.url).get_async(found.url.key, options=options)
            pieces = result.stream(_PIECE)
        with _opened(found, path) as file:
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
def _opened(found: StoredObject, path: Path) -> Iterator[BufferedRandom]:
    try:
        with path.open("r+b") as file:
            yield file
    except OSError as error:
        raise _lost(found, error) from error


def _lost(found: StoredObject, error: OSError) -> InputError:
    return InputError(f"{found.url}: the copy in the scratch folder failed ({error.strerror})")


def _stop(work: _Work, thread: threading.Thread) -> None:
    work.stopped = True
    if work.loop is not None and work.task is not None:
        with suppress(RuntimeError):  # the loop has ended
            work.loop.call_soon_threadsafe(work.task.cancel)
    thread.join(_STOP_SECONDS)
