"""Many recordings: two processes compared with one, the cost of the engine, and a model of many workers on one NAS.

Run as ``python benchmarks/scaling.py FOLDER`` on Linux; the logs written there take 1.5 GB.
"""

import ctypes
import json
import os
import statistics
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from logs import SHARES, write_log

from seaclutter_cli.runs.batch import Work, run_all
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.options import BatchOptions
from seaclutter_cli.runs.recordings import Outcome
from seaclutter_cli.sources.recordings import Recording

RECORDINGS, FRAMES, RUNS = 16, 100, 5
TASKS, REPEATED = 2000, 5
_SET_CHILD_SUBREAPER = 36
WORKERS = (1, 2, 4, 8, 16, 32, 64, 128)
NETWORKS = {"1 Gbit/s": 0.117, "10 Gbit/s": 1.17, "25 Gbit/s": 2.9}
"""Throughput of a NAS in GB/s, by its network."""


@dataclass(frozen=True)
class Run:
    """Elapsed and CPU seconds of a run, and its manifest."""

    elapsed_s: float
    cpu_s: float
    rows: list[dict[str, float]]


def measure(logs: Path, jobs: int) -> Run:
    """Filter all logs of a folder with one thread in each process."""
    out, manifest = logs.with_name("filtered"), logs.with_name("runs.json")
    command = [sys.executable, "-m", "seaclutter_cli", "filter", str(logs), "-o", f"{out}/", "--force", "-q"]
    environment = {**os.environ, "SEACLUTTER_THREADS": "1"}
    started, before = time.perf_counter(), os.times()
    subprocess.run([*command, "-j", str(jobs), "--manifest", str(manifest)], check=True, env=environment)
    elapsed_s = time.perf_counter() - started
    with suppress(ChildProcessError):  # the server of the processes
        while True:
            os.wait()
    after = os.times()
    cpu_s = after.children_user + after.children_system - before.children_user - before.children_system
    return Run(elapsed_s, cpu_s, json.loads(manifest.read_text()))


@dataclass(frozen=True)
class Nothing(Work[Outcome]):
    """Work without any: what remains is the engine."""

    recording: Recording

    def fill(self, outcome: Outcome, observer: Observer) -> None:
        """Do nothing."""


def engine_cost(folder: Path) -> tuple[float, float]:
    """Return the start of two processes, and the time for each further recording, in seconds."""
    times: dict[int, float] = {}
    for tasks in (2, TASKS) * REPEATED:
        works = [Nothing(Recording((folder / f"{number}.mcap",))) for number in range(tasks)]
        started = time.perf_counter()
        run_all(works, BatchOptions(jobs=2), SILENT)
        times[tasks] = min(time.perf_counter() - started, times.get(tasks, np.inf))
    return times[2], (times[TASKS] - times[2]) / (TASKS - 2)


def throughput(workers: int, compute_s: float, stations_s: list[float]) -> float:
    """Return the jobs per second of workers that compute, then wait in line for shared stations: mean value analysis.

    Reiser and Lavenberg (1980), "Mean-value analysis of closed multichain queuing networks", J. ACM 27.
    """
    waiting, rate = [0.0] * len(stations_s), 0.0
    for number in range(1, workers + 1):
        stays = [service * (1 + line) for service, line in zip(stations_s, waiting, strict=True)]
        rate = number / (compute_s + sum(stays))
        waiting = [rate * stay for stay in stays]
    return rate


def model(compute_s: float, written: float, engine_s: float, size_gb: float) -> None:
    """Print the input per second for numbers of workers and networks, per recording of ``size_gb``."""
    print(f"\n{'workers':>8}" + "".join(f"{name:>12}" for name in NETWORKS) + "   GB/s of input (share of linear)")
    for workers in WORKERS:
        cells = []
        for bandwidth in NETWORKS.values():
            stations = [size_gb * (1 + written) / bandwidth, engine_s]
            alone = throughput(1, compute_s * size_gb, stations)
            rate = throughput(workers, compute_s * size_gb, stations)
            cells.append(f"{rate * size_gb:6.2f} {100 * rate / alone / workers:3.0f} %")
        print(f"{workers:>8}" + "".join(f"{cell:>12}" for cell in cells))
    for name, bandwidth in NETWORKS.items():
        print(f"{name}: saturated from {1 + compute_s * bandwidth / (1 + written):.0f} workers on")


def main(folder: Path) -> None:
    """Measure, then print the model."""
    ctypes.CDLL(None).prctl(_SET_CHILD_SUBREAPER, 1)  # so that the CPU time of all processes is known
    logs = folder / "logs"
    logs.mkdir(parents=True, exist_ok=True)
    for number in range(RECORDINGS):
        write_log(logs / f"sea{number:02}.mcap", FRAMES, SHARES["sea"])
    pairs = [(measure(logs, 1), measure(logs, 2)) for _ in range(RUNS)]
    for one, two in pairs:
        print(
            f"-j 1 {one.elapsed_s:6.1f} s, CPU {one.cpu_s:6.1f} s; -j 2 {two.elapsed_s:6.1f} s, CPU {two.cpu_s:6.1f} s"
        )
    ratios = [two.elapsed_s / one.elapsed_s for one, two in pairs]
    costs = [two.cpu_s / one.cpu_s - 1 for one, two in pairs]
    print(f"-j 2 / -j 1: {statistics.median(ratios):.3f} ({min(ratios):.3f} to {max(ratios):.3f})")
    more = statistics.median(costs)
    print(f"more CPU time with -j 2: {100 * more:.1f} %; on two free cores, the ratio is at least {(1 + more) / 2:.3f}")
    start_s, each_s = engine_cost(folder)
    best = min((one for one, _ in pairs), key=lambda run: run.cpu_s)
    seconds = statistics.median(row["seconds"] for row in best.rows)
    size_gb = statistics.mean(row["bytes_in"] for row in best.rows) / 1e9
    written = sum(row["bytes_out"] for row in best.rows) / sum(row["bytes_in"] for row in best.rows)
    print(f"engine: {start_s:.2f} s to start, {1000 * each_s:.2f} ms a recording")
    print(f"a recording of 10 s takes {seconds:.2f} s")
    print(f"overhead on recordings of 10 s: {100 * each_s / seconds:.2f} % and the start")
    compute_s = best.cpu_s / RECORDINGS / size_gb
    print(f"{compute_s:.1f} s of CPU per GB, {written:.2f} GB written per GB read, {size_gb:.3f} GB a recording")
    model(compute_s, written, each_s, size_gb)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
