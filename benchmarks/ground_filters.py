"""Separation of sea and land beside the ground filters of PDAL, whose ground is taken for the sea.

Run as ``python benchmarks/ground_filters.py STUDY [TILE|SEED]... [--pdal PDAL]``. Studies: ``seas`` and ``coasts``
with seeds, ``real`` with tiles (LAS or LAZ), ``tune`` with seeds, which chooses the parameters of PDAL's filters.
Tables go to standard output. What is not installed is left out: the command ``pdal``, a package of Linux
distributions and of conda, and the package ``cloth-simulation-filter``, by the authors of what PDAL contains as ``csf``
(that of PDAL 2.2 fails with ``bad_alloc``).
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import laspy
import numpy as np
from coasts import COASTS, SIZE_M, coast_scene
from mistakes import picture
from seas import SEAS, with_sea

from seaclutter_cli.airborne.separation import separate
from seaclutter_cli.airborne.settings import TileSettings
from seaclutter_cli.airborne.surface import NEVER, OTHER, WATER
from seaclutter_cli.evaluation.confusion import Confusion
from seaclutter_cli.grids.opening import SurfaceParams
from seaclutter_cli.simulation.airborne.recording import simulate_strips
from seaclutter_cli.simulation.airborne.scene import TileScene, load_tile_scene

GROUND = 2
GOOD = 0.95
NOISE, CLASSES = (7, 18), (NEVER, OTHER, WATER)
ATTRIBUTES = ("intensity", "return_number", "number_of_returns", "point_source_id", "scan_angle")
STATES = {
    "seas": ("calm", "wind sea 0.5 m", "wind sea 1.1 m", "swell 1.5 m, 80 m long", "both: 1.0 and 1.1 m"),
    "coasts": ("calm", "wind sea 0.8 m", "swell 1.5 m, 80 m long"),
}
FEET = 0.3048

Mask = np.ndarray[Any, np.dtype[np.bool_]]
Parameters = Mapping[str, float | bool | str]

DEFAULTS: Mapping[str, Parameters] = {
    "pmf": {},
    "smrf": {},
    "csf": {"cloth_resolution": 1.0, "rigidness": 3, "class_threshold": 0.5, "bSloopSmooth": True},
}
TUNED: Mapping[str, Parameters] = {
    "pmf": {"max_window_size": 20, "slope": 0.02, "initial_distance": 1.2, "max_distance": 2.5},
    "smrf": {"window": 20, "slope": 0.01, "threshold": 1.2, "scalar": 0.0},
    "csf": {"cloth_resolution": 1.0, "rigidness": 3, "class_threshold": 1.2, "bSloopSmooth": False},
}
GRID: Mapping[str, Mapping[str, Sequence[float | bool]]] = {
    "pmf": {
        "max_window_size": (20,),
        "slope": (0.0, 0.02, 0.05),
        "initial_distance": (0.3, 0.5, 0.8, 1.2),
        "max_distance": (2.5,),
    },
    "smrf": {"window": (20,), "slope": (0.01, 0.05, 0.15), "threshold": (0.5, 0.8, 1.2, 1.8), "scalar": (0.0,)},
    "csf": {
        "cloth_resolution": (1.0,),
        "rigidness": (1, 3),
        "class_threshold": (0.5, 0.8, 1.2),
        "bSloopSmooth": (False,),
    },
}
TUNING_SEAS = ("calm", "wind sea 1.1 m", "swell 1.5 m, 80 m long")


@dataclass(frozen=True)
class Tile:
    """Points of a tile in metres, shape (3, N), their attributes, and their true classes."""

    xyz: np.ndarray[Any, np.dtype[np.float64]]
    columns: Mapping[str, np.ndarray[Any, Any]]
    truth: np.ndarray[Any, Any]

    def score(self, sea: Mask) -> tuple[float, float]:
        """Return kappa of sea and non-sea points, and the share of the ground called sea; without water, of all."""
        known = ~np.isin(self.truth, NOISE)
        own, found = (np.where(one[known], WATER, OTHER) for one in (self.truth == WATER, sea))
        ground = self.truth == GROUND
        if not (self.truth == WATER).any():
            return float("nan"), float(sea.mean())
        return Confusion.of(own, found, CLASSES).kappa, float(sea[ground].mean()) if ground.any() else float("nan")


Method = Callable[[Tile], Mask]
Rows = Iterable[tuple[str, Iterable[Tile]]]


def ours(params: SurfaceParams) -> Method:
    return lambda tile: separate([tile.xyz], params, tile.columns.get).classification == WATER


OURS: Mapping[str, Method] = {"as published": ours(SurfaceParams()), "separate": ours(TileSettings().separation)}


def pdal(command: str, name: str, params: Parameters) -> Method:
    """Return a filter of PDAL; with parameters, after ``filters.elm``, which finds low noise."""

    def run(tile: Tile) -> Mask:
        with TemporaryDirectory() as folder:
            source, target = (str(Path(folder) / f"{end}.las") for end in ("in", "out"))
            _write(tile, source)
            noise = [{"type": "filters.elm"}] if params else []
            ignore = {"ignore": "Classification[7:7]"} if params else {}
            stages = [source, *noise, {"type": f"filters.{name}", **params, **ignore}, target]
            pipeline = json.dumps({"pipeline": stages})
            subprocess.run([command, "pipeline", "--stdin"], input=pipeline, text=True, check=True)
            found = laspy.read(target)
            sea = np.zeros(tile.xyz.shape[1], np.bool_)
            sea[np.asarray(found.gps_time).astype(np.int64)] = np.asarray(found.classification) == GROUND
            return sea

    return run


def cloth(params: Parameters) -> Method:
    """Return the cloth simulation of last echoes, with PDAL's time step and number of iterations."""

    def run(tile: Tile) -> Mask:
        import CSF  # no part of the extras

        last = np.flatnonzero(tile.columns["return_number"] == tile.columns["number_of_returns"])
        simulation = CSF.CSF()
        for name, value in {**params, "time_step": 0.65, "interations": 500}.items():
            setattr(simulation.params, name, value)
        simulation.setPointCloud((tile.xyz - tile.xyz.min(axis=1, keepdims=True))[:, last].T.copy())
        ground, other = CSF.VecInt(), CSF.VecInt()
        with _silent():
            simulation.do_filtering(ground, other, exportCloth=False)
        sea = np.zeros(tile.xyz.shape[1], np.bool_)
        sea[last[np.array(ground, np.int64)]] = True
        return sea

    return run


