"""Workers that SLURM starts."""

import os
import shutil
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from threading import current_thread, main_thread
from typing import TYPE_CHECKING, Any

from seaclutter_cli.errors import ClusterError, MissingExtraError
from seaclutter_cli.jobs.cluster.client import cause, certificates, client_class, closing

if TYPE_CHECKING:
    from distributed import Client

SLURM = "slurm"
"""What stands for an address."""

_JOB: dict[str, Any] = {"cores": 1, "memory": "2 GiB"}
_SCHEDULER = {
    "distributed.scheduler.allowed-failures": 1,
    "distributed.scheduler.work-stealing": False,
    "distributed.scheduler.worker-saturation": 1.0,
}
_NO_DASHBOARD = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}
_WORKER = [f"export DASK_DISTRIBUTED__WORKER__MEMORY__{name}=False" for name in ("TARGET", "SPILL", "PAUSE")]


@dataclass(frozen=True)
class Slurm:
    """Workers in jobs of SLURM, and a scheduler in this process.

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
        """Submit the jobs, which are cancelled at the end; see `Place.connected`."""
        make = client_class()
        import dask

        if shutil.which("sbatch") is None:
            raise ClusterError("slurm: there is no command sbatch here; run seaclutter on a login node of the cluster")
        with dask.config.set(_SCHEDULER):
            cluster = _cluster()
            try:
                _require_acceptance(cluster.job_script())
                with closing(make(cluster, set_as_default=False)) as client:
                    cluster.scale(self.workers)
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
            security=certificates(required=False) or Security.temporary(),
            protocol="tls://",
            shared_temp_directory=configured("shared-temp-directory") or str(Path.home()),
            job_extra_directives=[*(configured("job-extra-directives") or ()), *discarded],
            job_script_prologue=[*_WORKER, *(configured("job-script-prologue") or ())],
            scheduler_options={"dashboard": False, "dashboard_address": "127.0.0.1:0"}
            | configured("scheduler-options"),
            silence_logs=False,
        )
    except (OSError, ValueError, RuntimeError) as error:
        raise ClusterError(f"slurm: {cause(error)}") from error


def _cluster_class() -> Any:
    """Import the class; the import replaces the handler of Ctrl-C by one that ends the program with status 0."""
    if current_thread() is not main_thread():
        raise ClusterError("slurm: start the run in the main thread")
    handler = signal.getsignal(signal.SIGINT)
    try:
        from dask_jobqueue import SLURMCluster
    except ImportError as error:
        raise MissingExtraError("--cluster", "cluster") from error
    finally:
        signal.signal(signal.SIGINT, handler)
    return SLURMCluster


def _require_acceptance(script: str) -> None:
    """Raise `ClusterError` if SLURM would refuse a job, for example because of its partition."""
    done = subprocess.run(["sbatch", "--test-only"], input=script, capture_output=True, text=True, check=False)  # noqa: S607
    if done.returncode:
        lines = done.stderr.strip().splitlines() or ["sbatch failed"]
        raise ClusterError(f"slurm: {lines[-1]}")
