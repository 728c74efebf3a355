"""The workers of a cluster, which come and go."""

from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import dataclass
from time import monotonic
from typing import TYPE_CHECKING, Any

from seaclutter_cli.errors import ClusterError
from seaclutter_cli.jobs.cluster.place import Place
from seaclutter_cli.jobs.cluster.versions import skew, versions_here, versions_question

if TYPE_CHECKING:
    from distributed import Client

_WARN_S = 10.0


@dataclass
class _Worker:
    """A worker; ``home`` is the process that starts it again after its death."""

    home: str
    process: str
    is_first: bool
    is_running: bool = True
    has_same_versions: bool = False
    is_checked: bool = False
    refusal: str | None = None


class Workers:
    """Workers that may be used: those with the same versions of the software, and the files of the run.

    Parameters
    ----------
    client : Client
        Connection to the cluster.
    place : Place
        The cluster.
    warn : callable
        Receives warnings about workers that join later and are left out.
    """

    def __init__(self, client: "Client", place: Place, warn: Callable[[str], object]) -> None:
        self._client, self._place, self._warn = client, place, warn
        self._versions = versions_here()
        self._known: dict[str, _Worker] = {}
        self._deaths: dict[int, str] = {}
        self._any_since_s, self._had_any, self._has_warned = monotonic(), False, False

    @contextmanager
    def connection(self) -> Iterator[None]:
        """Make one error of all signs that the scheduler is gone."""
        try:
            yield
        except (OSError, TimeoutError, CancelledError) as error:  # CommClosedError is an OSError
            raise ClusterError(
                f"{self._place.name}: the connection to the scheduler is lost; outputs that are complete stay"
            ) from error

    def update(self, *, is_busy: bool) -> set[str]:
        """Ask the scheduler for its workers and return the addresses of those whose tasks go on.

        Raises
        ------
        ClusterError
            If there have been none for too long, or those that were there first cannot be used.
        """
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
        self._require_any(is_busy=is_busy)
        return self._known.keys() - (new & gone)

    def compare_scheduler(self) -> None:
        """Raise `ClusterError` if the scheduler has other versions."""
        there = self._client.run_on_scheduler(*versions_question())
        if difference := skew(self._versions, there, of_scheduler=True):
            raise ClusterError(f"{self._place.name}: the scheduler {difference}")

    def set_versions(self, address: str, found: Any) -> None:
        """Note the versions of a worker."""
        difference = skew(self._versions, found)
        if address in self._known:
            self._known[address].has_same_versions = difference is None
            if difference is not None:
                self._refuse(address, difference)

    def _refuse(self, address: str, reason: str) -> None:
        worker = self._known[address]
        if worker.is_first:
            raise ClusterError(f"{self._place.name}: worker {address} {reason}")
        worker.refusal = reason
        self._warn(f"{self._place.name}: worker {address} is left out: it {reason}")

    def _require_any(self, *, is_busy: bool) -> None:
        if is_busy or any(worker.refusal is None for worker in self._known.values()):
            self._any_since_s, self._has_warned = monotonic(), False
            return
        waited_s, patience_s = monotonic() - self._any_since_s, self._place.patience_s
        if waited_s > _WARN_S and not self._has_warned:
            self._has_warned = True
            self._warn(f"{self._place.name}: no workers yet; the run waits for them")
        if patience_s is not None and waited_s > patience_s:
            raise ClusterError(f"{self._place.name}: there has been no worker for {patience_s / 60:.0f} minutes")

    def set_checked(self, address: str, reason: str | None) -> None:
        """Note the result of the check of a worker: why it cannot be used, or None."""
        if address in self._known:
            self._known[address].is_checked = True
            if reason is not None:
                self._refuse(address, reason)

    def usable(self) -> list[str]:
        """Return the workers that may have a task."""
        return [
            a for a, worker in self._known.items() if worker.is_checked and worker.is_running and not worker.refusal
        ]

    def new(self) -> list[str]:
        """Return the workers whose use is not decided."""
        return [a for a, worker in self._known.items() if not (worker.is_checked or worker.refusal)]

    def has_same_versions(self, address: str) -> bool:
        """Return whether a worker is known to have the same versions of the software."""
        return self._known[address].has_same_versions

    def home(self, address: str) -> str:
        """Return the address of what starts a worker again after its death."""
        return self._known[address].home if address in self._known else address

    def note_death(self, number: int, home: str) -> None:
        """Note that a worker died with a task."""
        self._deaths[number] = home

    def is_avoided(self, address: str, number: int) -> bool:
        """Return whether a task should rather run elsewhere: it died there, and there is another place."""
        home = self._deaths.get(number)
        return home == self._known[address].home and any(
            worker.home != home for worker in self._known.values() if worker.refusal is None
        )
