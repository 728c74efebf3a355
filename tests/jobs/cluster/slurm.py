"""SLURM on this machine: a controller and one node, without munge."""

import os
import shutil
import socket
import subprocess
from contextlib import suppress
from pathlib import Path

import psutil

from tests.jobs.cluster.clusters import wait_for

PROGRAMS = ("slurmctld", "slurmd", "sbatch", "scancel", "squeue", "sinfo")
_PLUGINS = Path("/usr/lib/x86_64-linux-gnu/slurm-wlm")
_CONFIGURATION = """
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
SlurmUser=root
AuthType=auth/none
CredType=cred/none
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=sched_interval=1,batch_sched_delay=0
SlurmdParameters=config_overrides
MpiDefault=none
ReturnToService=2
KillWait=2
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
NodeName={host} NodeAddr=127.0.0.1 CPUs=4 RealMemory=16000 State=UNKNOWN
PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""


def obstacle():
    """Return why SLURM cannot be started here; None if it can."""
    missing = [name for name in PROGRAMS if shutil.which(name) is None]
    if missing:
        return f"SLURM is not installed (Debian: slurmctld, slurmd, slurm-client): no {', '.join(missing)}"
    if os.geteuid() != 0:
        return "slurmd must be started by root"
    if not (_PLUGINS / "auth_none.so").exists():
        return "this SLURM has no auth/none"
    return None


class Slurm:
    """A controller and a node, and the environment for its commands."""

    def __init__(self, folder):
        for name in ("state", "spool"):
            (folder / name).mkdir(parents=True)
        self.configuration = folder / "slurm.conf"
        host = socket.gethostname().partition(".")[0]
        self.configuration.write_text(_CONFIGURATION.format(folder=folder, host=host, ports=free_ports(2)))
        self._environment = {**os.environ, "SLURM_CONF": str(self.configuration)}
        self._processes = [self._start(name, folder) for name in ("slurmctld", "slurmd")]
        wait_for(lambda: "idle" in self.ask("sinfo", "--noheader", "--format=%T"))

    def _start(self, name, folder):
        with (folder / f"{name}.out").open("wb") as log:
            return subprocess.Popen([name, "-D"], env=self._environment, stdout=log, stderr=log, start_new_session=True)

    def ask(self, *words):
        """Return what a command prints."""
        return subprocess.run(words, env=self._environment, capture_output=True, text=True, check=False).stdout

    def jobs(self):
        """Return the numbers of jobs that wait or run."""
        return self.ask("squeue", "--noheader", "--format=%A").split()

    def end(self):
        self.ask("scancel", "--user=root")
        for process in reversed(self._processes):
            for child in psutil.Process(process.pid).children(recursive=True):
                with suppress(psutil.Error):
                    child.kill()
            process.kill()
            process.wait()


def free_ports(number):
    sockets = [socket.create_server(("127.0.0.1", 0)) for _ in range(number)]
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports
