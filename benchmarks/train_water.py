"""Train the models that tell water from land in airborne tiles, and measure them on tiles that they have not seen.

Run as ``python benchmarks/train_water.py FOLDER [--public CLONES] [--measure] [-o FOLDER]``; FOLDER keeps a table of
features of each tile, so that a second run trains at once. Tiles are made by `training_tiles.py`: ``seas``, ``coasts``
and ``scenes`` of the project's simulator; ``other``, ``small`` and ``more`` of an independent one; and ``real`` ones
from clones of public repositories. Of simulated tiles that are not small, `water_by_shape` also sees a copy without
intensities and often without returns and strips. ``--measure`` trains without each family in turn, and prints which
share of its squares is wrong, and what each feature is worth. `ahn3_sluice.laz` and `autzen_trim.laz` are in no family.
"""

import argparse
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.ensemble import HistGradientBoostingClassifier
from training_tiles import ATTRIBUTES, PUBLIC, WET, Tile, simulations, windows

from seaclutter_cli.airborne.separation import LeveledTile
from seaclutter_cli.airborne.shores import UNIT, Trees, around
from seaclutter_cli.airborne.squares import Squares, square_of, squares_in
from seaclutter_cli.airborne.surface import SeparationParams
from seaclutter_cli.grids.elevation import NOWHERE, GriddedPoints

VERSION = 1
OBJECT, DRY = (1,), (2, 3, 4, 5, 6, 11, 14, 17, 26, 31, 65)
LEAVES, MEASURED = 24, 60
INDEPENDENT = ("other", "small", "more")
LEFT_OUT = {"seas": ("seas",), "coasts": ("coasts",), "scenes": ("scenes",), "other": INDEPENDENT, "real": ("real",)}
Table = NDArray[np.float32]


@dataclass(frozen=True)
class Rows:
    """Features of the squares of a tile, shape (N, F), whether they are water, and their weights, shape (N,)."""

    family: str
    squares: Squares
    names: tuple[str, ...]
    table: Table
    wet: NDArray[np.int8]
    weight: NDArray[np.float32]


@dataclass(frozen=True)
class Recipe:
    """A model: what it is for, trees of its two steps, squares used of each tile, and whether copies are masked."""

    purpose: str
    trees: tuple[int, int]
    squares: int
    is_masked: bool


RECIPES: Mapping[str, Recipe] = {
    "water": Recipe("tiles with intensities", (100, 50), 300, is_masked=False),
    "water_by_shape": Recipe("tiles without intensities", (90, 40), 170, is_masked=True),
}


def write_table(path: Path, tile: Tile, *, is_real: bool) -> None:
    """Write features and truth of the squares of a tile; what is unclassified is an object, but not in real tiles."""
    truth = tile["classification"]
    params = SeparationParams()
    points = GriddedPoints([tile["xyz"]], params.cell_m)
    leveled = LeveledTile(points, params, lambda name: tile.get(name) if name in ATTRIBUTES else None)
    names, table = leveled.table()
    cell = np.concatenate(points.cells)
    used = cell != NOWHERE
    square, size = square_of(cell[used]), squares_in(points.grid)
    kinds = (WET, DRY, () if is_real else OBJECT)
    counts = (np.bincount(square, np.isin(truth[used], kind), size)[leveled.squares.index] for kind in kinds)
    wet, dry, objects = counts
    total = np.maximum(wet + dry + objects, 1)
    weight = np.where(objects > total / 2, 0, np.abs(wet - dry) / total).astype(np.float32)
    own, names_of = leveled.squares, np.array(names)
    np.savez(path, t=table, y=(wet > dry).astype(np.int8), w=weight, nb=own.neighbor, level=own.level_m, names=names_of)


