"""Land and water of a tile by cell, and the model that tells them apart: boosted trees over the features of squares."""

from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.squares import SIDE, Squares, by_cell, positions, squares_in
from seaclutter_cli.airborne.waves import WindowWaves
from seaclutter_cli.arrays import Floats, Ints, Mask
from seaclutter_cli.grids.cells import joined_cells, nearest, smoothed
from seaclutter_cli.grids.elevation import Cells, ElevationGrid

_LEAST_SQUARES = 6  # the opening takes what is smaller for an object
_STEP_M, _STEP_DEVIATIONS = 0.25, 2.5
_WALL = 4.0
_SMOOTH_CELLS, _LEAST_ODDS, _SURE_ODDS, _MOST_ODDS = 4.0, 0.5, 1.0, 3.0
_OPEN_SHARE = 0.5
_SLOPE_CELLS, _STEEP, _EXPLAINED = 120, 0.002, 0.8
_BANK_M, _BANK_DEVIATIONS, _CREST_DEVIATIONS = 0.2, 4.0, 3.0
UNIT = 1 / 4096
"""Unit of the values of leaves, which are whole numbers: their sum is the same on every machine."""
_NEAR, _FAR = 2, 8
_SAME_M = 0.15
_ROWS = 64  # that stay in the cache, for all trees


@dataclass(frozen=True)
class Shores:
    """Land and water of a tile.

    ``land``, shape (S, 256, 256): cells of land; ``level_m``, shape (S, 256, 256): level of the water nearest to each
    cell; NaN without any; ``bank_m``: height above that level from which cells that touch land belong to it on calm
    water; ``water``, shape (N,): squares of water.
    """

    land: Mask
    level_m: Cells
    bank_m: float
    water: Mask


def shores_of(grid: ElevationGrid, lowest: Cells, squares: Squares, odds: Floats, waves: WindowWaves) -> Shores:
    """Return the land and water of a tile from the log odds of water of its N squares, infinite where it is known.

    Fewer than six connected squares are no land and no water: the opening takes what is that small for an object.
    Squares on the shore contain both. There, cells no higher than the water, and its waves, are water; from 20 cm
    above it, or four standard deviations of the elevations in squares of water, they are land if they touch land.
    """
    deviation = np.nan_to_num(np.where(waves.depth > 0, waves.deviation_m, 0.0))
    water = _without_small(squares, odds)
    level = _bodies(squares, water, odds, deviation)
    water &= ~np.isposinf(level)
    odds = np.where(np.isposinf(level), -_MOST_ODDS, odds)
    known = np.flatnonzero(np.isfinite(level))
    if not len(known):
        return Shores(np.ones(lowest.shape, np.bool_), np.full(lowest.shape, np.nan), _BANK_M, np.zeros_like(water))
    level = level[known][nearest(squares.xy[:, known], squares.xy)]
    bank = max(_BANK_M, _BANK_DEVIATIONS * float(np.median(squares.spread_m[water])))
    crest = max(bank, _CREST_DEVIATIONS * float(np.median(deviation[water])))
    rise = squares.level_m - level
    above = np.append(np.where(water | (rise <= _WALL * bank), -np.inf, np.where(rise > crest, crest, bank)), -np.inf)
    reach = np.maximum(above[:-1], above[squares.neighbor].max(axis=0))
    reach[squares.around(water.astype(np.float64), 1) == 0] = -np.inf
    own = nearest(squares.xy, positions(grid, np.arange(squares_in(grid))))
    certain = np.where(water, odds.clip(_LEAST_ODDS, _MOST_ODDS), odds.clip(-_MOST_ODDS, -_LEAST_ODDS))
    likely, levels = by_cell(certain[own]), by_cell(level[own])
    land = smoothed(grid, likely, np.ones(likely.shape, np.bool_), _SMOOTH_CELLS)[0] < 0
    land &= ~(np.abs(np.where(np.isfinite(lowest), lowest, levels) - levels) <= by_cell(reach[own]))
    return Shores(land, levels, bank, water)


def _without_small(squares: Squares, odds: Floats) -> Mask:
    """Return which squares are water, where at least six that are alike touch each other."""
    water = odds > 0
    for _ in range(2):  # what is small may be amid what is small, too
        alike = np.append(water, False)[squares.neighbor[:2]] == water
        group = squares.joined(alike & (squares.neighbor[:2] >= 0))
        small = (np.bincount(group) < _LEAST_SQUARES)[group] & np.isfinite(odds)
        if small.all():
            break
        water = water ^ small
    return water


