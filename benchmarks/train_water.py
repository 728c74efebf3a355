"""Train the model that tells water from land in airborne tiles, and measure it on tiles that it has not seen.

Run as ``python benchmarks/train_water.py FOLDER --tiles NUMBER [--public FOLDER] [--measure] [-o water.npz]``. FOLDER
keeps the tables of features, so that a second run trains at once. Families of tiles: ``seas``, ``coasts`` and
``scenes`` of the simulator, ``independent`` (`other_tiles.py`), ``small`` ones of it, and ``real`` (`PUBLIC`).
``--measure`` trains without each family in turn, and prints which share of its squares is wrong, and what each feature
is worth. `ahn3_sluice.laz` and `autzen_trim.laz` are in no family.
"""

import argparse
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import laspy
import numpy as np
from coasts import COASTS, coast_scene
from numpy.typing import NDArray
from other_tiles import WORLDS, make
from seas import with_sea
from sklearn.ensemble import HistGradientBoostingClassifier

from seaclutter_cli.airborne.separation import LeveledTile
from seaclutter_cli.airborne.squares import Squares, square_of, squares_in
from seaclutter_cli.airborne.surface import SeparationParams
from seaclutter_cli.airborne.water_model import UNIT, Trees, around
from seaclutter_cli.grids.points import NOWHERE, GriddedPoints
from seaclutter_cli.simulation.airborne.recording import simulate_strips
from seaclutter_cli.simulation.airborne.scene import TileScene, load_tile_scene

WET, OBJECT, NO_LAND = (9,), (1,), (0, 1, 7, 9, 18)
ROWS, LEAVES, FIRST, SECOND = 300, 24, 100, 50
FEET = 0.3048
PUBLIC: Mapping[str, tuple[str, float]] = {  # pattern of the file: licence of its repository, and unit in metres
    "ign-pdal-tools/test/data/**/*.laz": ("MIT", 1.0),
    "PDAL/test/data/filters/hexbin-crop.las": ("BSD-3-Clause", FEET),
    "PDAL/test/data/las/sample_c.las": ("BSD-3-Clause", 1.0),
    "PDAL/test/data/las/4_6_crop.las": ("BSD-3-Clause", FEET),
    "laspy/tests/data/append-bug.laz": ("BSD-2-Clause", 1.0),
    "Laserfarm/testdata/C_43FN1_1.LAZ": ("Apache-2.0", 1.0),
    "las-rs/tests/data/32-1-472-150-76.laz": ("MIT", 1.0),
}
Tile = dict[str, Any]


@dataclass(frozen=True)
class Rows:
    """Features of the squares of a tile, shape (N, F), whether they are water, and their weights, shape (N,)."""

    squares: Squares
    names: tuple[str, ...]
    table: NDArray[np.float32]
    wet: NDArray[np.bool_]
    weight: NDArray[np.float64]


def rows_of(tile: Tile, *, is_real: bool) -> Rows:
    """Return the rows of a tile; objects stand in water, but of real tiles it is not known what is unclassified."""
    truth = tile["classification"]
    params = SeparationParams()
    points = GriddedPoints.of([tile["xyz"]], params.cell_m)
    leveled = LeveledTile.of(points, params, lambda name: None if name == "classification" else tile.get(name))
    names, table = leveled.table()
    cell = np.concatenate(points.cells)
    used = cell != NOWHERE
    square, size = square_of(cell[used]), squares_in(points.grid)
    kinds = [np.isin(truth[used], WET), np.isin(truth[used], OBJECT), ~np.isin(truth[used], NO_LAND)]
    wet, objects, dry = (np.bincount(square, kind, size)[leveled.squares.index] for kind in kinds)
    wet = wet + (0 if is_real else objects)
    return Rows(leveled.squares, names, table, wet > dry, np.abs(wet - dry) / np.maximum(wet + dry, 1))


