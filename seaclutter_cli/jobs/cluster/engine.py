"""The engine for clusters."""

import asyncio
import logging
import pickle
import re
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent import futures
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires
from itertools import count
from pathlib import Path
from queue import Empty, SimpleQueue
from time import monotonic
from typing import TYPE_CHECKING, Any, Self
from uuid import uuid4

from seaclutter_cli.errors import ClusterError
from seaclutter_cli.jobs.cluster.connection import Connection
from seaclutter_cli.jobs.cluster.remote import TOPIC, run_remotely
from seaclutter_cli.jobs.engine import DIED, DONE, ERROR, SHARE, OnShare, R, Report, Results, Task, run_with_retries
from seaclutter_cli.registry import plugins

if TYPE_CHECKING:
    from distributed import Client, Future

_CANCELLED = (asyncio.CancelledError, futures.CancelledError)
_LOST = (OSError, TimeoutError, futures.CancelledError)
"""Signs that the scheduler is gone; CommClosedError is an OSError."""
_NEVER = logging.CRITICAL + 1
_LIBRARIES = ("distributed", "dask_jobqueue", "tornado")
_LOOK_S = 1.0
_WARN_S = 10.0
_QUESTIONS = 2
"""About versions, and files."""
_END_S = 10.0
_STEPS_OF_RELEASE = 2
"""Callbacks of the event loop until the scheduler is sent a release: one counts the references, one sends."""
_DEAD = "its worker died, perhaps because memory ran out"
_NOT_COMPUTING = {"click", "lazy-loader", "tqdm", "annotated-types"}
_REMOTE = ("seaclutter", "python", "dask", "distributed", "cloudpickle")
_OPTIONAL = ("laspy", "lazrs", "obstore", "onnxruntime", "scikit-learn", "skops", "velodyne-decoder")


@dataclass(frozen=True)
class Cluster:
    """Engine that runs tasks on the workers of a Dask cluster, on at most ``limit`` at the same time.

    Each task is bound to one idle worker, so neither queues of workers nor work stealing ever put two tasks of a run on
    one worker, whatever the settings of the scheduler. There are never more tasks in the cluster than workers. The task
    ``check`` returns why a worker cannot be used; None if it can.
    """

    connection: Connection
    check: Task[str | None]
    warn: Callable[[str], object]
    limit: int | None = None

    def __call__(self, tasks: Sequence[Task[R]], on_share: OnShare) -> Results[R]:
        """Run tasks; see `Engine`.

        Raise `ClusterError` if there is no scheduler or no worker, the versions of their software differ, or the
        scheduler disappears.
        """
        if not tasks:
            return
        with _quiet(), self.connection.connected() as client, _Pool(client, self, self.limit or len(tasks)) as pool:
            yield from run_with_retries(pool, tasks, on_share)


@dataclass
class _Job:
    """A task on a worker, ``home``: that of a ``number`` in the run, or one whose result ``receive`` takes."""

    worker: str
    home: str
    future: "Future[Any]"
    number: int | None = None
    receive: Callable[[str, Any], None] | None = None


@dataclass
class _Worker:
    """A worker; ``home`` starts it again after its death, ``answers`` counts its answers to questions about its use."""

    home: str
    process: str
    is_first: bool
    is_running: bool = True
    answers: int = 0
    refusal: str | None = None


