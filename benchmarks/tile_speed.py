"""Times of the classification of tiles: python benchmarks/tile_speed.py FOLDER MODEL.

Whole processes, file to file: `classify separate` of one million points, LAS and LAZ; `classify predict` of a tile with
100,000 points that are no sea. MODEL is one that benchmarks/tiles.py has written.
"""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from statistics import median
from time import perf_counter

import laspy

from seaclutter_cli.simulation.tiles import record_tile
from seaclutter_cli.simulation.tiles_scene import load_tile_scene


def tiles(folder: Path) -> dict[str, Path]:
    """Return one million points as LAS and LAZ, and a tile with many points that are no sea."""
    whole, dense = folder / "whole.laz", folder / "dense.laz"
    if not whole.exists():
        record_tile(load_tile_scene("fig3"), whole)
        las = laspy.read(whole)
        las.points = las.points[:1_000_000]
        for suffix in ("las", "laz"):
            las.write(folder / f"million.{suffix}")
    if not dense.exists():
        scene = load_tile_scene("mixed").with_tile(seed=5)
        record_tile(replace(scene, lidar=replace(scene.lidar, height_m=400.0, pulses_m2=3.4)), dense)
    return {"las": folder / "million.las", "laz": folder / "million.laz", "dense": dense}


def run(*arguments: str) -> tuple[float, float, float]:
    """Return seconds by the clock, seconds of both cores together, and peak memory in MB."""
    command = [sys.executable, "-m", "seaclutter_cli", "classify", *arguments, "--force"]
    started = perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    text = process.stdout.read() if process.stdout else ""
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{' '.join(command)} failed")
    seconds = perf_counter() - started
    print("   ", text.splitlines()[-1], flush=True)
    return seconds, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def main() -> None:
    folder, model = Path(sys.argv[1]), sys.argv[2]
    made = tiles(folder)
    jobs = {
        "separate, LAS": ("separate", str(made["las"]), "-o", str(folder / "o.las")),
        "separate, LAZ": ("separate", str(made["laz"]), "-o", str(folder / "o.laz")),
        "separate, 100,000 not sea": ("separate", str(made["dense"]), "-o", str(folder / "d.laz")),
        "predict, 100,000 not sea": ("predict", str(made["dense"]), "--model", model, "-o", str(folder / "d.laz")),
    }
    for name, arguments in jobs.items():
        found = [run(*arguments) for _ in range(3)]
        clock, cores, memory = (median(column) for column in zip(*found, strict=True))
        least = min(seconds for seconds, *_ in found)
        print(f"{name}: {clock:.2f} s (least {least:.2f}), {cores:.2f} s of CPU, {memory:.0f} MB", flush=True)


if __name__ == "__main__":
    main()
