"""Tiles that train the models of water and land: simulated ones by family, and public ones.

Tiles of ``coasts``, ``seas`` and ``scenes`` come from the project's simulator, under random seas and lidars; those of
``other``, ``small`` and ``more`` from an independent one. A name and a seed decide a tile.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import laspy
import numpy as np
from coasts import COASTS, coast_scene
from other_tiles import WORLDS, make
from seas import with_sea

from seaclutter_cli.simulation.airborne.recording import simulate_strips
from seaclutter_cli.simulation.airborne.scene import TileScene, load_tile_scene

WET = (9,)
FEET = 0.3048
SCENES = ("polder", "dam", "high", "shore", "calm_ships", "reefs", "farms")
SMALL = ("open sea",) * 4 + ("beach", "quay", "islands", "cliff", "hills", "open sea", "lake")
MORE = (
    "open sea", "cliff", "open sea", "quay", "polder", "open sea", "beach", "lock", "islands", "open sea", "fields",
    "river",
)  # fmt: skip
ATTRIBUTES = ("intensity", "return_number", "number_of_returns", "point_source_id", "gps_time")
_IGN = "ign-pdal-tools/test/data"
PUBLIC: Mapping[str, tuple[str, float]] = {  # file in a clone: licence of its repository, and unit in metres
    f"{_IGN}/classified_laz/test_data_77050_627755_LA93_IGN69.laz": ("MIT", 1.0),
    f"{_IGN}/test_data_77050_627760_LA93_IGN69.laz": ("MIT", 1.0),
    f"{_IGN}/test_data_77060_627755_LA93_IGN69.laz": ("MIT", 1.0),
    f"{_IGN}/test_data_77055_627755_LA93_IGN69.laz": ("MIT", 1.0),
    f"{_IGN}/las_with_origin_dsmMarker.laz": ("MIT", 1.0),
    f"{_IGN}/decimated_laz/test_semis_2021_0382_6565_LA93_IGN69_cropped.laz": ("MIT", 1.0),
    f"{_IGN}/decimated_laz/test_semis_2023_0292_6833_LA93_IGN69.laz": ("MIT", 1.0),
    f"{_IGN}/las_with_several_extra_byte_bloc.laz": ("MIT", 1.0),
    "PDAL/test/data/filters/hexbin-crop.las": ("BSD-3-Clause", FEET),
    "PDAL/test/data/las/4_6_crop.las": ("BSD-3-Clause", FEET),
    "PDAL/test/data/las/sample_c.las": ("BSD-3-Clause", 1.0),
    "Laserfarm/testdata/C_43FN1_1.LAZ": ("Apache-2.0", 1.0),
    "las-rs/tests/data/32-1-472-150-76.laz": ("MIT", 1.0),
    "laspy/tests/data/append-bug.laz": ("BSD-2-Clause", 1.0),
    "laspy/tests/data/file_with_both_wkt_and_geotiff_vlrs.las": ("BSD-2-Clause", 1.0),
}
Tile = dict[str, Any]


def random_sea(rng: np.random.Generator) -> tuple[float, float, float, float]:
    """Return height and length of a wind sea and of a swell: calm, a wind sea, or both."""
    kind = rng.random()
    if kind < 0.25:
        return (rng.uniform(0.02, 0.2), rng.uniform(4, 9), rng.choice([0, 0.25]), 100)
    length = rng.uniform(9, 40)
    if kind < 0.6:
        return (min(rng.uniform(0.2, 1.9), length / 20), length, 0, 100)
    return (rng.uniform(0.1, 0.4), rng.uniform(7, 12), rng.uniform(0.5, 1.8), rng.uniform(25, 120))


def degraded(tile: Tile, rng: np.random.Generator) -> Tile:
    """Return a tile as of sensors that compress, saturate or lack intensities, or lack strips or returns."""
    tile = dict(tile)
    form = rng.random()
    if form < 0.15:
        tile.pop("intensity", None)
    elif form < 0.25:
        root = np.sqrt(tile["intensity"].astype(float) / 65535)
        tile["intensity"] = (root * 255 * 3).clip(0, 255).astype(np.uint16)
    elif form < 0.3:
        most = np.quantile(tile["intensity"], rng.uniform(0.6, 0.98))
        tile["intensity"] = np.minimum(tile["intensity"], most).astype(np.uint16)
    elif form < 0.35:
        tile["intensity"] = np.zeros_like(tile["intensity"])
    for share, names in ((0.2, ("point_source_id", "gps_time")), (0.15, ("return_number", "number_of_returns"))):
        if rng.random() < share:
            tile = without(tile, names)
    return tile


def without(tile: Tile, names: tuple[str, ...]) -> Tile:
    return {name: values for name, values in tile.items() if name not in names}


def recorded(scene: TileScene) -> Tile:
    points = np.concatenate(list(simulate_strips(scene)))
    tile: Tile = {name: points[name] for name in points.dtype.names or ()}
    return tile | {"xyz": np.stack([points[axis] for axis in "xyz"])}


def simulated(family: str, kind: str, seed: int) -> Tile:
    """Return a tile of the project's simulator under a random sea and lidar."""
    rng = np.random.default_rng([seed, _number(family), _number(kind)])
    if family == "coasts":
        scene = with_sea(coast_scene(kind, seed), random_sea(rng))
    elif family == "seas":
        scene = load_tile_scene("mixed")
        width, height = (float(side) for side in rng.integers(260, 600, 2))
        scene = scene.with_tile(size_m=(width, height), gap_m=10.0, seed=seed)
        scene = with_sea(replace(scene, objects=scene.objects[::4]), random_sea(rng))
    else:
        scene = load_tile_scene(kind).with_tile(seed=seed)
        scene = with_sea(scene, random_sea(rng)) if rng.random() < 0.7 else scene
    lidar = replace(
        scene.lidar,
        pulses_m2=float(rng.uniform(0.8, 5)),
        overlap=float(rng.choice([0.05, 0.15, 0.5])),
        height_m=float(rng.uniform(350, 1200)),
        scan_angle_deg=float(rng.uniform(25, 50)),
    )
    try:
        tile = recorded(replace(scene, lidar=lidar))
    except ValueError:  # no such lidar
        tile = recorded(scene)
    return degraded(tile, rng)