def random_sea(scene: TileScene, rng: np.random.Generator) -> TileScene:
    length = rng.uniform(9, 40)
    wind = (min(rng.uniform(0.2, 1.9), length / 20), length, 0.0, 100.0)
    calm = (rng.uniform(0.02, 0.2), rng.uniform(4, 9), rng.choice([0, 0.25]), 100.0)
    swell = (rng.uniform(0.1, 0.4), rng.uniform(7, 12), rng.uniform(0.5, 1.8), rng.uniform(25, 120))
    return with_sea(scene, (calm, wind, swell)[rng.choice(3, p=(0.25, 0.35, 0.4))])


def simulated(scene: TileScene, rng: np.random.Generator) -> Tile:
    """Return a scene under a random sea and lidar; some sensors record no intensities, returns or strips."""
    lidar = replace(
        scene.lidar,
        pulses_m2=float(rng.uniform(0.8, 5)),
        overlap=float(rng.choice([0.05, 0.15, 0.5])),
        height_m=float(rng.uniform(350, 1200)),
        scan_angle_deg=float(rng.uniform(25, 50)),
    )
    points = np.concatenate(list(simulate_strips(replace(random_sea(scene, rng), lidar=lidar))))
    tile: Tile = {name: points[name] for name in points.dtype.names or ()}
    tile["xyz"] = np.stack([points[axis] for axis in "xyz"])
    return without_some(tile, rng)


def without_some(tile: Tile, rng: np.random.Generator) -> Tile:
    form = rng.random()
    if "intensity" in tile:
        value = tile["intensity"].astype(np.float64)
        if form < 0.25:
            tile["intensity"] = np.minimum(np.sqrt(value), 255).astype(np.uint16)
        elif form < 0.35:
            tile["intensity"] = np.minimum(value, np.quantile(value, rng.uniform(0.6, 0.98)))
    gone = [("intensity",)] * (form > 0.85) + [("point_source_id", "gps_time")] * (rng.random() < 0.2)
    gone += [("return_number", "number_of_returns")] * (rng.random() < 0.15)
    return {name: values for name, values in tile.items() if not any(name in names for names in gone)}


def coast(number: int, rng: np.random.Generator) -> Tile:
    return simulated(coast_scene(list(COASTS)[number % len(COASTS)], 20_000 + number), rng)


def sea(number: int, rng: np.random.Generator) -> Tile:
    scene = load_tile_scene("mixed")
    width, height = rng.integers(260, 600, 2)
    scene = scene.with_tile(size_m=(float(width), float(height)), gap_m=10.0, seed=30_000 + number)
    return simulated(replace(scene, objects=scene.objects[::4]), rng)


def scene_tile(number: int, rng: np.random.Generator) -> Tile:
    names = ("polder", "dam", "high", "shore", "calm_ships", "reefs", "farms")
    return simulated(load_tile_scene(names[number % len(names)]).with_tile(seed=40_000 + number), rng)


