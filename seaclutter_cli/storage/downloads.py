"""Copies of objects in the scratch folder, fetched by a thread while the program does something else."""

import asyncio
import threading
import weakref
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from io import BufferedRandom
from pathlib import Path

from seaclutter_cli.errors import InputError, SeaclutterError
from seaclutter_cli.storage.failures import explained
from seaclutter_cli.storage.locations import Url
from seaclutter_cli.storage.mirrors import Mirror
from seaclutter_cli.storage.objects import StoredObject, range_options
from seaclutter_cli.storage.scratch import remove_at_end
from seaclutter_cli.storage.stores import store_of

_RANGE = 32 * 2**20
_PIECE = 4 * 2**20
_AT_ONCE = 4
_STOP_SECONDS = 10
_WAKE_SECONDS = 0.5


class Download:
    """Copies of objects below a URL, complete after `wait`.

    Every range is requested with the version of the object, so a copy never mixes two of them. Copies are removed with
    this object, or when the program ends.

    Parameters
    ----------
    base : Url
        Folder of objects that the scratch folder stands for.
    objects : sequence of StoredObject
        Objects to copy.

    Raises
    ------
    InputError
        If they do not fit into the scratch folder.
    """

    def __init__(self, base: Url, objects: Sequence[StoredObject]) -> None:
        self.objects = tuple(objects)
        self.mirror = Mirror(base)
        try:
            self.mirror.folder.require(sum(found.size for found in objects), objects[0].url)
            self._work = _Work([(found, self.mirror.local(found.url)) for found in objects])
        except SeaclutterError:
            self.mirror.folder.remove()
            raise
        thread = threading.Thread(target=self._work.run, daemon=True)
        self.remove = weakref.finalize(self, _stop, self._work, thread, self.mirror.folder.remove)
        """Stop the transfer and remove the copies."""
        remove_at_end(self.remove)
        thread.start()

    def wait(self) -> Mirror:
        """Return the mirror when all copies are complete; raise the error that prevented it."""
        while not self._work.done.wait(_WAKE_SECONDS):  # lets Windows handle Ctrl-C
            pass
        if self._work.error:
            self.remove()
            raise self._work.error
        return self.mirror


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
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
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


def _stop(work: _Work, thread: threading.Thread, remove: Callable[[], object]) -> None:
    work.stopped = True
    if work.loop is not None and work.task is not None:
        with suppress(RuntimeError):  # the loop has ended
            work.loop.call_soon_threadsafe(work.task.cancel)
    thread.join(_STOP_SECONDS)
    remove()


class Prefetcher:
    """Copies of recordings in the order of a run: while one is read, the next is fetched if there is space for both.

    A pickled one forgets the order: a worker process fetches only what it reads.
    """

    def __init__(self) -> None:
        self._order: list[tuple[Url, tuple[StoredObject, ...]]] = []
        self._next: Download | None = None
        self._last: Download | None = None

    def __reduce__(self) -> tuple[type["Prefetcher"], tuple[()]]:
        return Prefetcher, ()

    def add(self, base: Url, objects: tuple[StoredObject, ...]) -> None:
        """Add a recording that will be read after those added before."""
        self._order.append((base, objects))

    def take(self, base: Url, objects: tuple[StoredObject, ...]) -> Download:
        """Return the complete copy of a recording, and begin to fetch the one after it.

        Raises
        ------
        InputError
            If it cannot be copied.
        """
        download: Download | None = None
        for known in filter(None, (self._next, self._last)):
            if download is None and known.objects == objects:
                download = known
            else:
                known.remove()
        self._next = self._last = None
        download = download or Download(base, objects)
        try:
            download.wait()
        except BaseException:
            download.remove()
            raise
        order = [objects for _, objects in self._order]
        at = order.index(objects) + 1 if objects in order else len(order)
        if at < len(order):
            with suppress(SeaclutterError):  # it says so when it is its turn
                self._next = Download(*self._order[at])
        return download

    def give_back(self, download: Download) -> None:
        """Keep a copy that is no longer read until another is taken: commands may read a recording twice."""
        if self._last is not None:
            self._last.remove()
        self._last = download