@contextmanager
def _silent() -> Iterator[None]:
    """Discard what a library writes to standard output."""
    sys.stdout.flush()
    kept = os.dup(1)
    with Path(os.devnull).open("wb") as nothing:
        os.dup2(nothing.fileno(), 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


def _write(tile: Tile, path: str) -> None:
    """Write a tile without classes; times are the numbers of points, since filters of PDAL change their order."""
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales, header.offsets = np.full(3, 0.001), np.floor(tile.xyz.min(axis=1))
    las = laspy.LasData(header)
    las.x, las.y, las.z = tile.xyz
    for name in ("intensity", "return_number", "number_of_returns"):
        las[name] = tile.columns[name]
    las.gps_time = np.arange(tile.xyz.shape[1], dtype=np.float64)
    las.write(path)


def simulated(scene: TileScene) -> Tile:
    points = np.concatenate(list(simulate_strips(scene)))
    names = points.dtype.names or ()
    columns = {name: points[name] for name in names if name not in {"classification", "object_class", "object_id"}}
    return Tile(np.stack([points[axis] for axis in "xyz"]), columns, points["classification"])


def real(path: str) -> Tile:
    las = laspy.read(path)
    unit = FEET if "autzen" in path else 1.0
    names = [name for name in (*ATTRIBUTES, "gps_time") if name in las.point_format.dimension_names]
    columns = {name: np.asarray(las[name]) for name in names}
    return Tile(np.stack((las.x, las.y, las.z)) * unit, columns, np.asarray(las.classification))


def filters(command: str | None) -> dict[str, Callable[[Parameters], Method]]:
    """Return the ground filters that are installed."""
    found: dict[str, Callable[[Parameters], Method]] = {}
    if command is None:
        print("pdal: no such command; its filters pmf and smrf are left out", file=sys.stderr)
    else:
        found |= {name: partial(pdal, command, name) for name in ("pmf", "smrf")}
    if find_spec("CSF") is None:
        print("cloth-simulation-filter: not installed; csf is left out", file=sys.stderr)
    else:
        found["csf"] = cloth
    return found


def methods(command: str | None) -> dict[str, Method]:
    """Return all methods by their names in a table."""
    found = dict(OURS)
    for name, method in filters(command).items():
        found[f"{name}, defaults"], found[f"{name}, tuned"] = method(DEFAULTS[name]), method(TUNED[name])
    return found


def table(rows: Rows, chosen: Mapping[str, Method], pictures: Path | None) -> None:
    """Print kappa, lowest to highest, and the largest share of the ground called sea, for each row and method.

    Where the kappa of `separate` is less than 0.95, a picture shows the mistakes.
    """
    print(f"| tiles | {' | '.join(chosen)} |\n|{' --- |' * (len(chosen) + 1)}")
    for label, tiles in rows:
        scores: dict[str, list[tuple[float, float]]] = {name: [] for name in chosen}
        for number, tile in enumerate(tiles):
            for name, method in chosen.items():
                sea = method(tile)
                scores[name].append(tile.score(sea))
                if pictures and name == "separate" and scores[name][-1][0] < GOOD:
                    path = pictures / f"{re.sub('[^a-z0-9]+', '-', label)}-{number}.png"
                    path.write_bytes(picture(tile.xyz, tile.truth == WATER, sea))
        print(f"| {label} | {' | '.join(_shown(own) for own in scores.values())} |", flush=True)


def _shown(scores: Sequence[tuple[float, float]]) -> str:
    kappas, land = zip(*scores, strict=True)
    lowest, highest, worst = f"{min(kappas):.3f}", f"{max(kappas):.3f}", max(land)
    kappa = "" if np.isnan(kappas[0]) else lowest if lowest == highest else f"{lowest} to {highest}"
    share = "" if np.isnan(worst) else f"{100 * worst:.1f} %"
    return ", ".join(filter(None, (kappa, share)))


def tune(command: str | None, seeds: Sequence[int]) -> None:
    """Print the parameters of each filter with the highest mean kappa over some seas."""
    tiles = [simulated(sea_scene(SEAS[sea], seed)) for sea in TUNING_SEAS for seed in seeds]
    for name, make in filters(command).items():
        found = []
        for values in product(*GRID[name].values()):
            params = dict(zip(GRID[name], values, strict=True))
            method = make(params)
            found.append((float(np.mean([tile.score(method(tile))[0] for tile in tiles])), params))
        found.sort(key=lambda one: one[0], reverse=True)
        for kappa, params in found[:3]:
            print(f"{name}: {kappa:.3f} {json.dumps(params)}", flush=True)


def sea_scene(sea: tuple[float, ...], seed: int) -> TileScene:
    """Return a third of the objects of ``mixed`` on a tile of the size of the coasts."""
    scene = load_tile_scene("mixed")
    scene = replace(scene.with_tile(size_m=SIZE_M, gap_m=10.0, seed=seed), objects=scene.objects[::3])
    return with_sea(scene, sea)


def seas(seeds: Sequence[int], states: Sequence[str]) -> Rows:
    for label in states:
        yield label, (simulated(sea_scene(SEAS[label], seed)) for seed in seeds)


def coasts(seeds: Sequence[int], states: Sequence[str]) -> Rows:
    for name, sea in product(COASTS, states):
        yield f"{name}; {sea}", (simulated(with_sea(coast_scene(name, seed), SEAS[sea])) for seed in seeds)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("study", choices=("seas", "coasts", "real", "tune"))
    parser.add_argument("inputs", nargs="+", metavar="TILE|SEED")
    parser.add_argument("--pdal", default=shutil.which("pdal"))
    parser.add_argument("--ours", action="store_true", help="without other makers' filters")
    parser.add_argument("--sea", action="append", choices=SEAS, metavar="SEA", help="state of the sea; repeatable")
    parser.add_argument("--pictures", type=Path, metavar="FOLDER", help="draw the tiles with a kappa below 0.95")
    options = parser.parse_args()
    if options.pictures:
        options.pictures.mkdir(parents=True, exist_ok=True)
    chosen = OURS if options.ours else methods(options.pdal)
    if options.study == "real":
        table(((Path(path).name, [real(path)]) for path in options.inputs), chosen, options.pictures)
        return
    seeds = [int(seed) for seed in options.inputs]
    if options.study == "tune":
        tune(options.pdal, seeds)
    else:
        rows = {"seas": seas, "coasts": coasts}[options.study]
        table(rows(seeds, options.sea or STATES[options.study]), chosen, options.pictures)


if __name__ == "__main__":
    main()
