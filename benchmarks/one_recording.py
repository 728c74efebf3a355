"""One recording: which share of the work can be done by several threads, and which depends on the frame before.

Run as ``python benchmarks/one_recording.py FOLDER``. CPU times of threads are measured, with one thread for each kind
of work, so other programs have little influence.
"""

import os
import sys
import time
from pathlib import Path
from typing import Any

os.environ["SEACLUTTER_THREADS"] = "1"

import small_gicp
from logs import SHARES, write_log

from seaclutter_cli.runs.filter import filter_log

FRAMES, RUNS = 100, 3


class Searches:
    """CPU time of the search for neighbours."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._tree = small_gicp.KdTree
        self._tree.batch_knn_search = self._timed(self._tree.batch_knn_search)

    def _timed(self, function: Any) -> Any:
        def timed(*arguments: Any, **options: Any) -> Any:
            started = time.thread_time()
            try:
                return function(*arguments, **options)
            finally:
                self.seconds += time.thread_time() - started

        return timed


def shares(log: Path, searches: Searches) -> tuple[float, float, float, float]:
    """Return CPU milliseconds per frame: all, reading and writing in other threads, neighbour search, and the rest."""
    best = None
    for _ in range(RUNS):
        searches.seconds, process, thread = 0.0, time.process_time(), time.thread_time()
        filter_log(str(log), str(log.with_name("filtered.mcap")), force=True)
        total, main = time.process_time() - process, time.thread_time() - thread
        parts = (total, total - main, searches.seconds, main - searches.seconds)
        best = parts if best is None or total < best[0] else best
    assert best is not None
    total, files, search, rest = (1000 * seconds / FRAMES for seconds in best)
    return total, files, search, rest


def main(folder: Path) -> None:
    """Print the shares for two logs."""
    folder.mkdir(parents=True, exist_ok=True)
    searches = Searches()
    print(f"{'log':<9}{'ms/frame':>9}{'files':>8}{'search':>8}{'in turn':>9}{'at most':>10}")
    for name, share in SHARES.items():
        log = folder / f"one-{name}.mcap"
        write_log(log, FRAMES, share)
        total, *parts = shares(log, searches)
        cells = "".join(f"{100 * part / total:6.0f} %" for part in parts)
        print(f"{name:<9}{total:>9.1f}{cells}{total / parts[-1]:>8.1f} x")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