def read_table(path: Path) -> Rows:
    """Return the rows of a tile; squares full of objects stand in water."""
    stored, family = np.load(path), path.name.partition("__")[0]
    # Only the neighbours and levels of squares are needed, and kept.
    squares = object.__new__(Squares)
    for name, key in (("level_m", "level"), ("neighbor", "nb")):
        object.__setattr__(squares, name, stored[key])
    wet, weight = stored["y"], stored["w"]
    if family != "real":
        full = weight == 0
        wet[full], weight[full] = 1, 0.6
    return Rows(family, squares, tuple(stored["names"].tolist()), stored["t"], wet, weight)


def collected(folder: Path, rounds: int, clones: Path | None) -> list[Rows]:
    """Return the rows of all tiles; tables in the folder are used again."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, maker in simulations(rounds):
        paths.append(folder / f"{name.replace('/', '_')}.npz")
        if not paths[-1].exists():
            write_table(paths[-1], maker(), is_real=False)
    for number, (name, (_, unit_m)) in enumerate(PUBLIC.items()):
        stem = f"real__{number:02}__{Path(name).stem}"
        if clones is not None and not (folder / f"{stem}-0.npz").exists():
            for window, tile in enumerate(windows(clones / name, unit_m)):
                write_table(folder / f"{stem}-{window}.npz", tile, is_real=True)
        paths += folder.glob(f"{stem}-*.npz")
    return [rows for rows in map(read_table, sorted(paths)) if len(rows.wet) >= 6]


def masked(tiles: list[Rows]) -> list[Rows]:
    """Return tiles, and copies of simulated ones without intensities and, of six in ten, without returns or strips."""
    rng, found = np.random.default_rng(5), list(tiles)
    looks, returns, strips = (
        [place for place, name in enumerate(tiles[0].names) if any(word in name for word in words)]
        for words in (("variation", "brightness", "contrast"), ("several",), ("change",))
    )
    for rows in tiles:
        if rows.family not in ("real", "small"):
            table = rows.table.copy()
            table[:, looks] = np.nan
            for columns in (returns, strips):
                if rng.random() < 0.6:
                    table[:, columns] = np.nan
            found.append(replace(rows, table=table))
    return found


def fitted(tiles: list[Rows], tables: list[Table], trees: int, squares: int, seed: int = 0) -> Any:
    """Return boosted trees of at most so many random squares of each tile; larger tiles count alike."""
    rng = np.random.default_rng(seed)
    chosen, weights = [], []
    for rows in tiles:
        useful = np.flatnonzero(rows.weight > 0.05)
        number = min(len(useful), squares)
        own = rng.choice(useful, number, replace=False) if number else useful
        total = max(rows.weight[useful].sum(), 150)
        chosen.append(own)
        weights.append(rows.weight[own] * len(useful) / max(number, 1) * 600 / total)
    model = HistGradientBoostingClassifier(
        max_iter=trees, max_leaf_nodes=LEAVES, min_samples_leaf=60, l2_regularization=5, max_features=0.4,
        early_stopping=False, random_state=0,
    )  # fmt: skip
    table = np.concatenate([values[own] for values, own in zip(tables, chosen, strict=True)])
    wet = np.concatenate([rows.wet[own] for rows, own in zip(tiles, chosen, strict=True)])
    return model.fit(table, wet, sample_weight=np.concatenate(weights))


def trained(tiles: list[Rows], recipe: Recipe) -> tuple[Any, Any]:
    """Return the first trees, and the second, which know what the first make of tiles that they have not seen."""
    tiles = masked(tiles) if recipe.is_masked else tiles
    tables = [rows.table for rows in tiles]
    likely: list[NDArray[np.float64]] = [np.empty(0)] * len(tiles)
    half = np.random.default_rng(0).integers(0, 2, len(tiles))
    for part in (0, 1):
        others = np.flatnonzero(half != part).tolist()
        own = [tiles[number] for number in others]
        model = fitted(own, [rows.table for rows in own], recipe.trees[0], recipe.squares)
        for number in np.flatnonzero(half == part).tolist():
            likely[number] = model.predict_proba(tables[number])[:, 1]
    first = fitted(tiles, tables, recipe.trees[0], recipe.squares)
    wider = [np.concatenate((own.table, around(own.squares, p)), axis=1) for own, p in zip(tiles, likely, strict=True)]
    return first, fitted(tiles, wider, recipe.trees[1], recipe.squares, 1)


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
        feature[number, place] = np.where(is_leaf, 0, own["feature_idx"])
        threshold[number, place] = np.where(is_leaf, 0, limit)
        child[number, place, 0] = np.where(is_leaf, place, own["right"])
        child[number, place, 1] = np.where(is_leaf, place, own["left"])
        missing[number, place], value[number, place] = own["missing_go_to_left"], np.rint(own["value"] / UNIT)
    value[0] += int(np.rint(model._baseline_prediction.item() / UNIT))  # noqa: SLF001 - as above
    return Trees(feature, child, threshold, missing, value)


def write_model(path: Path, tiles: list[Rows], recipe: Recipe) -> None:
    """Train a model and write its trees, with its version, features and how it was trained."""
    families = sorted({rows.family for rows in tiles})
    counts = ", ".join(f"{sum(rows.family == family for rows in tiles)} {family}" for family in families)
    arrays = {
        "version": np.array(VERSION),
        "features": np.array(tiles[0].names),
        "training": np.array(f"benchmarks/train_water.py, for {recipe.purpose}; tiles: {counts}"),
    }
    for step, model in enumerate(trained(tiles, recipe), 1):
        trees = exported(model)
        arrays |= {f"{step}_{name}": getattr(trees, name) for name in Trees.__dataclass_fields__}
    np.savez_compressed(path, **arrays)


def wrong(rows: Rows, wet: NDArray[np.int8]) -> float:
    return float((rows.weight * (wet != rows.wet)).sum() / max(rows.weight.sum(), 1e-9))


def measure(tiles: list[Rows]) -> None:
    """Print the share of wrong squares of each family with trees of the others, and what features are worth."""
    squares = RECIPES["water"].squares
    print("| family left out | tiles | mean % | median % | tiles above 5 % |\n| --- | ---: | ---: | ---: | ---: |")
    for family, left_out in LEFT_OUT.items():
        others = [rows for rows in tiles if rows.family not in left_out]
        own = [rows for rows in tiles if rows.family == family]
        model = fitted(others, [rows.table for rows in others], MEASURED, squares)
        share = 100 * np.array([wrong(rows, model.predict(rows.table)) for rows in own])
        cells = f"{share.mean():.2f} | {np.median(share):.2f} | {100 * np.mean(share > 5):.0f} %"
        print(f"| {family} | {len(own)} | {cells} |", flush=True)
    model, rng = fitted(tiles[::2], [rows.table for rows in tiles[::2]], MEASURED, squares), np.random.default_rng(0)
    table = np.concatenate([rows.table for rows in tiles[1::2]])
    wet, weight = (np.concatenate([getattr(rows, name) for rows in tiles[1::2]]) for name in ("wet", "weight"))
    chosen = rng.permutation(len(table))[:20_000]
    table, wet, weight = table[chosen], wet[chosen], weight[chosen]
    base = np.average(model.predict(table) == wet, weights=weight)
    worth = {}
    for column, name in enumerate(tiles[0].names):
        mixed = table.copy()
        rng.shuffle(mixed[:, column])
        worth[name] = 100 * (base - np.average(model.predict(mixed) == wet, weights=weight))
    for name in sorted(worth, key=worth.__getitem__, reverse=True):
        print(f"| {name} | {worth[name]:.2f} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--rounds", type=int, default=14)
    parser.add_argument("--public", type=Path, metavar="CLONES")
    parser.add_argument("--only", choices=sorted(RECIPES))
    parser.add_argument("--measure", action="store_true")
    parser.add_argument("-o", "--output", type=Path, default=Path())
    options = parser.parse_args()
    tiles = collected(options.folder, options.rounds, options.public)
    if options.measure:
        measure(tiles)
        return
    for name, recipe in RECIPES.items():
        if options.only in (None, name):
            write_model(options.output / f"{name}.npz", tiles, recipe)


if __name__ == "__main__":
    main()
