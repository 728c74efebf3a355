"""Islands by level, against a labelling by scipy."""

import numpy as np
import pytest
from scipy import ndimage

from seaclutter_cli.airborne.shores import commonest_level, island_cells
from seaclutter_cli.grids.elevation import ElevationGrid


def grid_of(elevation):
    """Return the grid of one point in each cell of 1 m."""
    x, y = (side.ravel() + 0.5 for side in np.indices(elevation.shape).astype(float))
    grid = ElevationGrid(1.0)
    grid.add(np.stack((x, y, elevation.ravel())))
    return grid


def elevations(seed):
    """Return smooth relief over the edge of a block, some of which is higher than 2 m."""
    rng = np.random.default_rng(seed)
    relief = ndimage.gaussian_filter(rng.normal(size=(300, 40)), 4)
    return 1.3 * relief / relief.std()


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("also", [False, True])
def test_islands_are_the_groups_above_the_water_with_a_cell_that_is_high(seed, also):
    z = elevations(seed)
    grid = grid_of(z)
    seeds = np.zeros(z.shape, bool)
    seeds[150, 20] = also
    label, number = ndimage.label((z > 0.5) | seeds, np.ones((3, 3)))
    high = ndimage.maximum(np.where(seeds, np.inf, z), label, np.arange(number + 1)) > 2.0
    high[0] = False
    padded = np.zeros(grid.lowest.shape, bool)
    for (column, row), slot in grid.blocks.items():
        own = seeds[256 * column : 256 * (column + 1), 256 * row : 256 * (row + 1)]
        padded[slot, : own.shape[0], : own.shape[1]] = own
    found = island_cells(grid, np.where(np.isfinite(grid.lowest), grid.lowest, -np.inf), 0.0, 0.5, 2.0, padded)
    cells = found.reshape(-1)[grid.add(np.stack([side.ravel() for side in (*np.indices(z.shape) + 0.5, z)]))]
    assert 0 < high.sum() < number
    np.testing.assert_array_equal(cells.reshape(z.shape), high[label])


def test_the_commonest_level_is_that_of_the_sea():
    z = np.concatenate((np.full(60, 0.1), np.linspace(1, 30, 100)))[:, None]
    grid = grid_of(z)
    assert commonest_level(grid, grid.lowest, 0.5) == pytest.approx(0.1)