def independent(number: int, _rng: np.random.Generator) -> Tile:
    return make(list(WORLDS)[number % len(WORLDS)], 1000 + number // len(WORLDS))


def small(number: int, rng: np.random.Generator) -> Tile:
    """Return a small tile, or one whose attributes tell nothing."""
    kind = ("open sea", "cliff", "quay", "open sea", "beach", "islands", "hills", "lock")[number % 8]
    side, other = rng.integers(45, 400, 2)
    tile = make(kind, 5000 + number, (int(side), int(other)))
    size = len(tile["classification"])
    if rng.random() < 0.4:
        return {name: tile[name] for name in ("xyz", "classification")}
    if kind != "hills" and rng.random() < 0.5:
        tile["intensity"] = rng.integers(0, 2000, size)
        tile |= {"return_number": rng.integers(1, 3, size), "number_of_returns": np.full(size, 2)}
    return tile


FAMILIES: Mapping[str, tuple[Callable[[int, np.random.Generator], Tile], float]] = {
    "coasts": (coast, 0.25),
    "seas": (sea, 0.1),
    "scenes": (scene_tile, 0.05),
    "independent": (independent, 0.4),
    "small": (small, 0.2),
}
"""How tiles of each family are made, and their share of all."""


def public_tiles(folder: Path) -> Iterator[tuple[str, Tile]]:
    """Yield the tiles of clones of `PUBLIC` repositories in a folder: each whole, and as degraded windows."""
    for pattern, (_, unit_m) in PUBLIC.items():
        for path in sorted(folder.glob(pattern)):
            las = laspy.read(path)
            tile: Tile = {name: np.asarray(las[name]) for name in las.point_format.dimension_names}
            tile["xyz"] = np.stack((las.x, las.y, las.z)) * unit_m
            yield path.stem, tile
            rng = np.random.default_rng(len(tile["xyz"][0]))
            low, high = tile["xyz"][:2].min(axis=1), tile["xyz"][:2].max(axis=1)
            corner = low + rng.uniform(0, 0.5, 2) * (high - low)
            inside = (tile["xyz"][:2] >= corner[:, None]).all(axis=0)
            yield f"{path.stem}-part", without_some({name: own[..., inside] for name, own in tile.items()}, rng)


def collected(folder: Path, tiles: int, public: Path | None) -> dict[str, list[Rows]]:
    """Return the rows of all tiles by family; tables in the folder are used again."""
    folder.mkdir(parents=True, exist_ok=True)
    found: dict[str, list[Rows]] = {}
    for family, (maker, share) in FAMILIES.items():
        for number in range(round(share * tiles)):
            rng = np.random.default_rng([number, len(family)])
            found.setdefault(family, []).append(
                _kept(folder / f"{family}-{number}.npz", lambda m=maker, n=number, r=rng: m(n, r))
            )
    for name, tile in public_tiles(public) if public else ():
        found.setdefault("real", []).append(_kept(folder / f"real-{name}.npz", lambda t=tile: t, is_real=True))
    return {family: [rows for rows in own if len(rows.wet)] for family, own in found.items()}


def _kept(path: Path, tile: Callable[[], Tile], *, is_real: bool = False) -> Rows:
    if not path.exists():
        rows = rows_of(tile(), is_real=is_real)
        squares = {f"squares_{name}": getattr(rows.squares, name) for name in Squares.__dataclass_fields__}
        np.savez(path, names=np.array(rows.names), table=rows.table, wet=rows.wet, weight=rows.weight, **squares)
    stored = np.load(path)
    own = Squares(**{name: stored[f"squares_{name}"] for name in Squares.__dataclass_fields__})
    return Rows(own, tuple(stored["names"].tolist()), stored["table"], stored["wet"], stored["weight"])


def fitted(tiles: list[Rows], tables: list[NDArray[np.float32]], trees: int) -> Any:
    """Return boosted trees; each tile counts alike, with at most 300 squares."""
    rng = np.random.default_rng(0)
    chosen = [rng.permutation(np.flatnonzero(rows.weight > 0.05))[:ROWS] for rows in tiles]
    weight = [rows.weight[own] / max(rows.weight[own].sum(), ROWS / 3) for rows, own in zip(tiles, chosen, strict=True)]
    model = HistGradientBoostingClassifier(
        max_iter=trees, max_leaf_nodes=LEAVES, min_samples_leaf=60, l2_regularization=5, max_features=0.4,
        early_stopping=False, random_state=0,
    )  # fmt: skip
    table = np.concatenate([values[own] for values, own in zip(tables, chosen, strict=True)])
    wet = np.concatenate([rows.wet[own] for rows, own in zip(tiles, chosen, strict=True)])
    return model.fit(table, wet, sample_weight=ROWS * np.concatenate(weight))


def trained(tiles: list[Rows]) -> tuple[Any, Any]:
    """Return the first trees, and the second, which know what the first make of tiles that they have not seen."""
    tables = [rows.table for rows in tiles]
    likely: list[NDArray[np.float64]] = [np.empty(0)] * len(tiles)
    half = np.random.default_rng(0).integers(0, 2, len(tiles))
    for part in (0, 1):
        others = [number for number in range(len(tiles)) if half[number] != part]
        model = fitted([tiles[number] for number in others], [tables[number] for number in others], FIRST)
        for number in np.flatnonzero(half == part).tolist():
            likely[number] = model.predict_proba(tables[number])[:, 1]
    wider = [np.concatenate((own.table, around(own.squares, p)), axis=1) for own, p in zip(tiles, likely, strict=True)]
    return fitted(tiles, tables, FIRST), fitted(tiles, wider, SECOND)


def exported(model: Any) -> Trees:
    """Return the trees of a model as arrays, with values in whole units; the first contains the log odds of all."""
    nodes = [tree[0].nodes for tree in model._predictors]  # noqa: SLF001 - no public name
    shape = len(nodes), max(map(len, nodes))
    feature, missing = np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)
    child, threshold, value = np.zeros((*shape, 2), np.uint8), np.zeros(shape, np.float32), np.zeros(shape, np.int32)
    for number, own in enumerate(nodes):
        is_leaf, place = own["is_leaf"] == 1, np.arange(len(own))
        limit = own["num_threshold"].astype(np.float32)
        limit = np.where(limit > own["num_threshold"], np.nextafter(limit, np.float32(-np.inf)), limit)
        feature[number, place], threshold[number, place] = np.where(is_leaf, 0, own["feature_idx"]), limit
        child[number, place, 0] = np.where(is_leaf, place, own["right"])
        child[number, place, 1] = np.where(is_leaf, place, own["left"])
        missing[number, place], value[number, place] = own["missing_go_to_left"], np.rint(own["value"] / UNIT)
    value[0] += int(np.rint(model._baseline_prediction.item() / UNIT))  # noqa: SLF001 - as above
    return Trees(feature, child, threshold, missing, value)


