"""The table of features that distinguishes water from land: one row for each square of eight by eight cells."""

from collections.abc import Callable, Collection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.surface import GROUND, WATER
from seaclutter_cli.airborne.waves import WindowWaves
from seaclutter_cli.arrays import Floats, Ints, Mask
from seaclutter_cli.grids.cells import joined
from seaclutter_cli.grids.elevation import BLOCK, Cells, ElevationGrid, GriddedPoints

Column = Callable[[str], NDArray[Any] | None]
"""Returns an attribute of all points by its LAS name, shape (N,); None if the tile does not have it."""

SIDE = 8
"""Width of a square in cells."""
_PER_BLOCK = BLOCK // SIDE
_LEAST_CELLS, _LEAST_ECHOES = 6, 12
_NEAR, _FAR = 2, 8
_SAME_M, _STEP_M = 0.15, 0.15
_FLAT_M, _JOINED_M = 0.15, 0.08
_TALL_M = 2.0
_MISSED_ODDS = 6.0
_SHARES = (0.1587, 0.5, 0.8413)


class Squares:
    """The N squares of a grid in which enough cells have points.

    They are made from the lowest elevations of cells, and whether these are on the opened surface.

    ``index``, shape (N,): index of each square among those of all blocks; ``xy``, shape (2, N): column and row;
    ``level_m``, ``spread_m``, shape (N,): median of the lowest elevations of cells, and half the distance between their
    16th and 84th percentile; of those on the opened surface, if there are enough; ``top_m``, shape (N,): the highest of
    the lowest elevations; ``texture_m``, shape (N,): root mean square of half the difference between cells side by
    side; NaN without any; ``open_share``, ``filled``, shape (N,): share of the cells with points that are on the opened
    surface, and of all cells that have points; ``neighbor``, shape (4, N): index of the square on each side; -1 for
    none.
    """

    def __init__(self, grid: ElevationGrid, lowest: Cells, on_surface: Mask) -> None:
        split = (values.reshape(-1, _PER_BLOCK, SIDE, _PER_BLOCK, SIDE) for values in (on_surface, lowest))
        known, low = (part.transpose(0, 1, 3, 2, 4).reshape(-1, SIDE * SIDE) for part in split)
        cells = np.isfinite(low).sum(axis=1)
        self.index = np.flatnonzero(cells >= _LEAST_CELLS)
        known, low, cells = known[self.index], low[self.index], cells[self.index]
        enough = known.sum(axis=1) >= _LEAST_CELLS
        used = np.where(enough[:, None], known, np.isfinite(low))
        ordered = np.sort(np.where(used, low, np.inf), axis=1)
        last, row = used.sum(axis=1) - 1, np.arange(len(low))
        lower, self.level_m, upper = (ordered[row, np.rint(part * last).astype(np.int64)] for part in _SHARES)
        self.spread_m = (upper - lower) / 2
        self.top_m = np.where(np.isfinite(low), low, -np.inf).max(axis=1, initial=-np.inf)
        self.texture_m = _texture(np.where(used, low, np.nan))
        self.open_share, self.filled = known.sum(axis=1) / np.maximum(cells, 1), cells / SIDE**2
        self.xy = positions(grid, self.index)
        self.neighbor = _neighbors(self.xy)

    def around(self, values: Floats, times: int) -> Floats:
        """Return the mean of the known values around each square, shape (N,): of three by three, so many times."""
        known = np.isfinite(values)
        total, weight = np.where(known, values, 0), known.astype(np.float64)
        for _ in range(times):
            for sides in (self.neighbor[::2], self.neighbor[1::2]):
                total, weight = (own + np.append(own, 0)[sides].sum(axis=0) for own in (total, weight))
            total, weight = total / 9, weight / 9
        return np.asarray(np.divide(total, weight, out=np.full(len(values), np.nan), where=weight > 0))

    def joined(self, links: Mask) -> NDArray[np.int32]:
        """Return the group of each square, shape (N,): those that links, shape (2, N), join to their neighbours."""
        pairs = np.stack((np.tile(np.arange(len(self.index)), 2), self.neighbor[:2].reshape(-1)))
        return joined(pairs[:, links.reshape(-1)], len(self.index))


