"""Tasks in several processes of this machine, as many as there are cores and memory for."""

import multiprocessing as mp
import os
import signal
import sys
import warnings
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from multiprocessing.connection import Connection, wait
from pathlib import Path
from pickle import PicklingError
from time import monotonic
from typing import Any

from seaclutter_cli.errors import PluginWarning, UsageError
from seaclutter_cli.interrupts import handle_interrupts, ignore_interrupts
from seaclutter_cli.jobs.engine import DIED, ERROR, SHARE, OnShare, R, Results, Task, answer, run_with_retries
from seaclutter_cli.threads import VARIABLE, cores, threads

_NOT_SENT = "the method cannot be sent to other processes; define it in a module or a file, or use one process"
_REPORT_S = 0.2
_END_S = 10.0
_PRELOADED = ["seaclutter_cli.runs.filter", "seaclutter_cli.runs.evaluate"]

MEMORY_PER_JOB = 400 * 2**20
"""Memory in bytes that a recording may need: four chunks of 64 MB, and the program."""


def default_jobs(recordings: int, memory: int = MEMORY_PER_JOB) -> int:
    """Return the number of processes for a number of recordings: as many as there are cores and memory for.

    Each may need ``memory`` bytes. What is available is known on Linux, also in containers.
    """
    found = []
    with suppress(OSError):
        lines = dict(line.split(":") for line in Path("/proc/meminfo").read_text().splitlines())
        found += [int(lines["MemAvailable"].split()[0]) * 1024]
    for limit, used in _CONTAINER:
        with suppress(OSError, ValueError):  # no limit: "max"
            found += [max(0, int(Path(limit).read_text()) - int(Path(used).read_text()))]
    return max(1, min(recordings, cores(), *(size // memory for size in found)))


_CONTAINER = (
    ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current"),
    ("/sys/fs/cgroup/memory/memory.limit_in_bytes", "/sys/fs/cgroup/memory/memory.usage_in_bytes"),
)
"""Limit and use of memory, in the two versions of control groups."""


def run_in_processes(jobs: int, tasks: Sequence[Task[R]], on_share: OnShare) -> Results[R]:
    """Run tasks in a number of processes of this machine, which share its cores; see `Engine`.

    A process that dies, for example because the system ran out of memory, costs its task one retry, and no other task
    anything.
    """
    # A fork of a process with threads can hang; a server of forks has none, and imports only once.
    method = "forkserver" if "forkserver" in mp.get_all_start_methods() and sys.platform == "linux" else "spawn"
    context = mp.get_context(method)
    if method == "forkserver":
        from multiprocessing import resource_tracker
        from multiprocessing.forkserver import ensure_running

        context.set_forkserver_preload(_PRELOADED)
        resource_tracker.ensure_running()  # by itself: it unblocks interrupts
        # Ctrl-C reaches the server, too, while it imports, and would be printed.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            ensure_running()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
    with _Pool(context, min(jobs, len(tasks))) as pool:
        yield from run_with_retries(pool, tasks, on_share)


class _Pool(AbstractContextManager["_Pool"]):
    def __init__(self, context: Any, size: int) -> None:
        self._context, self._size = context, size
        self._workers: list[_Worker] = []

    def give(self, waiting: deque[int], tasks: Sequence[Task[Any]]) -> list[int]:
        while waiting and len(self._workers) < self._size:
            self._workers.append(_Worker(self._context, max(1, min(threads(), cores() // self._size))))
        given = []
        for worker in self._workers:
            if waiting and not worker.is_busy:
                given.append(waiting.popleft())
                worker.start(given[-1], tasks[given[-1]])
        return given

    def answers(self) -> Iterator[tuple[int, str, Any]]:
        busy = {worker.pipe: worker for worker in self._workers if worker.is_busy}
        for pipe in wait(list(busy)):
            worker = busy[pipe]
            kind, content = worker.answer()
            if kind == DIED:
                self._workers.remove(worker)
            yield worker.number, kind, content

    def __exit__(self, *_: object) -> None:
        for worker in self._workers:
            worker.stop()
        for worker in self._workers:
            worker.end()


class _Worker:
    def __init__(self, context: Any, budget: int) -> None:
        self.pipe, other = context.Pipe()
        environment = {**os.environ, VARIABLE: str(budget)}  # a server of forks has that of its start
        self._process = context.Process(target=_work, args=(other, environment), daemon=True)
        self.number, self.is_busy = -1, False
        self._process.start()
        other.close()

    def start(self, number: int, task: Task[Any]) -> None:
        """Give the process a task; that it has died in the meantime is noticed when its answer is read."""
        self.number, self.is_busy = number, True
        try:
            self.pipe.send(task)
        except (BrokenPipeError, ConnectionResetError):
            pass
        except (AttributeError, TypeError, PicklingError) as error:
            raise UsageError(f"{_NOT_SENT} ({error})") from error

    def answer(self) -> tuple[str, Any]:
        try:
            kind, content = self.pipe.recv()
        except (EOFError, OSError):
            self.is_busy = False
            return DIED, f"its process {self.end()}"
        self.is_busy = kind == SHARE
        return kind, content

    def stop(self) -> None:
        """Ask the process to end; a task that runs is interrupted and removes its incomplete files."""
        if self.is_busy:
            self._process.terminate()
        self.pipe.close()

    def end(self) -> str:
        self._process.join(_END_S)
        if self._process.exitcode is None:
            self._process.kill()
            self._process.join()
        self.pipe.close()
        code = self._process.exitcode or 0
        if code >= 0:
            return f"ended with status {code}"
        name = signal.Signals(-code).name
        return f"was killed ({name}), perhaps because memory ran out" if name == "SIGKILL" else f"ended by {name}"


def _work(pipe: Connection, environment: Mapping[str, str]) -> None:
    handle_interrupts()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes; the first one ends the others
    os.environ.clear()
    os.environ.update(environment)
    warnings.simplefilter("ignore", PluginWarning)  # the first process has said it
    with suppress(EOFError, OSError, KeyboardInterrupt):  # the first process closed the pipe, or is gone
        while True:
            try:
                task = pipe.recv()
            except (AttributeError, ImportError) as error:
                pipe.send((ERROR, UsageError(f"{_NOT_SENT} ({error})")))
            else:
                pipe.send_bytes(answer(task, _Reporter(pipe)))
    ignore_interrupts()


class _Reporter:
    """Sends the share of a task that is done, a few times a second."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe, self._next_s = pipe, 0.0

    def __call__(self, share: float) -> None:
        if monotonic() >= self._next_s:
            self._next_s = monotonic() + _REPORT_S
            self._pipe.send((SHARE, share))
