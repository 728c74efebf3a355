"""Speed of the classification of tiles as whole processes, from file to file.

Run as ``python benchmarks/tile_speed.py FOLDER MODEL [PDAL]``. It times ``classify separate`` on one million points,
LAS and LAZ, alternating with the ground filters of PDAL if its command is given, and ``classify predict`` on a tile
with 100,000 non-sea points. MODEL is a model written by ``benchmarks/tiles.py``.
"""

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median
from time import perf_counter

import laspy

from seaclutter_cli.simulation.airborne.recording import record_tile
from seaclutter_cli.simulation.airborne.scene import load_tile_scene


def tiles(folder: Path) -> dict[str, Path]:
    """Return paths of one million points as LAS and LAZ, and of a tile with many non-sea points."""
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


def classify(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "seaclutter_cli", "classify", *arguments, "--force", "-q"]


def run(command: Sequence[str]) -> tuple[float, float, float]:
    """Return elapsed seconds, processor seconds of both cores, and peak memory in MB."""
    started = perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    if process.stdout:
        process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{' '.join(command)} failed")
    seconds = perf_counter() - started
    return seconds, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def main() -> None:
    folder, model, *pdal = Path(sys.argv[1]), *sys.argv[2:]
    made = tiles(folder)
    las, laz, dense = (str(path) for path in made.values())
    out = str(folder / "out")
    for tile, suffix in ((las, ".las"), (laz, ".laz")):
        separate = {f"separate, {suffix}": classify("separate", tile, "-o", out + suffix)}
        names = ("pmf", "smrf") if pdal else ()
        filters = {f"PDAL {name}, {suffix}": [*pdal, "translate", tile, f"{out}.p{suffix}", name] for name in names}
        report({**separate, **filters})
    named = classify("predict", dense, "--model", model, "-o", f"{out}.d.laz")
    report({"separate, dense tile": classify("separate", dense, "-o", f"{out}.d.laz"), "predict, dense tile": named})


def report(commands: Mapping[str, Sequence[str]], runs: int = 5) -> None:
    """Run commands alternately; print medians and the ratio of the time of the first command to each."""
    found: dict[str, list[tuple[float, float, float]]] = {name: [] for name in commands}
    for _ in range(runs):
        for name, command in commands.items():
            found[name].append(run(command))
    first = next(iter(found.values()))
    for name, times in found.items():
        clock, cores, memory = (median(column) for column in zip(*times, strict=True))
        ratio = median(one[0] / other[0] for one, other in zip(first, times, strict=True))
        spread = f"{min(times)[0]:.2f} to {max(times)[0]:.2f}"
        print(f"| {name} | {clock:.2f} s ({spread}) | {cores:.2f} s | {memory:.0f} MB | {ratio:.2f} |", flush=True)


if __name__ == "__main__":
    main()
