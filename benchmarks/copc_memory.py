"""Peak memory of the separation of COPC files in windows: it must depend on the window, not on the survey.

Run as ``python benchmarks/copc_memory.py FOLDER [SIDE]...``. A survey of SIDE by SIDE copies of a simulated tile of 1.4
million points (875 m by 695 m) is written to FOLDER as COPC with chunks of about 10^5 points, by default for SIDE 1 and
2, and separated in windows of 250 and 500 m. Memory is that of the whole process.
"""

import os
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter
from typing import Any

import laspy
import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.simulation.airborne.recording import record_tile
from seaclutter_cli.simulation.airborne.scene import load_tile_scene
from tests.airborne.copc import write_copc

CHUNK_POINTS = 100_000
WINDOWS_M = (250, 500)
SEED = 5


def octree(tile: Any, low: NDArray[np.float64], half: float) -> dict[tuple[int, ...], NDArray[np.intp]]:
    """Return the points of each node: points in random order fill the levels from the root, four nodes to a node."""
    place = np.stack([np.asarray(tile[axis]) for axis in "xyz"], axis=1)
    levels = 0
    while CHUNK_POINTS * sum(4**level for level in range(levels + 1)) < len(place):
        levels += 1
    filled = np.cumsum([4.0**level for level in range(levels + 1)])
    level_of = np.searchsorted(filled / filled[-1], np.random.default_rng(0).random(len(place)))
    nodes: dict[tuple[int, ...], NDArray[np.intp]] = {}
    for level in range(levels + 1):
        own = np.flatnonzero(level_of == level)
        cell = np.minimum((place[own] - low) // (2 * half / 2**level), 2**level - 1).astype(int)
        keys, number = np.unique(cell, axis=0, return_inverse=True)
        for index, key in enumerate(keys.tolist()):
            nodes[level, *key] = own[number.ravel() == index]
    return nodes


def survey(folder: Path, side: int) -> Path:
    """Return a COPC file with copies of a tile beside each other."""
    path, one = folder / f"survey_{side}.copc.laz", folder / "tile.laz"
    if not one.exists():
        record_tile(load_tile_scene("mixed").with_tile(seed=SEED), one)
    if not path.exists():
        tile = laspy.read(one)
        steps = np.round((tile.header.maxs - tile.header.mins) / tile.header.scales).astype(int)
        copies = []
        for column, row in np.ndindex(side, side):
            points = tile.points.array.copy()
            points["X"] += column * steps[0]
            points["Y"] += row * steps[1]
            copies.append(points)
        whole = folder / "whole.laz"
        tile.points = laspy.PackedPointRecord(np.concatenate(copies), tile.point_format)
        tile.write(whole)
        write_copc(path, whole, octree)
        whole.unlink()
    return path


def separate(path: Path, window_m: int, output: Path) -> tuple[float, float]:
    """Return elapsed seconds and peak memory in MB of the separation."""
    command = [sys.executable, "-m", "seaclutter_cli", "classify", "separate", str(path), "-o", f"{output}/"]
    started = perf_counter()
    process = subprocess.Popen([*command, "--window", str(window_m), "-j", "1", "--force", "-q"])
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{path}: the separation failed")
    return perf_counter() - started, usage.ru_maxrss / 1024


def main() -> None:
    folder, sides = Path(sys.argv[1]), [int(side) for side in sys.argv[2:]] or [1, 2]
    folder.mkdir(exist_ok=True)
    print("| points | window | windows | seconds | peak memory |\n| ---: | ---: | ---: | ---: | ---: |")
    for side in sides:
        with ProcessPoolExecutor(1, get_context("spawn")) as pool:  # the peak of a process counts for those it starts
            path = pool.submit(survey, folder, side).result()
        with laspy.open(path) as reader:
            points = reader.header.point_count
        for window_m in WINDOWS_M:
            output = folder / f"separated_{side}_{window_m}"
            seconds, memory = separate(path, window_m, output)
            windows = len(list(output.iterdir()))
            print(f"| {points:,} | {window_m} m | {windows} | {seconds:.0f} | {memory:.0f} MB |", flush=True)


if __name__ == "__main__":
    main()