class _Pool:
    """The workers of a cluster, each with at most one task; those with the same software and the files of the run."""

    def __init__(self, client: "Client", cluster: Cluster, limit: int) -> None:
        self._client, self._cluster, self._limit = client, cluster, limit
        self._name = cluster.connection.name
        self._known: dict[str, _Worker] = {}
        self._deaths: dict[int, str] = {}  # homes of the workers that died with a task, by its number
        self._any_since_s, self._had_any, self._has_warned = monotonic(), False, False
        self._jobs: dict[str, _Job] = {}
        self._events: SimpleQueue[tuple[str, str, Any]] = SimpleQueue()
        run = uuid4().hex
        self._keys = (f"seaclutter-{run}-{number}" for number in count())
        self._next_look_s = 0.0

    def __enter__(self) -> Self:
        """Compare the versions of the scheduler, and listen to the workers."""
        collect, packages = versions_question()
        self._versions = collect(packages)
        with self._connection():
            there = self._client.run_on_scheduler(collect, packages)
            if difference := skew(self._versions, there, of_scheduler=True):
                raise ClusterError(f"{self._name}: the scheduler {difference}")
        self._client.subscribe_topic(TOPIC, lambda event: self._events.put((event[1][0], SHARE, event[1][1])))
        return self

    @contextmanager
    def _connection(self) -> Iterator[None]:
        """Make one error of all signs that the scheduler is gone."""
        try:
            yield
        except _LOST as error:
            raise ClusterError(
                f"{self._name}: the connection to the scheduler is lost; outputs that are complete stay"
            ) from error

    @property
    def _busy(self) -> int:
        return sum(job.number is not None for job in self._jobs.values())

    def give(self, waiting: deque[int], tasks: Sequence[Task[Any]]) -> list[int]:
        given: list[int] = []
        with self._connection():
            busy = {job.worker for job in self._jobs.values()}
            idle = {a: one for a, one in self._known.items() if a not in busy and not one.refusal}
            for address, worker in idle.items():
                if worker.answers < _QUESTIONS:
                    self._ask(address)
                    continue
                number = next((n for n in waiting if not self._is_avoided(address, n)), None)
                if number is not None and worker.is_running and self._busy < self._limit:
                    waiting.remove(number)
                    self._submit(address, run_remotely, *_sent(tasks[number]), number=number)
                    given.append(number)
        return given

    def _ask(self, address: str) -> None:
        """Ask a worker for its versions, then for other obstacles, as tasks: a worker that hangs delays nothing."""
        if self._known[address].answers:
            self._submit(address, run_remotely, *_sent(self._cluster.check), receive=self._receive_check)
        else:
            receive = lambda worker, found: self._note(worker, skew(self._versions, found))
            self._submit(address, *versions_question(), receive=receive)

    def _submit(self, address: str, function: Callable[..., Any], *arguments: Any, **kind: Any) -> None:
        key = next(self._keys)
        future = self._client.submit(function, *arguments, key=key, workers=[address], pure=False)
        worker = self._known.get(address)
        self._jobs[key] = _Job(address, worker.home if worker else address, future, **kind)
        self._client.loop.add_callback(self._fetch, key, future)

    async def _fetch(self, key: str, future: "Future[Any]") -> None:
        """Wait for a result, which a worker may keep until it is known to be dead, and release the task."""
        kind, content = DONE, None
        try:
            content = await self._client.gather(future, asynchronous=True)
        except (Exception, *_CANCELLED) as error:  # noqa: BLE001 - raised again in the main thread
            kind, content = ERROR, error
        future.release()
        for _ in range(_STEPS_OF_RELEASE):  # the task that takes its place must not overtake the message
            await asyncio.sleep(0)
        self._events.put((key, kind, content))

    def _receive_check(self, address: str, found: bytes) -> None:
        kind, content = pickle.loads(found)  # noqa: S301 - of our worker
        if kind != DONE:
            raise content
        self._note(address, content)

    def answers(self) -> Iterator[tuple[int, str, Any]]:
        with self._connection():
            with suppress(Empty):
                key, kind, content = self._events.get(timeout=max(0.0, self._next_look_s - monotonic()))
                if key in self._jobs:
                    yield from self._answer(key, kind, content)
            if monotonic() >= self._next_look_s:
                self._next_look_s = monotonic() + _LOOK_S
                here = self._update()  # workers that are gone have died
                for key, job in list(self._jobs.items()):
                    if job.worker not in here:
                        del self._jobs[key]
                        job.future.cancel()
                        yield from self._died(job)

    def _answer(self, key: str, kind: str, content: Any) -> Iterator[tuple[int, str, Any]]:
        """Yield the answer of a task whose share, result or error has come; receive those of questions."""
        job = self._jobs[key]
        if kind == SHARE:
            if job.number is not None:
                yield job.number, SHARE, content
            return
        del self._jobs[key]
        if kind == ERROR and type(content).__name__ == "KilledWorker":
            yield from self._died(job)
        elif isinstance(content, _CANCELLED) or type(content).__name__ == "CommClosedError":
            raise ConnectionError from content  # not cancelled by us, or while it was fetched from the scheduler
        elif kind == ERROR:
            raise ClusterError(f"worker {job.worker}: {type(content).__name__}: {content}") from content
        elif job.receive is not None:
            job.receive(job.worker, content)
        elif job.number is not None:
            yield job.number, *pickle.loads(content)  # noqa: S301 - of our worker

    def _died(self, job: _Job) -> Iterator[tuple[int, str, Any]]:
        if job.number is not None:
            self._deaths[job.number] = job.home
            yield job.number, DIED, _DEAD

    def _note(self, address: str, reason: str | None) -> None:
        """Note an answer of a worker: why it cannot be used, or None."""
        if (worker := self._known.get(address)) is None:
            return
        worker.answers, worker.refusal = worker.answers + 1, reason
        if reason is not None and worker.is_first:
            raise ClusterError(f"{self._name}: worker {address} {reason}")
        if reason is not None:
            self._cluster.warn(f"{self._name}: worker {address} is left out: it {reason}")

    def _update(self) -> set[str]:
        """Ask the scheduler for its workers; return addresses of those whose tasks go on, or raise `ClusterError`."""
        if self._client.status != "running":
            raise ConnectionError
        found = self._client.scheduler_info(n_workers=-1)["workers"]
        gone = {a for a, worker in self._known.items() if worker.process != found.get(a, {}).get("local_directory")}
        for address in gone:
            del self._known[address]
        new: set[str] = found.keys() - self._known.keys()
        for address in new:
            home, process = found[address].get("nanny") or address, found[address]["local_directory"]
            self._known[address] = _Worker(home, process, is_first=not self._had_any)
        for address, worker in self._known.items():
            worker.is_running = found[address].get("status", "running") == "running"
        self._had_any = self._had_any or bool(new)
        self._require_any()
        return self._known.keys() - (new & gone)

    def _require_any(self) -> None:
        if self._busy or any(worker.refusal is None for worker in self._known.values()):
            self._any_since_s, self._has_warned = monotonic(), False
            return
        waited_s, patience_s = monotonic() - self._any_since_s, self._cluster.connection.patience_s
        if waited_s > _WARN_S and not self._has_warned:
            self._has_warned = True
            self._cluster.warn(f"{self._name}: no workers yet; the run waits for them")
        if patience_s is not None and waited_s > patience_s:
            raise ClusterError(f"{self._name}: there has been no worker for {patience_s / 60:.0f} minutes")

    def _is_avoided(self, address: str, number: int) -> bool:
        """Return whether a task should rather run elsewhere: it died there, and there is another place."""
        home = self._deaths.get(number)
        return home == self._known[address].home and any(
            worker.home != home for worker in self._known.values() if worker.refusal is None
        )

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Cancel the tasks that run, and wait until they have removed their incomplete files."""
        if self._client.status != "running":
            return
        with suppress(Exception):  # workers and the scheduler may end meanwhile
            stopped = list(self._jobs.values())
            self._jobs.clear()
            self._client.cancel([job.future for job in stopped])
            if kind is not None:
                self._wait_for(job.worker for job in stopped)
            self._client.unsubscribe_topic(TOPIC)

    def _wait_for(self, workers: Iterable[str]) -> None:
        until = monotonic() + _END_S
        for address in workers:
            self._submit(address, run_remotely, *_sent(_nothing))
        while self._jobs:
            key, kind, _ = self._events.get(timeout=max(0.0, until - monotonic()))
            if kind != SHARE:
                self._jobs.pop(key, None)


def _nothing(_: Report) -> None: ...


def _sent(task: Task[Any]) -> tuple[bytes, str]:
    return pickle.dumps(task), str(Path.cwd())


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence the logs of Dask, which would repeat errors of a run between its lines."""
    with suppress(ImportError):
        import distributed  # noqa: F401 - makes its loggers
    for name in _LIBRARIES:
        logging.getLogger(name)
    known = [logger for name, logger in logging.root.manager.loggerDict.items() if name.partition(".")[0] in _LIBRARIES]
    before = {logger: logger.level for logger in known if isinstance(logger, logging.Logger)}
    for logger in before:  # those that are made later have the level of the first of their name
        logger.setLevel(_NEVER)
    try:
        yield
    finally:
        for logger, level in before.items():
            logger.setLevel(level)


