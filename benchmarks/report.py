"""Speed of ``seaclutter report`` on a filtered log, compared with reading that log once.

Run as ``python benchmarks/report.py FOLDER``; the logs written there take some gigabytes. Reading means that ``mcap``,
or the reader of seaclutter, yields every message without decoding it. Processor time adds both cores; compare it if
the machine is busy with other work.
"""

import os
import statistics
import sys
from pathlib import Path

from logs import SHARES, write_log
from whole_process import measure

FRAMES = 2000
RUNS = 3
READ = """
import sys
from mcap.reader import make_reader
with open(sys.argv[1], "rb") as stream:
    for _ in make_reader(stream).iter_messages():
        pass
"""
READ_OURS = """
import sys
from contextlib import closing
from pathlib import Path
from seaclutter_cli.sources.formats import open_source
with closing(open_source(Path(sys.argv[1]))) as source:
    for _ in source.records():
        pass
"""


def filtered_log(folder: Path, name: str) -> Path:
    """Return a filtered log with all data for a report, written unless it exists."""
    raw, filtered = folder / f"{name}-{FRAMES}.mcap", folder / f"{name}-{FRAMES}.filtered.mcap"
    if not filtered.exists():
        write_log(raw, FRAMES, SHARES[name])
        options = ["--keep-raw", "--with-removed", "-q", "-o", str(filtered)]
        measure([sys.executable, "-m", "seaclutter_cli", "filter", str(raw), *options])
    return filtered


def timed(command: list[str]) -> tuple[float, float, float]:
    """Return seconds, seconds of processor time, and peak megabytes of a process."""
    before = os.times()
    seconds, peak = measure(command)
    after = os.times()
    spent = after.children_user + after.children_system - before.children_user - before.children_system
    return seconds, spent, peak


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    page = folder / "report.html"
    print(f"{'log':<10}{'time':<10}{'report s':>10}{'mcap s':>10}{'own s':>10}{'ratio':>8}{'MB':>7}{'page MB':>9}")
    for name in SHARES:
        log = str(filtered_log(folder, name))
        report = [sys.executable, "-m", "seaclutter_cli", "report", log, "-o", str(page), "--force", "-q"]
        reads = ([sys.executable, "-c", code, log] for code in (READ, READ_OURS))
        commands = (report, *reads)
        rounds = [[timed(command) for command in commands] for _ in range(RUNS + 1)][1:]
        peak = max(one[0][2] for one in rounds)
        for column, kind in enumerate(("elapsed", "processor")):
            times = [statistics.median(one[index][column] for one in rounds) for index in range(3)]
            ratio = statistics.median(one[0][column] / one[1][column] for one in rounds)
            print(f"{name:<10}{kind:<10}{times[0]:>10.2f}{times[1]:>10.2f}{times[2]:>10.2f}{ratio:>8.2f}", end="")
            print(f"{peak:>7.0f}{page.stat().st_size / 1e6:>9.1f}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