def by_cell(values: NDArray[Any]) -> NDArray[Any]:
    """Return values of all squares of S blocks, shape (S * 32 * 32,), for all cells, shape (S, 256, 256)."""
    blocks = values.reshape(-1, _PER_BLOCK, _PER_BLOCK)
    return np.repeat(np.repeat(blocks, SIDE, axis=1), SIDE, axis=2)


def squares_in(grid: ElevationGrid) -> int:
    """Return the number of squares of all blocks."""
    return len(grid.blocks) * _PER_BLOCK**2


def square_of(cell: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the square of each cell, both as indices."""
    # Columns are counted through all blocks; sides are powers of two, for which this is much faster than `np.divmod`.
    return np.asarray(cell // (BLOCK * SIDE) * _PER_BLOCK + (cell & (BLOCK - 1)) // SIDE)


def positions(grid: ElevationGrid, index: Ints) -> Ints:
    """Return column and row of squares, shape (2, N), from their indices."""
    block = np.array(list(grid.blocks), np.int64).reshape(-1, 2)
    slot, inside = np.divmod(index, _PER_BLOCK**2)
    return np.asarray(block[slot].T * _PER_BLOCK + np.stack(np.divmod(inside, _PER_BLOCK)))


def _neighbors(xy: Ints) -> Ints:
    key = (xy[0] << 32) + xy[1]
    found = np.full((4, len(key)), -1, np.int64)
    for own, step in zip(found, (1 << 32, 1, -(1 << 32), -1), strict=True):
        _, known, beside = np.intersect1d(key + step, key, assume_unique=True, return_indices=True)
        own[known] = beside
    return found


def _texture(low: Cells) -> Floats:
    """Return the root mean square of half the difference of cells side by side, of squares, shape (N, 64)."""
    cells = low.reshape(-1, SIDE, SIDE)
    steps = [np.diff(cells, axis=axis).reshape(len(low), SIDE * (SIDE - 1)) for axis in (1, 2)]
    power = np.concatenate(steps, axis=1) ** 2
    number = np.isfinite(power).sum(axis=1)
    total = np.where(np.isfinite(power), power, 0).sum(axis=1)
    return np.asarray(np.sqrt(np.divide(total, 2 * number, out=np.full(len(low), np.nan), where=number > 0)))


class SquareEchoes:
    """Echoes of each of N squares, on the surface if they are no higher than ``top``, by cell; NaN if unknown.

    ``number``, shape (N,): number of echoes; ``several``, ``tall``, shape (N,): share of those on the surface that are
    of pulses with several echoes, and of all that are two metres above it; ``brightness``, ``variation``, shape (N,):
    logarithm of the mean intensity of pulses with one echo, and their standard deviation divided by their mean;
    ``trusted``, shape (N,): log odds of water by the classes that are trusted; infinite where most echoes have one,
    and 0 if none is trusted.
    """

    def __init__(
        self, squares: Squares, points: GriddedPoints, top: Cells, column: Column, trusted: Collection[int]
    ) -> None:
        intensity, returns = column("intensity"), column("number_of_returns")
        classes = column("classification") if trusted else None
        size = squares_in(points.grid)
        every, tall, surface, single, one, two, water, ground = sums = np.zeros((8, size))
        high = np.full(size, np.inf)
        high[squares.index] = squares.level_m + _TALL_M
        for own, z, cell in points:
            square = square_of(cell)
            every += np.bincount(square, minlength=size)
            tall += np.bincount(square, z > high[square], size)
            low = z <= top.reshape(-1)[cell]
            used, square = own[low], square[low]
            surface += np.bincount(square, minlength=size)
            if classes is not None:
                water += np.bincount(square, (classes[used] == WATER) & (WATER in trusted), size)
                ground += np.bincount(square, (classes[used] == GROUND) & (GROUND in trusted), size)
            if returns is not None:
                whole = returns[used] <= 1
                used, square = used[whole], square[whole]
            single += np.bincount(square, minlength=size)
            if intensity is not None:
                value = np.nan_to_num(intensity[used]).astype(np.float64)
                one += np.bincount(square, value, size)
                two += np.bincount(square, value**2, size)
        every, tall, surface, single, one, two, water, ground = sums[:, squares.index]
        unknown = np.full(len(every), np.nan)
        known = (single >= _LEAST_ECHOES) & (one > 0)
        mean = np.divide(one, single, out=unknown.copy(), where=known)
        spread = np.sqrt(np.maximum(np.divide(two, single, out=unknown.copy(), where=known) - mean**2, 0))
        some = (surface >= _LEAST_ECHOES) & (returns is not None)
        self.number, self.tall = every, tall / np.maximum(every, 1)
        self.several = np.divide(surface - single, surface, out=unknown.copy(), where=some)
        self.brightness, self.variation = np.log(mean), spread / mean
        self.trusted = _trusted(surface, water) - _trusted(surface, ground)


def _trusted(surface: Floats, own: Floats) -> Floats:
    """Return the log odds of a kind of squares by echoes of its class; to have none is evidence if others do."""
    most = own > surface / 2
    missed = most.any() & (surface >= _LEAST_ECHOES) & (own == 0)
    return np.asarray(np.where(most, np.inf, np.where(missed, -_MISSED_ODDS, 0.0)))


def square_table(
    squares: Squares, echoes: SquareEchoes, waves: WindowWaves, change_m: Floats | None
) -> tuple[tuple[str, ...], NDArray[np.float32]]:
    """Return the names of F features, and their values, shape (N, F); NaN if unknown.

    ``squares``: the N squares of a tile; ``echoes``: their echoes; ``waves``: waves in the window of each square;
    ``change_m``, shape (N,): by how much the level differs between two strips; NaN if only one shows the square.
    """
    change = np.full(len(squares.index), np.nan) if change_m is None else change_m
    named = {
        **_own(squares, echoes),
        **_relief(squares, change),
        **_of_tile(squares, echoes),
        **waves.features(squares.level_m),
        **_of_region(squares, echoes, waves),
    }
    return tuple(named), np.stack(list(named.values()), axis=1).astype(np.float32)


def _middle(values: Floats, share: float = 0.5) -> float:
    known = values[np.isfinite(values)]
    return float(np.quantile(known, share)) if len(known) else np.nan


def _own(squares: Squares, echoes: SquareEchoes) -> dict[str, Floats]:
    """Return what squares look like, each alone and over those around it."""
    own = {
        "spread": squares.spread_m,
        "texture": squares.texture_m,
        "open": squares.open_share,
        "filled": squares.filled / _middle(squares.filled),
        "echoes": np.log(echoes.number / _middle(echoes.number)),
        "several": echoes.several,
        "tall": echoes.tall,
        "brightness": echoes.brightness - _middle(echoes.brightness),
        "variation": echoes.variation,
    }
    near = {f"{name}, near": squares.around(values, _NEAR) for name, values in own.items()}
    far = {f"{name}, far": squares.around(values, _FAR) for name, values in own.items()}
    return {**own, **near, **far}


def _relief(squares: Squares, change_m: Floats) -> dict[str, Floats]:
    """Return slope, and deviations of levels and of their change between strips, near and far."""
    level = np.append(squares.level_m, np.nan)
    east, north, west, south = level[squares.neighbor]
    slopes = [np.where(np.isfinite(a - b), a - b, 0) / 2 for a, b in ((east, west), (north, south))]
    center = np.nanmean(np.stack((east, north, west, south, level[:-1])), axis=0)
    found = {"slope": np.hypot(*slopes), "curvature": np.abs(squares.level_m - center)}
    middle = _middle(squares.level_m)
    for name, times in (("near", _NEAR), ("far", _FAR)):
        above = squares.level_m - middle
        mean, power = squares.around(above, times), squares.around(above**2, times)
        found[f"level, {name}"] = above - mean
        found[f"relief, {name}"] = np.sqrt(np.maximum(power - mean**2, 0))
        moved = np.sqrt(squares.around(change_m**2, times))
        found[f"change, {name}"] = moved
        found[f"change to relief, {name}"] = moved / (found[f"relief, {name}"] + 0.01)
    return found


def _of_tile(squares: Squares, echoes: SquareEchoes) -> dict[str, Floats]:
    """Return the level of squares among all, and what all squares of the tile have in common."""
    flat = squares.spread_m <= _FLAT_M
    ordered = np.sort(squares.level_m)
    common = np.sort(squares.level_m[flat]) if flat.any() else ordered

    def share(levels: Floats, low: Floats, high: Floats) -> Floats:
        return np.asarray(np.searchsorted(levels, high, "right") - np.searchsorted(levels, low)) / max(len(levels), 1)

    alike = share(common, squares.level_m - _SAME_M, squares.level_m + _SAME_M)
    commonest = squares.level_m[np.argmax(alike)] if len(alike) else 0.0
    ones = np.ones(len(squares.index))
    whole = {
        "flat squares": float(flat.mean()) if len(flat) else 0.0,
        "level range": _middle(squares.level_m, 0.9) - _middle(squares.level_m, 0.1),
        "most variation": _middle(echoes.variation, 0.9),
        "least variation": _middle(echoes.variation, 0.1),
        "contrast": _middle(echoes.brightness, 0.9) - _middle(echoes.brightness, 0.1),
        "several squares": float((echoes.several > 0.05).mean()) if np.isfinite(echoes.several).any() else np.nan,
        "tall squares": float((echoes.tall > 0.05).mean()) if len(ones) else 0.0,
        "squares": np.log(max(len(ones), 1)),
    }
    return {
        "rank": share(ordered, np.full(len(ones), -np.inf), squares.level_m - _SAME_M),
        "as level": alike,
        "above commonest": squares.level_m - commonest,
        "above lowest": squares.level_m - (ordered[len(ordered) // 50] if len(ordered) else 0.0),
        **{f"tile: {name}": value * ones for name, value in whole.items()},
    }


def _of_region(squares: Squares, echoes: SquareEchoes, waves: WindowWaves) -> dict[str, Floats]:
    """Return features of the level region of each square: connected squares, flat but for waves."""
    deviation = np.nan_to_num(np.where(waves.depth > 0, waves.deviation_m, 0.0))
    flat = np.append(squares.spread_m <= np.maximum(_FLAT_M, 3 * deviation), False)
    step = np.maximum(_JOINED_M, 1.5 * deviation)
    level = np.append(squares.level_m, np.inf)
    links = flat[squares.neighbor[:2]] & flat[:-1] & (np.abs(level[squares.neighbor[:2]] - level[:-1]) <= step)
    region = squares.joined(links)
    size = np.bincount(region)

    def mean(values: Floats) -> Floats:
        known = np.isfinite(values)
        number = np.bincount(region, known)
        total = np.bincount(region, np.where(known, values, 0))
        return np.asarray(np.divide(total, number, out=np.full(len(size), np.nan), where=number > 0))

    place = squares.xy - np.stack([mean(axis.astype(np.float64)) for axis in squares.xy])[:, region]
    above = squares.level_m - mean(squares.level_m)[region]
    tilt = [mean(axis * above) / np.maximum(mean(axis.astype(np.float64) ** 2), 0.1) for axis in place]
    rest = above - sum(slope[region] * axis for slope, axis in zip(tilt, place, strict=True))
    own = np.append(region, -1)
    outside = own[squares.neighbor] != region
    missing = squares.neighbor < 0
    beyond = np.append(squares.level_m, np.nan)[squares.neighbor] - squares.level_m
    crest = np.append(squares.top_m, np.nan)[squares.neighbor] - squares.level_m
    edges = {"higher": crest > _STEP_M, "lower": beyond < -_STEP_M, "missing": missing}
    length = np.maximum(np.bincount(region, outside.sum(axis=0)), 1)
    found = {
        "size": np.log(size),
        "share": size / max(len(region), 1),
        "slope": np.hypot(*tilt) / SIDE,
        "bumps": np.sqrt(mean(rest**2)),
        **{name: np.bincount(region, (outside & mask).sum(axis=0)) / length for name, mask in edges.items()},
        "spread": mean(squares.spread_m),
        "variation": mean(echoes.variation),
        "brightness": mean(echoes.brightness) - _middle(echoes.brightness),
        "several": mean(echoes.several),
        "oscillation": mean(waves.depth),
    }
    return {f"region: {name}": np.asarray(values)[region] for name, values in found.items()}