def _bodies(squares: Squares, water: Mask, odds: Floats, deviation: Floats) -> Floats:
    """Return the level of the body of water of each square, shape (N,): infinite for rivers that slope.

    Steps that waves do not explain divide bodies. The level is NaN on land, in bodies of fewer than six squares, and
    in those that are no sure water, or have mostly water at no common level around them: the heights of an island.
    """
    side = squares.neighbor[:2]
    level = np.append(squares.level_m, np.inf)
    step = np.maximum(_STEP_M, _STEP_DEVIATIONS * deviation)
    body = squares.joined(np.append(water, False)[side] & water & (np.abs(level[side] - level[:-1]) <= step))
    size = np.bincount(body, water)
    least = min(_LEAST_SQUARES, size.max(initial=0))
    found = np.full(len(water), np.nan)
    loose = np.append(water & (size[body] < least), False)
    for number in np.flatnonzero(size >= max(least, 1)).tolist():
        own = np.flatnonzero(body == number)
        beyond = squares.neighbor[:, own]
        outside = (beyond >= 0) & (np.append(body, -1)[beyond] != number)
        is_top = np.count_nonzero(loose[beyond] & outside) > _OPEN_SHARE * np.count_nonzero(outside)
        is_top |= np.clip(odds[own], -_MOST_ODDS, _MOST_ODDS).mean() < _SURE_ODDS
        if is_top and size[number] < size.max():
            continue
        is_none = _slopes(squares, own) or _drains(squares, own, body, float(np.median(step[own])))
        found[own] = np.inf if is_none else np.median(squares.level_m[own])
    return found


def _drains(squares: Squares, own: Ints, body: NDArray[np.int32], step_m: float) -> bool:
    """Return whether water would run off along most of the edge of a body in the tile: neither is higher there."""
    level, top = (np.append(values, np.inf) for values in (squares.level_m, squares.top_m))
    beyond, start = squares.neighbor[:, own], np.broadcast_to(own, (4, len(own)))
    edge = (beyond >= 0) & (np.append(body, -1)[beyond] != body[own[0]])
    middle = float(np.median(squares.level_m[own]))
    further = np.append(squares.neighbor, np.full((4, 1), -1), axis=1)[np.arange(4)[:, None], beyond]
    lower = np.minimum(level[beyond], level[further]) < middle - 2 * step_m
    lower &= np.maximum(top[beyond], top[start]) <= middle + 2 * step_m
    return bool(edge.any() and np.count_nonzero(lower & edge) > _OPEN_SHARE * np.count_nonzero(edge))


def _slopes(squares: Squares, own: Ints) -> bool:
    """Return whether a plane through most squares of a body is steep, and explains their levels better than waves."""
    low, middle, high = np.quantile(squares.level_m[own], (0.1587, 0.5, 0.8413))
    near = own[np.abs(squares.level_m[own] - middle) <= high - low + _STEP_M]
    place, level = SIDE * squares.xy[:, near], squares.level_m[near]
    place = place - place.mean(axis=1, keepdims=True)
    if np.ptp(place, axis=1).max() < _SLOPE_CELLS:
        return False
    slope = np.linalg.lstsq(place.T, level - level.mean(), rcond=None)[0]
    rest = level - level.mean() - slope @ place
    return bool(np.hypot(*slope) > _STEEP and rest.var() < (1 - _EXPLAINED) * level.var())


def island_cells(
    grid: ElevationGrid,
    opened: Cells,
    level_m: float | Cells,
    height_m: float | Cells,
    island_m: float | Cells,
    also: Mask,
) -> Mask:
    """Return a mask of the cells of islands, shape (S, 256, 256).

    ``grid``: the grid, in S blocks; ``opened``, shape (S, 256, 256): opened surface; ``level_m``, shape (S, 256, 256):
    level of the water; ``height_m``, ``island_m``, shape (S, 256, 256): height above that level from which a cell may
    belong to an island, and that one cell of it must exceed; ``also``, shape (S, 256, 256): cells that make an
    island of those that touch them.
    """
    highest = np.where(np.isfinite(grid.lowest), np.maximum(opened, grid.lowest), opened)
    land = (highest > level_m + height_m) | also
    high = ((opened > level_m + height_m) & (highest > level_m + island_m)) | also
    if not high.any():
        return high
    number, group = joined_cells(grid, land)
    islands = np.zeros(len(group), np.bool_)
    islands[group[number[high]]] = True
    return islands[group[number]]


