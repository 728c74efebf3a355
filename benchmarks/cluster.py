"""Time of a task on a cluster, and memory of the process that gives them out: ``cluster.py tls://HOST:PORT [TASKS]``.

Workers must be able to import this module: ``PYTHONPATH=benchmarks dask worker ...``. Certificates are those of Dask's
configuration, or of the environment (docs/guide/cluster.md).
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from seaclutter_cli.jobs.cluster.connection import connection_to
from seaclutter_cli.jobs.cluster.engine import Cluster
from seaclutter_cli.jobs.engine import Report


@dataclass(frozen=True)
class Nothing:
    """A task, or a check that finds no obstacle."""

    def __call__(self, report: Report) -> None:
        """Return."""


def resident_mb() -> float:
    """Return the memory of this process in MB; 0 where it is not known."""
    file = Path("/proc/self/status")
    lines = file.read_text().splitlines() if file.exists() else []
    return sum(int(line.split()[1]) for line in lines if line.startswith("VmRSS:")) / 1000


def main(address: str, tasks: int) -> None:
    """Run tasks and print figures."""
    from cluster import Nothing as Importable  # not of __main__, which workers do not have

    engine = Cluster(connection_to(address), Importable(), print)
    started = 0.0
    for number, _ in enumerate(engine([Importable()] * tasks, lambda *_: None)):
        started = started or perf_counter()
        if number % max(1, tasks // 10) == 0:
            print(f"{number:8,} tasks  {resident_mb():6.1f} MB")
    print(f"{(perf_counter() - started) / tasks * 1000:.1f} ms a task")


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 10_000)
