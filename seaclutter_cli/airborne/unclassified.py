"""Objects of a separated tile that no forest has classified."""

from collections.abc import Iterable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.map import IS_WATER, TileMap
from seaclutter_cli.airborne.objects import FoundObject, ObjectFindingParams, object_around
from seaclutter_cli.airborne.separation import OTHER, Separation

_AROUND_M = 10.0


def unclassified_objects(
    parts: Iterable[NDArray[np.float64]], found: Separation, tile: TileMap, params: ObjectFindingParams
) -> list[FoundObject]:
    """Return the objects of a separated tile: clusters of its non-sea points off the land.

    Parameters
    ----------
    parts : iterable of ndarray, shape (3, n), float64
        Coordinates of the points in metres.
    found : Separation
        Their separation; heights are not used, as the output of an earlier run has none.
    tile : TileMap
        Its map.
    params : ObjectFindingParams
        Parameters of the search. Probabilities do not matter.

    Notes
    -----
    Heights are above the mean elevation of the sea up to ten metres around the object, or in the tile where there is
    none.
    """
    from seaclutter_cli.clustering.clusters import euclidean_clusters  # slow to import, only for geodata

    xyz = _off_land(parts, found)
    if not xyz.shape[1] or not (tile.kind == IS_WATER).any():
        return []
    number = euclidean_clusters(xyz * [[1], [1], [0]], params.tolerance_m, params.min_points)
    order = np.argsort(number, kind="stable")
    ends = np.searchsorted(number[order], np.arange(number.max() + 2)).tolist()
    objects = []
    for one, (start, end) in enumerate(pairwise(ends), 1):
        own = xyz[:, order[start:end]]
        objects.append(object_around(one, own[:2], own[2] - _level_around(tile, own)))
    return objects


def _off_land(parts: Iterable[NDArray[np.float64]], found: Separation) -> NDArray[np.float64]:
    """Return the non-sea points that are not on land, shape (3, N)."""
    chosen = [np.empty((3, 0))]
    start = 0
    for xyz in parts:
        own = xyz[:, found.classification[start : start + xyz.shape[1]] == OTHER]
        start += xyz.shape[1]
        chosen.append(own[:, ~found.land.contain(own[:2])])
    return np.concatenate(chosen, axis=1)


def _level_around(tile: TileMap, xyz: NDArray[np.float64]) -> float:
    """Return the mean elevation of the sea around the points of an object."""
    ends = ((side.min() - _AROUND_M, side.max() + _AROUND_M) for side in xyz[:2])
    cells = [
        slice(max(int(low // tile.cell_m) - first, 0), int(high // tile.cell_m) - first + 1)
        for (low, high), first in zip(ends, tile.first, strict=True)
    ]
    around = tile.level_m[tuple(cells)]
    known = around[np.isfinite(around)]
    return float((known if len(known) else tile.level_m[np.isfinite(tile.level_m)]).mean(dtype=np.float64))