def _number(name: str) -> int:
    return sum(ord(letter) * place for place, letter in enumerate(name, 1))


def small(kind: str, number: int) -> Tile:
    """Return a tile of 45 to 150 m; many have intensities or returns that tell nothing, or no attributes at all."""
    rng = np.random.default_rng([77, number])
    width, height = (int(side) for side in rng.integers(45, 150, 2))
    tile = make(kind, 5000 + number, (width, height))
    size, is_sea = len(tile["classification"]), kind == "open sea"
    if (kind != "hills" and rng.random() < 0.5) or (is_sea and rng.random() < 0.6):
        if is_sea or rng.random() < 0.3:
            tile["return_number"] = rng.integers(1, 3, size).astype(np.uint8)
            is_two = rng.random() < 0.7
            tile["number_of_returns"] = np.full(size, 2, np.uint8) if is_two else rng.integers(1, 4, size)
        random, constant = rng.integers(0, 2000, size), np.full(size, int(rng.integers(0, 3000)))
        noisy = rng.normal(900, rng.choice([90, 300]), size).clip(0)
        tile["intensity"] = (random, constant, noisy)[int(rng.integers(3))].astype(np.uint16)
    return without(tile, ATTRIBUTES) if rng.random() < 0.3 else tile


def more(kind: str, number: int) -> Tile:
    """Return a tile of 120 to 400 m with only elevations, or with intensities that only tell land from water."""
    rng = np.random.default_rng([78, number])
    width, height = (int(side) for side in rng.integers(120, 400, 2))
    tile = make(kind, 7000 + number, (width, height))
    if rng.random() < 0.6 and kind != "fields":
        return without(tile, ATTRIBUTES)
    if rng.random() < 0.7:
        land = tile["classification"] != WET[0]
        size, bright = len(land), rng.normal(200, 40, len(land))
        dark = rng.gamma(2, 30, size) if rng.random() < 0.5 else rng.normal(60, 10, size)
        tile = without(tile, ("return_number", "point_source_id", "gps_time"))
        tile["intensity"] = np.where(land, bright, dark).clip(0).astype(np.uint16)
        tile["number_of_returns"] = np.ones(size, np.uint8)
    return tile


def simulations(rounds: int) -> Iterator[tuple[str, Callable[[], Tile]]]:
    """Yield names of tables of simulated tiles, and what makes the tiles."""
    for number in range(rounds):
        for kind in WORLDS:
            yield f"other__{kind}__{1000 + number}", partial(make, kind, 1000 + number)
        jobs = [("coasts", kind, 20_000 + number) for kind in COASTS]
        jobs += [("seas", "mixed", 30_000 + 3 * number + part) for part in range(3)]
        jobs += [("scenes", SCENES[number % len(SCENES)], 40_000 + number)]
        for family, kind, seed in jobs:
            yield f"{family}__{kind}__{seed}", partial(simulated, family, kind, seed)
    for family, maker, kinds, share in (("small", small, SMALL, 9.3), ("more", more, MORE, 8.6)):
        for number in range(round(share * rounds)):
            kind = kinds[number % len(kinds)]
            yield f"{family}__{kind}__{number}", partial(maker, kind, number)


def windows(path: Path, unit_m: float) -> Iterator[Tile]:
    """Yield a public tile: whole, a window of 90 to 350 m, and two such windows as of other sensors."""
    las = laspy.read(path)
    whole: Tile = {name: np.asarray(las[name]) for name in ATTRIBUTES if name in las.point_format.dimension_names}
    whole |= {"xyz": np.stack((las.x, las.y, las.z)) * unit_m, "classification": np.asarray(las.classification)}
    yield whole
    xy = whole["xyz"][:2]
    low, high = xy.min(axis=1), xy.max(axis=1)
    for number in (1, 2, 3):
        rng = np.random.default_rng(number)
        width = np.minimum(high - low, rng.uniform(90, 350, 2))
        corner = low + rng.uniform(0, 1, 2) * (high - low - width)
        inside = ((xy >= corner[:, None]) & (xy < (corner + width)[:, None])).all(axis=0)
        part = {name: values[..., inside] for name, values in whole.items()}
        if np.count_nonzero(inside) >= 2000:
            yield degraded(part, rng) if number > 1 else part
