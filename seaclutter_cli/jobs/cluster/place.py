"""Places of a cluster: the address of a scheduler, or a batch system that starts workers."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from seaclutter_cli.errors import ClusterError, UsageError
from seaclutter_cli.jobs.cluster.client import CONNECT_S, cause, certificates, client_class, closing
from seaclutter_cli.jobs.cluster.slurm import SLURM, Slurm

if TYPE_CHECKING:
    from distributed import Client


class Place(Protocol):
    """A cluster to connect to."""

    @property
    def name(self) -> str:
        """Name in messages."""
        ...

    @property
    def patience_s(self) -> float | None:
        """How long a run waits in seconds while there are no workers; None: until it is interrupted."""
        ...

    def connected(self) -> AbstractContextManager["Client"]:
        """Connect to the cluster.

        Raises
        ------
        ClusterError
            If that fails.
        """
        ...


def place_of(address: str, *, insecure: bool = False, workers: int | None = None) -> Place:
    """Return the place for what ``--cluster`` says.

    Parameters
    ----------
    address : str
        ``tls://HOST:PORT`` of a scheduler, or ``slurm``.
    insecure : bool, optional
        Whether addresses without encryption (``tcp://``) are allowed.
    workers : int or None, optional
        Number of workers to start; only for ``slurm``.

    Raises
    ------
    UsageError
        If the address is not valid, or certificates are missing.
    MissingExtraError
        If the extra ``cluster`` is not installed.
    """
    scheme, _, rest = address.partition("://")
    if address != SLURM and (scheme not in ("tls", "tcp") or not rest or "@" in rest):
        shown = "" if "@" in address else f", got {address[:60]!r}"
        raise UsageError(f"--cluster: expected tls://HOST:PORT or slurm{shown}")
    if scheme == "tcp" and not insecure:
        raise UsageError(
            f"{address}: is not encrypted, and everyone in its network can run programs there; use tls://, or add "
            "--cluster-insecure"
        )
    if address == SLURM:
        if workers is None:
            raise UsageError("--cluster slurm: requires the number of workers, such as -j 16")
        return Slurm(workers)
    return _Scheduler(address)


@dataclass(frozen=True)
class _Scheduler:
    """A scheduler that runs.

    Parameters
    ----------
    name : str
        Its address.
    """

    name: str
    patience_s: float | None = 300.0

    @contextmanager
    def connected(self) -> Iterator["Client"]:
        make = client_class()
        security = certificates(required=True) if self.name.startswith("tls:") else None
        try:
            client = make(self.name, security=security, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError, RuntimeError) as error:
            raise ClusterError(f"{self.name}: no connection to a scheduler ({cause(error)})") from error
        with closing(client):
            yield client