def commonest_level(grid: ElevationGrid, opened: Cells, step_m: float) -> float:
    """Return the sea level: the median of the opened surface in its most frequent elevation step."""
    known = opened[np.isfinite(grid.lowest)]
    step = np.floor(known / step_m)
    values, counts = np.unique(step, return_counts=True)
    return float(np.median(known[step == values[np.argmax(counts)]]))


@dataclass(frozen=True)
class Trees:
    """T trees of at most M nodes; leaves lead to themselves.

    ``feature``, ``child``, shape (T, M) and (T, M, 2): feature that a node compares, and its children: where the
    feature is greater, and where it is not; ``threshold``, shape (T, M): what it compares with; ``missing``, shape (T,
    M): child for a feature that is not known; ``value``, shape (T, M): value of each node in units of log odds.
    """

    feature: NDArray[Any]
    child: NDArray[Any]
    threshold: NDArray[np.float32]
    missing: NDArray[Any]
    value: NDArray[np.int32]

    def log_odds(self, table: NDArray[np.float32]) -> Floats:
        """Return the log odds of water, shape (N,), from features, shape (N, F)."""
        trees, nodes = self.feature.shape
        root = nodes * np.arange(trees)[:, None]  # nodes are numbered through all trees
        child = (self.child + root[:, :, None]).ravel()
        arrays = self.feature.astype(np.intp), self.threshold, self.missing.astype(np.bool_), self.value
        feature, threshold, missing, value = (values.ravel() for values in arrays)
        total = np.zeros(len(table), np.int64)
        for start in range(0, len(table), _ROWS):
            rows = table[start : start + _ROWS]
            place, node = np.arange(len(rows)) * rows.shape[1], np.repeat(root, len(rows), axis=1)
            while True:
                own = rows.take(place + feature.take(node))
                way = (own <= threshold.take(node)) | (np.isnan(own) & missing.take(node))
                deeper = child.take(2 * node + way)
                if (deeper == node).all():
                    break
                node = deeper
            total[start : start + _ROWS] = value.take(node).sum(axis=0)
        return np.asarray(total * UNIT, np.float64)


class WaterModel:
    """Trees over the table of features, and others that also know what the first make of the squares around.

    The models of the package are ``water``, and ``water_by_shape``, trained with most intensities left out.
    """

    def __init__(self, name: str) -> None:
        with (files("seaclutter_cli.airborne") / f"{name}.npz").open("rb") as file, np.load(file) as stored:
            trees = [Trees(*(stored[f"{step}_{one}"] for one in Trees.__dataclass_fields__)) for step in (1, 2)]
            self.features = tuple(stored["features"].tolist())
        self.first, self.second = trees

    def log_odds(self, squares: Squares, names: tuple[str, ...], table: NDArray[np.float32], given: Floats) -> Floats:
        """Return the log odds of water of N squares; ``given``, shape (N,): log odds by trusted classes."""
        if names != self.features:
            raise ValueError("the model was trained with other features")
        likely = 1 / (1 + np.exp(-self.first.log_odds(table) - given))
        return self.second.log_odds(np.concatenate((table, around(squares, likely)), axis=1)) + given


def around(squares: Squares, likely: Floats) -> NDArray[np.float32]:
    """Return how likely each square, those around it near and far, at its level, and in the tile are water: (N, 5)."""
    order = np.argsort(squares.level_m, kind="stable")
    level, total = squares.level_m[order], np.concatenate(([0.0], np.cumsum(likely[order])))
    low = np.searchsorted(level, squares.level_m - _SAME_M)
    high = np.searchsorted(level, squares.level_m + _SAME_M, "right")
    mean = float(likely.mean()) if len(likely) else 0.0
    return np.stack(
        (
            likely,
            squares.around(likely, _NEAR),
            squares.around(likely, _FAR),
            (total[high] - total[low]) / (high - low),
            np.full(len(likely), mean),
        ),
        axis=1,
    ).astype(np.float32)
