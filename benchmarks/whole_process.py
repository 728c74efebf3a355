"""Whole process: ``seaclutter filter`` compared with a copy of the same log, and memory over the length of a log.

Run as ``python benchmarks/whole_process.py FOLDER`` on Linux or macOS; the logs written there take some gigabytes.
"""

import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

from logs import SHARES, write_log

HERE = Path(__file__).resolve().parent
RUNS = 5


def measure(command: list[str]) -> tuple[float, float]:
    """Return elapsed seconds and peak memory in MB of a process."""
    started = time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = status
    if status:
        sys.exit(f"failed: {command}")
    unit = 2**20 if sys.platform == "darwin" else 2**10
    return time.perf_counter() - started, usage.ru_maxrss / unit


def filter_command(log: Path) -> list[str]:
    out = log.with_name("filtered.mcap")
    return [sys.executable, "-m", "seaclutter_cli", "filter", str(log), "-o", str(out), "--force", "-q"]


def copy_command(log: Path) -> list[str]:
    return [sys.executable, str(HERE / "copy_log.py"), str(log), str(log.with_name("copy.mcap"))]


def compare(name: str, log: Path, frames: int) -> None:
    """Print the times of a filter run and of a copy, alternating, after one untimed run of each."""
    pairs = [(measure(filter_command(log)), measure(copy_command(log))) for _ in range(RUNS + 1)][1:]
    ratios = [ours[0] / copy[0] for ours, copy in pairs]
    ours, copy = (statistics.median(pair[side][0] for pair in pairs) for side in (0, 1))
    spread = f"({min(ratios):.2f} to {max(ratios):.2f})"
    peak = max(pair[0][1] for pair in pairs)
    print(f"{name:<10}{ours:>10.2f}{copy:>10.2f}{statistics.median(ratios):>8.2f}{spread:>17}", end="")
    print(f"{frames / ours:>10.0f}{peak:>7.0f}")


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    print(f"{'log':<10}{'filter s':>10}{'copy s':>10}{'ratio':>8}{'':>17}{'frames/s':>10}{'MB':>7}")
    for name, share in SHARES.items():
        log = folder / f"{name}-500.mcap"
        write_log(log, 500, share)
        compare(name, log, 500)
    peaks = {}
    for frames in (500, 2000):
        log = folder / f"sea-{frames}.mcap"
        write_log(log, frames, SHARES["sea"])
        peaks[frames] = max(measure(filter_command(log))[1] for _ in range(3))
    print(f"peak memory: {peaks[500]:.0f} MB for 500 frames, {peaks[2000]:.0f} MB for 2,000")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