def wrong(rows: Rows, wet: NDArray[np.bool_]) -> float:
    return float((rows.weight * (wet != rows.wet)).sum() / max(rows.weight.sum(), 1e-9))


def measure(families: Mapping[str, list[Rows]]) -> None:
    """Print the share of wrong squares of each family with trees of the others, and what features are worth."""
    print("| family left out | tiles | mean % | median % | tiles above 5 % |\n| --- | ---: | ---: | ---: | ---: |")
    for family, own in families.items():
        others = [rows for name, tiles in families.items() if name != family for rows in tiles]
        model = fitted(others, [rows.table for rows in others], FIRST)
        share = 100 * np.array([wrong(rows, model.predict(rows.table)) for rows in own])
        cells = f"{share.mean():.1f} | {np.median(share):.1f} | {np.count_nonzero(share > 5)}"
        print(f"| {family} | {len(own)} | {cells} |", flush=True)
    every = [rows for tiles in families.values() for rows in tiles]
    model, rng = fitted(every[::2], [rows.table for rows in every[::2]], FIRST), np.random.default_rng(0)
    table = np.concatenate([rows.table for rows in every[1::2]])
    wet, weight = (np.concatenate([getattr(rows, name) for rows in every[1::2]]) for name in ("wet", "weight"))
    base = np.average(model.predict(table) == wet, weights=weight)
    for column, name in enumerate(every[0].names):
        mixed = table.copy()
        rng.shuffle(mixed[:, column])
        print(f"{name}: {100 * (base - np.average(model.predict(mixed) == wet, weights=weight)):.2f} %", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--tiles", type=int, default=500)
    parser.add_argument("--public", type=Path, metavar="FOLDER")
    parser.add_argument("--measure", action="store_true")
    parser.add_argument("-o", "--output", type=Path, default=Path("water.npz"))
    options = parser.parse_args()
    families = collected(options.folder, options.tiles, options.public)
    if options.measure:
        measure(families)
        return
    every = [rows for tiles in families.values() for rows in tiles]
    arrays = {"features": np.array(every[0].names)}
    for step, model in enumerate(trained(every), 1):
        trees = exported(model)
        arrays |= {f"{step}_{name}": getattr(trees, name) for name in Trees.__dataclass_fields__}
    np.savez_compressed(options.output, **arrays)


if __name__ == "__main__":
    main()
