"""A map of a separated tile: water with its level, land, and objects, by cell; and the shoreline."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.separation import Separation
from seaclutter_cli.airborne.surface import NEVER, WATER
from seaclutter_cli.arrays import Bytes, Floats
from seaclutter_cli.errors import requiring
from seaclutter_cli.grids.elevation import sliced

UNKNOWN, IS_WATER, IS_LAND, IS_OBJECT = 0, 1, 2, 3
"""What is in a cell of a map."""
_MAX_CELLS = 1 << 24
_GAP_CELLS = 10
_SMOOTH_CELLS = 1.5
_SHORTEST_M = 20.0
_FEWEST_CELLS, _LEAST_SHARE = 100, 0.25


@dataclass(frozen=True)
class TileMap:
    """Map of a tile.

    ``cell_m``: width of a cell; ``first``: number of the first column and row, counted in cells from the origin of the
    coordinates; ``kind``, shape (I, J): `IS_WATER`, `IS_LAND`, `IS_OBJECT`, or `UNKNOWN` without points; ``level_m``,
    shape (I, J): mean elevation of the points of the sea; NaN without any.
    """

    cell_m: float
    first: tuple[int, int]
    kind: Bytes
    level_m: NDArray[np.float32]

    def coarser(self, cell_m: float) -> "TileMap":
        """Return a map with cells that are at least as wide, a multiple of those of this one.

        A cell with an object shows it; otherwise water or land, whichever is more frequent.
        """
        step = max(1, round(cell_m / self.cell_m))
        margins = [(at % step, -(at + size) % step) for at, size in zip(self.first, self.kind.shape, strict=True)]

        def total(values: NDArray[Any]) -> NDArray[Any]:
            wide = np.pad(values, margins)
            return np.asarray(wide.reshape(len(wide) // step, step, -1, step).sum(axis=(1, 3)))

        water, land, objects = (total(self.kind == kind) for kind in (IS_WATER, IS_LAND, IS_OBJECT))
        kind = np.where(land > water, IS_LAND, np.where(water > 0, IS_WATER, UNKNOWN))
        kind[objects > 0] = IS_OBJECT
        known = np.isfinite(self.level_m)
        sums, many = total(np.where(known, self.level_m, 0).astype(np.float64)), total(known)
        level = np.divide(sums, many, out=np.full(kind.shape, np.nan), where=many > 0)
        first = self.first[0] // step, self.first[1] // step
        return TileMap(self.cell_m * step, first, kind.astype(np.uint8), level.astype(np.float32))


def map_of(parts: Iterable[Floats], found: Separation, cell_m: float) -> TileMap:
    """Return the map of a separated tile.

    ``parts``, shape (3, n): coordinates of the points in metres; iterated over twice; ``found``: their separation;
    ``cell_m``: width of a cell; more if there would be too many cells.
    """
    located = (xyz[:2, found.classification[part] != NEVER] for part, xyz in sliced(parts))
    ends = [(xy.min(axis=1), xy.max(axis=1)) for xy in located if xy.size]
    low, high = np.min([first for first, _ in ends], axis=0), np.max([last for _, last in ends], axis=0)
    while np.prod((high - low) // cell_m + 1) > _MAX_CELLS:
        cell_m *= 2
    first = np.floor(low / cell_m).astype(np.int64)
    shape = tuple((np.floor(high / cell_m).astype(np.int64) - first + 1).tolist())
    total = shape[0] * shape[1]
    sea, land, other = (np.zeros(total, np.int32) for _ in range(3))
    elevation = np.zeros(total)
    for part, xyz in sliced(parts):
        code = found.classification[part]
        used = code != NEVER
        column, row = np.floor(xyz[:2, used] / cell_m).astype(np.int64) - first[:, None]
        cell, code = column * shape[1] + row, code[used]
        is_sea, on_land = code == WATER, found.land.contain(xyz[:2, used])
        sea += np.bincount(cell[is_sea], minlength=total).astype(np.int32)
        elevation += np.bincount(cell[is_sea], xyz[2, used][is_sea], total)
        land += np.bincount(cell[~is_sea & on_land], minlength=total).astype(np.int32)
        other += np.bincount(cell[~is_sea & ~on_land], minlength=total).astype(np.int32)
    kind = np.full(total, UNKNOWN, np.uint8)
    kind[sea > 0] = IS_WATER
    kind[(land > 0) & (land >= sea)] = IS_LAND
    kind[(other > 0) & (other > land)] = IS_OBJECT
    level = np.divide(elevation, sea, out=np.full(total, np.nan), where=sea > 0)
    return TileMap(cell_m, (int(first[0]), int(first[1])), kind.reshape(shape), level.astype(np.float32).reshape(shape))


def shoreline_of(tile: TileMap) -> list[Floats]:
    """Return the lines between water and land, shape (N, 2) each, in metres; land is on their left.

    Objects and gaps of up to ten cells count as what is nearest. Land with points in fewer than 100 cells, or in fewer
    than a quarter of its cells, is left out, as are lines shorter than 20 m.

    Raise `MissingExtraError` if contourpy is not installed.
    """
    from scipy import ndimage

    if not ((tile.kind == IS_LAND).any() and (tile.kind == IS_WATER).any()):
        return []
    with requiring("the shoreline", "geo"):
        from contourpy import contour_generator  # an extra
    known = (tile.kind == IS_LAND) | (tile.kind == IS_WATER)
    distance, (i, j) = ndimage.distance_transform_edt(~known, return_indices=True)
    land, _ = ndimage.label(tile.kind[i, j] == IS_LAND)
    seen = np.bincount(land[tile.kind == IS_LAND], minlength=int(land.max()) + 1)
    certain = (seen >= _FEWEST_CELLS) & (seen >= _LEAST_SHARE * np.bincount(land.ravel()))
    certain[0] = False
    smooth = ndimage.gaussian_filter(certain[land].astype(np.float64), _SMOOTH_CELLS, mode="nearest")
    field = np.ma.masked_array(smooth, distance > _GAP_CELLS)
    lines = contour_generator(z=field.T).lines(0.5)
    places = [(np.asarray(line) + tile.first + 0.5) * tile.cell_m for line in lines]
    return [line for line in places if length_m(line) >= _SHORTEST_M]


def length_m(line: Floats) -> float:
    """Return the length of a line, shape (N, 2), in metres."""
    return float(np.hypot(*np.diff(line, axis=0).T).sum())
