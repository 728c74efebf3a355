"""Threads that this process may use, and memory that it keeps."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from threading import Thread
from time import monotonic
from typing import ParamSpec, TypeVar

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

from seaclutter_cli.errors import UsageError

VARIABLE = "SEACLUTTER_THREADS"
"""Environment variable that limits the threads of a process."""

P = ParamSpec("P")
T = TypeVar("T")
R = TypeVar("R")

_WAKE_S = 0.5
_LARGEST_BYTES = 4 * 2**20
_REQUESTS = 8
_QUOTA = Path("/sys/fs/cgroup/cpu.max")


def waited(work: Callable[[], R], most_s: float) -> R:
    """Return the result of work in a thread, or its error; interrupts end the wait. `TimeoutError` if it takes long."""
    future, end = Future[R](), monotonic() + most_s

    def run() -> None:
        try:
            future.set_result(work())
        except BaseException as error:  # noqa: BLE001 - raised in the thread that waits
            future.set_exception(error)

    Thread(target=run, daemon=True).start()
    while not future.done() and monotonic() < end:
        wait([future], min(_WAKE_S, most_s))
    return future.result(0)


def threads() -> int:
    """Return the number of threads that may compute at the same time: the cores of this process, or less.

    It is one where the address space is limited: each thread takes some, and OpenMP ends the process if it cannot start
    one. The environment variable ``SEACLUTTER_THREADS`` sets it, so that processes beside each other share the cores.
    Raise `UsageError` if it is not a positive whole number.
    """
    given = os.environ.get(VARIABLE)
    if given is not None:
        if not (given.isascii() and given.isdigit() and len(given) <= 4 and int(given)):
            raise UsageError(f"{VARIABLE}: expected a positive whole number, got {given[:20]!r}")
        return int(given)
    if resource is not None and resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY:
        return 1
    return cores()


def cores() -> int:
    """Return the number of cores that this process may use, also in a container with a limit."""
    found = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(found, _quota(_QUOTA) or found)


@cache
def _quota(file: Path) -> int | None:
    """Return the limit of the control group in cores, rounded up; None without a limit."""
    try:
        share, period = file.read_text().split()
        return max(1, -(-int(share) // int(period)))
    except (OSError, ValueError):  # not Linux; no limit: "max 100000"
        return None


def executor(workers: int, name: str) -> Executor:
    """Return threads that work beside the caller; where `threads` is one, an executor that works in the caller's."""
    return ThreadPoolExecutor(workers, thread_name_prefix=name) if threads() > 1 else _Inline()


class _Inline(Executor):
    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        future = Future[T]()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # noqa: BLE001 - raised where the result is read
            future.set_exception(error)
        return future


@contextmanager
def abandoned(pool: Executor) -> Iterator[Executor]:
    """Let threads work for a generator; when it ends, what is left is cancelled, and what runs is not waited for.

    Garbage collection may end a generator in any thread, also in one that starts, which cannot wait for another.
    """
    try:
        yield pool
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def in_order(work: Callable[[int], T], count: int, *, workers: int, ahead: int) -> Iterator[T]:
    """Yield the results of ``work`` for the numbers from 0, of which threads compute at most ``ahead`` in advance."""
    pending: deque[Future[T]] = deque()
    with abandoned(executor(workers, "work")) as pool:
        for number in range(count):
            pending.append(pool.submit(work, number))
            if len(pending) >= ahead:
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()


def in_threads(function: Callable[[T], R], items: Iterable[T]) -> list[R]:
    """Return the results of short requests to a disk or network for each item, in their order; an error ends all."""
    with ThreadPoolExecutor(_REQUESTS) as pool:
        return list(pool.map(function, items))


@cache
def keep_freed_memory() -> None:
    """Let the C library keep the memory of a frame for the next one.

    By default, glibc returns it to the system after each frame and gets it back page by page, which costs as much time
    as decoding. It keeps twice as much as the largest block that was freed. An unused block needs no memory itself.
    """
    import numpy as np  # slow to import, not needed by processes that only wait

    try:
        np.empty(_LARGEST_BYTES, np.uint8)
    except MemoryError:  # the address space is limited
        return
