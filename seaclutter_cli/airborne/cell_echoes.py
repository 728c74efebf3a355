"""How cells reflect: the variation of the intensities in and around each."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.echoes import saturated_echoes
from seaclutter_cli.airborne.grid import BLOCK, ElevationGrid
from seaclutter_cli.airborne.gridded import NOWHERE, GriddedPoints
from seaclutter_cli.airborne.strips import Column

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
    shape = points.grid.lowest.shape
    intensity = column("intensity")
    if intensity is None:
        return None
    saturated = saturated_echoes(intensity)
    number, total, squared, full = (np.zeros(points.grid.lowest.size) for _ in range(4))
    for used, cell in _single_echoes(points, top, column):
        value = np.nan_to_num(intensity[used]).astype(np.float64)
        np.add.at(number, cell, 1)
        np.add.at(total, cell, value)
        np.add.at(squared, cell, value**2)
        if saturated is not None:
            np.add.at(full, cell, saturated[used])
    mean = total / np.maximum(number, 1)
    scatter = np.maximum(squared - number * mean**2, 0)
    relative = np.divide(scatter, mean**2, out=np.zeros(len(mean)), where=mean > 0)
    sums = [values.reshape(shape) for values in (number, relative, np.where(mean > 0, number - 1, 0), full)]
    found = np.full(shape, np.nan)
    for width in _WIDTHS:
        echoes, scatter, freedom, clipped = (_around(points.grid, values, width) for values in sums)
        known = np.isnan(found) & (freedom >= _LEAST_FREEDOM - 0.5) & (clipped <= _SATURATED_SHARE * echoes)
        found[known] = np.sqrt(scatter[known] / freedom[known])
    return found


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


def _around(grid: ElevationGrid, values: Cells, width: int) -> Cells:
    """Return the sum of values over the cells around each."""
    from scipy import ndimage  # slow to import, not needed without land

    out, halo = np.empty(values.shape), width // 2
    inner = (slice(halo, halo + BLOCK),) * 2
    for slot, cells, _ in grid.padded(values, halo):
        mean = ndimage.uniform_filter(np.where(np.isfinite(cells), cells, 0), width)
        out[slot] = np.maximum(mean[inner], 0) * width**2
    return out
