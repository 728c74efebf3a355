"""Compression in other threads, with results in order."""

from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Generic, TypeVar

from seaclutter_cli.threads import executor, threads

if TYPE_CHECKING:
    from concurrent.futures import Future

T = TypeVar("T")
R = TypeVar("R")

_MAX_THREADS = 4


class Compressor(Generic[T, R]):
    """Threads that compress items; ``done`` receives each item and its result, in the thread of the caller.

    The results come in the order of the items, whatever the number of threads.
    """

    def __init__(self, compress: Callable[[T], R], done: Callable[[T, R], None]) -> None:
        workers = min(_MAX_THREADS, threads())
        self._pool = executor(workers, "compress")
        self._compress, self._done = compress, done
        self._pending: deque[tuple[T, Future[R]]] = deque()
        self._max_pending = workers + 1 if workers > 1 else 0

    def submit(self, item: T) -> None:
        """Begin with an item; wait for the first one if too many are pending."""
        self._pending.append((item, self._pool.submit(self._compress, item)))
        if len(self._pending) > self._max_pending:
            self._next()

    def drain(self) -> None:
        """Wait for all items."""
        while self._pending:
            self._next()

    def finish(self) -> None:
        """Wait for all items, and end the threads."""
        self.drain()
        self._pool.shutdown()

    def abort(self) -> None:
        """End the threads without waiting for the results."""
        self._pool.shutdown(cancel_futures=True)

    def _next(self) -> None:
        item, future = self._pending.popleft()
        self._done(item, future.result())
