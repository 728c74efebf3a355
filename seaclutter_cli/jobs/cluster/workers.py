"""The workers of a cluster, which come and go, and the versions of their software, on which outputs depend."""

import re
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires
from time import monotonic
from typing import TYPE_CHECKING, Any

from seaclutter_cli.errors import ClusterError
from seaclutter_cli.jobs.cluster.connection import Connection

if TYPE_CHECKING:
    from distributed import Client

_WARN_S = 10.0
_QUESTIONS = 2
"""About versions, and files."""
_NOT_COMPUTING = {"click", "lazy-loader", "tqdm", "annotated-types"}
_REMOTE = ("seaclutter", "python", "dask", "distributed", "cloudpickle")
_OPTIONAL = ("laspy", "lazrs", "obstore", "onnxruntime", "pypatchworkpp", "scikit-learn", "skops", "velodyne-decoder")


@dataclass
class _Worker:
    """A worker; ``home`` starts it again after its death, ``answers`` counts its answers to questions about its use."""

    home: str
    process: str
    is_first: bool
    is_running: bool = True
    answers: int = 0
    refusal: str | None = None


class Workers:
    """Workers that may be used: those with the same versions of the software, and the files of the run.

    ``warn`` receives warnings about workers that join later and are left out.
    """

    def __init__(self, client: "Client", connection: Connection, warn: Callable[[str], object]) -> None:
        self._client, self._connection, self._warn = client, connection, warn
        collect, packages = versions_question()
        self._versions = collect(packages)
        self.known: dict[str, _Worker] = {}
        self.deaths: dict[int, str] = {}
        """Homes of the workers that died with a task, by its number."""
        self._any_since_s, self._had_any, self._has_warned = monotonic(), False, False

    @contextmanager
    def connection(self) -> Iterator[None]:
        """Make one error of all signs that the scheduler is gone."""
        try:
            yield
        except (OSError, TimeoutError, CancelledError) as error:  # CommClosedError is an OSError
            raise ClusterError(
                f"{self._connection.name}: the connection to the scheduler is lost; outputs that are complete stay"
            ) from error

    def update(self, *, is_busy: bool) -> set[str]:
        """Ask the scheduler for its workers and return the addresses of those whose tasks go on.

        Raise `ClusterError` if there have been none for too long, or those that were there first cannot be used.
        """
        if self._client.status != "running":
            raise ConnectionError
        found = self._client.scheduler_info(n_workers=-1)["workers"]
        gone = {a for a, worker in self.known.items() if worker.process != found.get(a, {}).get("local_directory")}
        for address in gone:
            del self.known[address]
        new: set[str] = found.keys() - self.known.keys()
        for address in new:
            home, process = found[address].get("nanny") or address, found[address]["local_directory"]
            self.known[address] = _Worker(home, process, is_first=not self._had_any)
        for address, worker in self.known.items():
            worker.is_running = found[address].get("status", "running") == "running"
        self._had_any = self._had_any or bool(new)
        self._require_any(is_busy=is_busy)
        return self.known.keys() - (new & gone)

    def compare_scheduler(self) -> None:
        """Raise `ClusterError` if the scheduler has other versions."""
        there = self._client.run_on_scheduler(*versions_question())
        if difference := skew(self._versions, there, of_scheduler=True):
            raise ClusterError(f"{self._connection.name}: the scheduler {difference}")

    def note_versions(self, address: str, found: Any) -> None:
        """Note the first answer of a worker, its versions."""
        self.note(address, skew(self._versions, found))

    def note(self, address: str, reason: str | None) -> None:
        """Note an answer of a worker: why it cannot be used, or None."""
        if (worker := self.known.get(address)) is None:
            return
        worker.answers, worker.refusal = worker.answers + 1, reason
        if reason is not None and worker.is_first:
            raise ClusterError(f"{self._connection.name}: worker {address} {reason}")
        if reason is not None:
            self._warn(f"{self._connection.name}: worker {address} is left out: it {reason}")

    def _require_any(self, *, is_busy: bool) -> None:
        if is_busy or any(worker.refusal is None for worker in self.known.values()):
            self._any_since_s, self._has_warned = monotonic(), False
            return
        waited_s, patience_s = monotonic() - self._any_since_s, self._connection.patience_s
        if waited_s > _WARN_S and not self._has_warned:
            self._has_warned = True
            self._warn(f"{self._connection.name}: no workers yet; the run waits for them")
        if patience_s is not None and waited_s > patience_s:
            raise ClusterError(f"{self._connection.name}: there has been no worker for {patience_s / 60:.0f} minutes")

    def usable(self) -> list[str]:
        """Return the workers that may have a task."""
        return [a for a, one in self.known.items() if one.answers == _QUESTIONS and one.is_running and not one.refusal]

    def new(self) -> list[str]:
        """Return the workers whose use is not decided."""
        return [a for a, one in self.known.items() if one.answers < _QUESTIONS and not one.refusal]

    def is_avoided(self, address: str, number: int) -> bool:
        """Return whether a task should rather run elsewhere: it died there, and there is another place."""
        home = self.deaths.get(number)
        return home == self.known[address].home and any(
            worker.home != home for worker in self.known.values() if worker.refusal is None
        )


def compared_packages() -> list[str]:
    """Return the packages whose versions must be the same here and on workers."""
    try:
        stated = requires("seaclutter") or []
    except PackageNotFoundError:  # runs from its source
        stated = []
    names = [re.split(r"[^\w.-]", text, maxsplit=1)[0] for text in stated if "extra ==" not in text]
    return [name for name in names if name not in _NOT_COMPUTING]


def skew(here: Mapping[str, Any] | None, there: Mapping[str, Any] | None, *, of_scheduler: bool = False) -> str | None:
    """Return the first difference between versions that matters, as ``has numpy 2.1, here 2.2``; None if there is none.

    Versions are as Dask collects them: ``{"packages": {name: version or None}}``. Those ``of_scheduler`` matter less,
    since it only passes tasks on.
    """
    ours, theirs = _packages(here), _packages(there)
    required = _REMOTE if of_scheduler else (*_REMOTE, *compared_packages())
    for name in dict.fromkeys((*required, *(() if of_scheduler else _OPTIONAL))):
        own, other = ours.get(name), theirs.get(name)
        if own is None or own == other or (other is None and name not in required):
            continue
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
