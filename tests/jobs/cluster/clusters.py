"""A Dask cluster of separate processes on this machine, with TLS."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import trustme

from seaclutter_cli.jobs.cluster.connection import FILES

ROOT = Path(__file__).parents[3]
_FILES = ("ca.pem", "cert.pem", "key.pem")
_IDLE = {
    "DASK_DISTRIBUTED__ADMIN__TICK__INTERVAL": "1s",
    "DASK_DISTRIBUTED__WORKER__MEMORY__MONITOR_INTERVAL": "2s",
    "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False",
}
"""Settings of Dask with which seven processes that wait take 3 % of a core, not 17 %."""


@dataclass(frozen=True)
class Certificates:
    """Files of an authority, and of a certificate that it has issued."""

    folder: Path

    def __post_init__(self):
        self.folder.mkdir()
        authority = trustme.CA()
        issued = authority.issue_cert("seaclutter")
        for part, file in zip(
            (authority.cert_pem, issued.cert_chain_pems[0], issued.private_key_pem), _FILES, strict=True
        ):
            part.write_to_path(self.folder / file)

    def environment(self):
        """Return the variables of seaclutter."""
        return {name: str(self.folder / file) for name, file in zip(FILES.values(), _FILES, strict=True)}

    def options(self):
        """Return the options of Dask's commands."""
        names = ("ca-file", "cert", "key")
        return [f"--tls-{name}={self.folder / file}" for name, file in zip(names, _FILES, strict=True)]


@dataclass
class Cluster:
    """A scheduler, and the workers that are added to it."""

    folder: Path
    certificates: Certificates
    processes: dict[str, subprocess.Popen] = field(default_factory=dict)

    def __post_init__(self):
        self.folder.mkdir()
        file = self.folder / "scheduler.json"
        words = ["--host=127.0.0.1", "--protocol=tls", "--port=0", f"--scheduler-file={file}", "--no-dashboard"]
        self.start("scheduler", *words)
        wait_for(lambda: file.exists() and file.read_text().strip().endswith("}"))
        self.address = json.loads(file.read_text())["address"]

    def add(self, name, *options, certificates=None, **environment):
        """Start a worker; options and variables of its environment may be added.

        With ``--no-nanny`` it is one process, which nothing starts again.
        """
        words = [self.address, f"--name={name}", "--nthreads=1", "--memory-limit=2GB", "--no-dashboard", *options]
        words.append(f"--local-directory={self.folder}")
        self.start("worker", *words, name=name, certificates=certificates, **environment)

    def start(self, command, *words, name=None, certificates=None, **environment):
        name = name or command
        line = [sys.executable, "-m", f"distributed.cli.dask_{command}", *words]
        line += (certificates or self.certificates).options()
        path = os.pathsep.join(filter(None, (environment.pop("PYTHONPATH", ""), str(ROOT))))
        with (self.folder / f"{name}.log").open("ab") as log:
            # Not in the current folder: paths that are relative to it must arrive.
            self.processes[name] = subprocess.Popen(
                line,
                cwd=self.folder,
                env={**os.environ, **_IDLE, "PYTHONPATH": path, **environment},
                stdout=log,
                stderr=log,
                start_new_session=True,
            )

    @property
    def workers(self):
        """Return the names of the workers."""
        return self.processes.keys() - {"scheduler"}

    def processes_of(self, name):
        """Return the processes that work for a worker, without the one that starts them again."""
        import psutil

        found = []
        for process in psutil.Process(self.processes[name].pid).children():
            with suppress(psutil.Error):  # it has just died
                if "spawn_main" in " ".join(process.cmdline()):
                    found.append(process)
        return found

    def logs(self):
        """Return what the processes have printed."""
        return "\n".join(path.read_text(errors="replace") for path in self.folder.glob("*.log"))

    def client(self):
        """Return another client."""
        from distributed import Client
        from distributed.security import Security

        paths = [str(self.certificates.folder / file) for file in _FILES]
        names = ("tls_ca_file", "tls_client_cert", "tls_client_key")
        security = Security(require_encryption=True, **dict(zip(names, paths, strict=True)))
        return Client(self.address, security=security, set_as_default=False)

    def end(self, *names):
        """Kill processes, by default all."""
        for name in names or list(self.processes):
            process = self.processes.pop(name)
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def wait_for(condition, seconds=60):
    """Wait for a condition."""
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until, "waited for too long"
        time.sleep(0.05)
