"""Places of a cluster: the address of a scheduler, or a batch system that starts workers."""

import os
import shutil
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from ssl import SSLError
from typing import TYPE_CHECKING, Any, Protocol

from seaclutter_cli.errors import ClusterError, MissingExtraError, UsageError

if TYPE_CHECKING:
    from distributed import Client
    from distributed.security import Security

SLURM = "slurm"
FILES = {"ca_file": "SEACLUTTER_TLS_CA", "client_cert": "SEACLUTTER_TLS_CERT", "client_key": "SEACLUTTER_TLS_KEY"}
"""Environment variables with the paths of certificates, by their names in Dask."""

_CONNECT_S = 10


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
        return _Slurm(workers)
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
        client_class = _client_class()
        security = _security(required=True) if self.name.startswith("tls:") else None
        try:
            client = client_class(self.name, security=security, timeout=_CONNECT_S, set_as_default=False)
        except (OSError, ValueError, RuntimeError) as error:
            raise ClusterError(f"{self.name}: no connection to a scheduler ({_cause(error)})") from error
        with _closing(client):
            yield client


@dataclass(frozen=True)
class _Slurm:
    """Workers that SLURM starts, and a scheduler in this process.

    Parameters
    ----------
    workers : int
        Number of workers.
    """

    workers: int
    name: str = SLURM
    patience_s: float | None = None

    @contextmanager
    def connected(self) -> Iterator["Client"]:
        client_class = _client_class()
        import dask
        from distributed.security import Security

        try:
            from dask_jobqueue import SLURMCluster
        except ImportError as error:
            raise MissingExtraError("--cluster", "cluster") from error
        if shutil.which("sbatch") is None:
            raise ClusterError("slurm: there is no command sbatch here; run seaclutter on a login node of the cluster")
        security = _security(required=False) or Security.temporary()
        settings = {name: dask.config.get(f"jobqueue.slurm.{name}", None) or value for name, value in _JOB.items()}
        folder = dask.config.get("jobqueue.slurm.shared-temp-directory", None) or str(Path.home())
        with dask.config.set(_ISOLATED):
            try:
                cluster = SLURMCluster(
                    **settings,
                    processes=dask.config.get("jobqueue.slurm.processes", None) or settings["cores"],
                    security=security,
                    protocol="tls://",
                    shared_temp_directory=folder,
                    scheduler_options={"dashboard": False, "dashboard_address": "127.0.0.1:0"},
                    silence_logs=False,
                )
            except (OSError, ValueError, RuntimeError) as error:
                raise ClusterError(f"slurm: {_cause(error)}") from error
            with cluster, _closing(client_class(cluster, set_as_default=False)) as client:
                cluster.scale(self.workers)
                yield client


_JOB: dict[str, Any] = {"cores": 1, "memory": "2 GiB"}
_ISOLATED = {
    "distributed.scheduler.allowed-failures": 1,
    "distributed.scheduler.work-stealing": False,
    "distributed.scheduler.worker-saturation": 1.0,
}


def _client_class() -> Any:
    try:
        from distributed import Client
    except ImportError as error:
        raise MissingExtraError("--cluster", "cluster") from error
    return Client


@contextmanager
def _closing(client: Any) -> Iterator[Any]:
    try:
        yield client
    finally:
        client.close(timeout=_CONNECT_S)


def _security(*, required: bool) -> "Security | None":
    """Return the certificates of the environment, or else of Dask's configuration; None if there are none.

    Raises
    ------
    UsageError
        If they are required and missing, or cannot be read.
    """
    from distributed.security import Security

    given = {f"tls_{name}": os.environ[variable] for name, variable in FILES.items() if os.environ.get(variable)}
    for role in ("scheduler", "worker"):  # for a scheduler in this process and its workers
        given |= {
            f"tls_{role}_{kind}": given[f"tls_client_{kind}"]
            for kind in ("cert", "key")
            if f"tls_client_{kind}" in given
        }
    security = Security(require_encryption=True, **given)
    missing = [FILES[name] for name in ("ca_file", "client_cert") if getattr(security, f"tls_{name}") is None]
    if missing:
        if not required and not given:
            return None
        raise UsageError(f"tls://: certificates are missing; set {' and '.join(missing)}, or Dask's configuration")
    try:
        security.get_connection_args("client")
    except OSError as error:  # also SSLError
        files = ", ".join(str(getattr(security, f"tls_{name}")) for name in FILES if getattr(security, f"tls_{name}"))
        raise UsageError(
            f"{files}: cannot be used as certificates ({error.strerror or type(error).__name__})"
        ) from error
    return security


def _cause(error: BaseException) -> str:
    """Return the text of the first error in a chain: those that follow only repeat addresses."""
    while error.__cause__ is not None:
        error = error.__cause__
    if isinstance(error, SSLError):
        return f"TLS: {error.reason or 'failed'}".replace("_", " ").lower()
    text = str(getattr(error, "strerror", None) or error).strip()
    return text.splitlines()[0] if text else "no answer"
