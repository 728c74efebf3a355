"""How cells reflect: the variation of the intensities in and around each."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.echoes import saturated_echoes
from seaclutter_cli.airborne.gridded import NOWHERE, GriddedPoints
from seaclutter_cli.airborne.strips import Column
from seaclutter_cli.grids.elevation import BLOCK, ElevationGrid

Cells = NDArray[np.float64]

_WIDTHS, _LEAST_FREEDOM = (3, 5), 8
_SATURATED_SHARE = 0.1


def cell_variation(points: GriddedPoints, top: Cells, column: Column) -> Cells | None:
    """Return the coefficient of variation of the intensities around each cell, shape (S, 256, 256).

    NaN if unknown; None without intensities.

    Parameters
    ----------
    points : GriddedPoints
        The N points of a tile.
    top : ndarray, shape (S, 256, 256), float64
        Elevation up to which echoes of a cell count.
    column : callable
        Returns an attribute of all points.

    Notes
    -----
    It is that of pulses with one echo within cells, as the root of its mean square over the three by three cells around
    each, or five by five if these have fewer than eight degrees of freedom. Differences between cells do not count:
    sand is darker where it is wet, and a bright bank does not hide how the water beside it varies. Where more than a
    tenth of the echoes are saturated, it is unknown.
    """
    intensity = column("intensity")
    if intensity is None:
        return None
    sums = _sums(points, top, column, intensity)
    found = np.full(points.grid.lowest.shape, np.nan)
    for width in _WIDTHS:
        for slot, (echoes, freedom, scatter, clipped) in _around(points.grid, sums, width):
            known = np.isnan(found[slot]) & (freedom >= _LEAST_FREEDOM - 0.5) & (clipped <= _SATURATED_SHARE * echoes)
            found[slot][known] = np.sqrt(scatter[known] / freedom[known])
    return found


def _sums(points: GriddedPoints, top: Cells, column: Column, intensity: NDArray[Any]) -> Sequence[NDArray[np.float32]]:
    """Return of each cell the number of echoes, that less one, as many times the relative variance, and the saturated.

    Each has the shape (S, 256, 256). A cell without brightness has no degrees of freedom.
    """
    size, saturated = points.grid.lowest.size, saturated_echoes(intensity)
    number, full = np.zeros((2, size), np.float32)
    mean, scatter = np.zeros((2, size))  # first the sums of intensities, and of their squares
    for used, cell in _single_echoes(points, top, column):
        value = np.nan_to_num(intensity[used]).astype(np.float64)
        np.add.at(number, cell, 1)
        np.add.at(mean, cell, value)
        np.add.at(scatter, cell, value**2)
        if saturated is not None:
            np.add.at(full, cell, saturated[used])
    mean /= np.maximum(number, 1)
    scatter -= number * mean**2
    bright = mean > 0
    np.divide(scatter, mean**2, out=scatter, where=bright)
    freedom = np.where(bright, number - 1, np.float32(0))
    relative = np.where(bright, np.maximum(scatter, 0), 0).astype(np.float32)
    return [values.reshape(points.grid.lowest.shape) for values in (number, freedom, relative, full)]


def _single_echoes(
    points: GriddedPoints, top: Cells, column: Column
) -> Iterator[tuple[NDArray[np.intp], NDArray[np.int32]]]:
    """Yield the points of pulses with one echo that are no higher than ``top``, and their cells, part by part."""
    returns = column("number_of_returns")
    start = 0
    for z, cell in points:
        used = np.flatnonzero(cell != NOWHERE)
        used = used[z[used] <= top.reshape(-1)[cell[used]]]
        if returns is not None:
            used = used[returns[used + start] <= 1]
        yield used + start, cell[used]
        start += len(cell)


def _around(
    grid: ElevationGrid, sums: Sequence[NDArray[np.float32]], width: int
) -> Iterator[tuple[int, Sequence[Cells]]]:
    """Yield the index of each block, and each of the sums over the cells around its cells."""
    from scipy import ndimage  # slow to import, not needed without land

    halo = width // 2
    inner = (slice(halo, halo + BLOCK),) * 2
    for blocks in zip(*(grid.padded(values, halo) for values in sums), strict=True):
        means = (ndimage.uniform_filter(np.where(np.isfinite(cells), cells, 0), width) for _, cells, _ in blocks)
        yield blocks[0][0], [np.maximum(mean[inner], 0) * width**2 for mean in means]
