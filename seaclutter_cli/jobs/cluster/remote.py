"""What runs on the workers of a cluster. The scheduler imports this module, too, so it is small."""

import os
import pickle
from collections.abc import Iterator
from contextlib import chdir, contextmanager, nullcontext
from threading import Lock
from time import monotonic
from typing import TYPE_CHECKING

from seaclutter_cli.jobs.engine import answer
from seaclutter_cli.threads import VARIABLE

if TYPE_CHECKING:
    from distributed import Worker

TOPIC = "seaclutter"
"""Topic of the events with shares: pairs of the key of a task and the share of it that is done."""

_REPORT_S = 1.0
_ALONE = Lock()


class _Cancelled(BaseException):
    """Nobody waits for the result: unwind the task, which removes its incomplete files."""


def run_remotely(task: bytes, folder: str) -> bytes | None:
    """Do a pickled task, opaque to the scheduler, on a worker and return its answer; None if it was cancelled.

    Relative paths start from ``folder``, the current folder of the run.
    """
    from distributed import get_worker

    worker = get_worker()
    # Relative paths are reported as missing if the folder does not exist here.
    moved = chdir(folder) if os.access(folder, os.X_OK) else nullcontext()
    # The current folder and the environment belong to the process; a worker with several threads may have other users.
    with _ALONE, moved, _thread_budget(worker.state.nthreads):
        try:
            return answer(pickle.loads(task), _Reporter(worker))  # noqa: S301 - of the run
        except _Cancelled:
            return None


class _Reporter:
    def __init__(self, worker: "Worker") -> None:
        self._worker, self._key, self._next_s = worker, str(worker.get_current_task()), 0.0

    def __call__(self, share: float) -> None:
        known = self._worker.state.tasks.get(self._key)
        if known is None or known.state == "cancelled":
            raise _Cancelled
        if monotonic() >= self._next_s:
            self._next_s = monotonic() + _REPORT_S
            self._worker.log_event(TOPIC, (self._key, share))


@contextmanager
def _thread_budget(threads: int) -> Iterator[None]:
    """Use as many threads as Dask gives the worker, unless the environment of the worker says otherwise."""
    before = os.environ.get(VARIABLE)
    os.environ.setdefault(VARIABLE, str(threads))
    try:
        yield
    finally:
        if before is None:
            del os.environ[VARIABLE]