def compared_packages() -> list[str]:
    """Return the packages whose versions must be the same here and on workers."""
    stated: list[str] = []
    with suppress(PackageNotFoundError):  # runs from its source
        stated = requires("seaclutter") or []
    names = [re.split(r"[^\w.-]", text, maxsplit=1)[0] for text in stated if "extra ==" not in text]
    added = {point.dist.name: None for points in plugins().values() for point in points if point.dist}
    return [*(name for name in names if name not in _NOT_COMPUTING), *added]


def skew(here: Mapping[str, Any] | None, there: Mapping[str, Any] | None, *, of_scheduler: bool = False) -> str | None:
    """Return the first difference between versions that matters, as ``has numpy 2.1, here 2.2``; None if there is none.

    Versions are as Dask collects them: ``{"packages": {name: version or None}}``. Those ``of_scheduler`` matter less,
    since it only passes tasks on.
    """
    ours, theirs = _packages(here), _packages(there)
    required = _REMOTE if of_scheduler else (*_REMOTE, *compared_packages())
    for name in dict.fromkeys((*required, *(() if of_scheduler else _OPTIONAL))):
        own, other = ours.get(name), theirs.get(name)
        if own and own != other and (other or name in required):
            return f"has {name} {other}, here {own}" if other else f"has no {name}, here {own}"
    return None


def versions_question() -> tuple[Callable[[list[str]], Any], list[str]]:
    """Return a function of Dask and its argument, which give versions also where seaclutter is missing."""
    from distributed.versions import get_versions

    return get_versions, [*_REMOTE, *compared_packages(), *_OPTIONAL]


def _packages(found: Mapping[str, Any] | None) -> dict[str, str | None]:
    packages = dict((found or {}).get("packages", {}))
    if packages.get("python"):  # what patch releases change does not matter
        packages["python"] = ".".join(packages["python"].split(".")[:2])
    return packages
