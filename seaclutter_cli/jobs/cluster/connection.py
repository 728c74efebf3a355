"""Connections to clusters: to a scheduler that runs, or to workers that SLURM starts."""

import asyncio
import os
import shutil
import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from ssl import SSLError
from threading import current_thread, main_thread
from typing import TYPE_CHECKING, Any

from seaclutter_cli.errors import ClusterError, UsageError, requiring

if TYPE_CHECKING:
    from distributed import Client
    from distributed.security import Security

FILES = {"ca_file": "SEACLUTTER_TLS_CA", "client_cert": "SEACLUTTER_TLS_CERT", "client_key": "SEACLUTTER_TLS_KEY"}
"""Environment variables with the paths of certificates, by their names in Dask."""

_PATIENCE_S = 300.0
_CONNECT_S = 10
"""To connect, and to close a connection."""

_JOB: dict[str, Any] = {"cores": 1, "memory": "2 GiB"}
_SCHEDULER = {
    "distributed.scheduler.allowed-failures": 1,
    "distributed.scheduler.work-stealing": False,
    "distributed.scheduler.worker-saturation": 1.0,
}
_NO_DASHBOARD = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}
_NO_PAGE = ("--dashboard-address", "127.0.0.1:0")  # without this, a page of its status is for everyone
_WORKER = [f"export DASK_DISTRIBUTED__WORKER__MEMORY__{name}=False" for name in ("TARGET", "SPILL", "PAUSE")]


@dataclass(frozen=True)
class Connection:
    """A cluster; ``connected`` raises `ClusterError` if there is no connection to it.

    While there are no workers, a run waits for ``patience_s`` seconds; if None, until it is interrupted.
    """

    name: str
    connected: Callable[[], AbstractContextManager["Client"]]
    patience_s: float | None = None


def connection_to(address: str, *, insecure: bool = False, workers: int | None = None) -> Connection:
    """Return the connection for what ``--cluster`` says: ``tls://HOST:PORT`` of a scheduler, or ``slurm``.

    ``insecure`` allows addresses without encryption (``tcp://``), ``workers`` is the number of workers that ``slurm``
    starts. Raise `UsageError` if the address is not valid, or certificates are missing; `MissingExtraError` if the
    extra ``cluster`` is not installed.
    """
    scheme, _, rest = address.partition("://")
    if address != "slurm" and (scheme not in ("tls", "tcp") or not rest or "@" in rest):
        shown = "" if "@" in address else f", got {address[:60]!r}"
        raise UsageError(f"--cluster: expected tls://HOST:PORT or slurm{shown}")
    if scheme == "tcp" and not insecure:
        raise UsageError(
            f"{address}: is not encrypted, and everyone in its network can run programs there; use tls://, or add "
            "--cluster-insecure"
        )
    if address == "slurm":
        if workers is None:
            raise UsageError("--cluster slurm: requires the number of workers, such as -j 16")
        return Connection(address, partial(_slurm, workers))
    return Connection(address, partial(_scheduler, address), _PATIENCE_S)


@contextmanager
def _scheduler(address: str) -> Iterator["Client"]:
    with requiring("--cluster", "cluster"):
        from distributed import Client
    security = _certificates(required=True) if address.startswith("tls:") else None
    try:
        asyncio.run(asyncio.wait_for(_greet(address, security), 1.5 * _CONNECT_S))
        client = Client(address, security=security, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError, RuntimeError) as error:
        raise ClusterError(f"{address}: no connection to a scheduler ({_cause(error)})") from error
    with ExitStack() as stack:
        stack.callback(client.close, timeout=_CONNECT_S)
        yield client


async def _greet(address: str, security: "Security | None") -> None:
    """Exchange greetings with a scheduler: a client would wait for ever for something else that listens."""
    from distributed.comm import connect

    arguments = security.get_connection_args("client") if security else {}
    comm = await connect(address, timeout=_CONNECT_S, **arguments)
    await comm.close()


@contextmanager
def _slurm(workers: int) -> Iterator["Client"]:
    """Submit workers as jobs of SLURM, which are cancelled at the end, and start a scheduler in this process."""
    with requiring("--cluster", "cluster"):
        import dask
        from distributed import Client

    if shutil.which("sbatch") is None:
        raise ClusterError("slurm: there is no command sbatch here; run seaclutter on a login node of the cluster")
    with dask.config.set(_SCHEDULER):
        cluster = _cluster()
        try:
            tried = ["sbatch", "--test-only"]  # SLURM may refuse a job, for example because of its partition
            done = subprocess.run(tried, input=cluster.job_script(), capture_output=True, text=True, check=False)  # noqa: S603
            if done.returncode:
                raise ClusterError(f"slurm: {(done.stderr.strip().splitlines() or ['sbatch failed'])[-1]}")
            with ExitStack() as stack:
                client = Client(cluster, set_as_default=False)
                stack.callback(client.close, timeout=_CONNECT_S)
                cluster.scale(workers)
                yield client
        finally:
            with suppress(Exception):  # a job that could not be submitted
                cluster.close()


def _cluster() -> Any:
    """Return the cluster that the configuration of dask-jobqueue describes, with our defaults and encryption."""
    import dask
    from distributed.security import Security

    def configured(name: str) -> Any:
        return dask.config.get(f"jobqueue.slurm.{name}", None)

    job = {name: configured(name) or value for name, value in _JOB.items()}
    discarded = [] if configured("log-directory") else [f"-o {os.devnull}"]  # by default a file in the current folder
    try:
        return _cluster_class()(
            **job,
            processes=configured("processes") or job["cores"],
            security=_certificates(required=False) or Security.temporary(),
            protocol="tls://",
            shared_temp_directory=configured("shared-temp-directory") or str(Path.home()),
            job_extra_directives=[*(configured("job-extra-directives") or ()), *discarded],
            job_script_prologue=[*_WORKER, *(configured("job-script-prologue") or ())],
            scheduler_options=_NO_DASHBOARD | configured("scheduler-options"),
            worker_extra_args=[*_NO_PAGE, *(configured("worker-extra-args") or ())],
            silence_logs=False,
        )
    except (OSError, ValueError, RuntimeError) as error:
        raise ClusterError(f"slurm: {_cause(error)}") from error


def _cluster_class() -> Any:
    """Import the class; the import replaces the handler of Ctrl-C by one that ends the program with status 0."""
    if current_thread() is not main_thread():
        raise ClusterError("slurm: start the run in the main thread")
    handler = signal.getsignal(signal.SIGINT)
    try:
        with requiring("--cluster", "cluster"):
            from dask_jobqueue import SLURMCluster
    finally:
        signal.signal(signal.SIGINT, handler)
    return SLURMCluster


def _certificates(*, required: bool) -> "Security | None":
    """Return the certificates of the environment, or else of Dask's configuration; `UsageError` if required."""
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
