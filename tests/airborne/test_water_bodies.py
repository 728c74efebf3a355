"""Bodies of water from the level, waves and reflections of squares."""

import numpy as np

from seaclutter_cli.airborne.grid import ElevationGrid
from seaclutter_cli.airborne.squares import SIDE, Echoes, SquareWaves, squares_of
from seaclutter_cli.airborne.water_bodies import find_bodies

SQUARES = 20


def squares(level_m):
    """Return squares of one point per square metre, of one level each, shape (20, 20)."""
    cells = np.kron(level_m, np.ones((SIDE, SIDE))) + np.random.default_rng(4).normal(0, 0.02, (SQUARES * SIDE,) * 2)
    grid = ElevationGrid(1.0)
    grid.add(np.stack((*(np.indices(cells.shape).reshape(2, -1) + 0.5), cells.ravel())))
    return squares_of(grid, grid.lowest, np.isfinite(grid.lowest))


def is_water(level_m, deviation_m, variation):
    """Return whether the largest body is water, in waves of this deviation."""
    found = squares(level_m)
    number = len(found.index)
    same = np.ones(number)
    waves = SquareWaves(same * np.median(level_m), same * deviation_m, same > 0)
    bodies = find_bodies(found, Echoes(same * variation, same * 0, np.zeros(number, np.int8)), waves)
    return max(bodies, key=lambda body: len(body.squares)).is_water


def test_troughs_of_long_waves_do_not_drain_a_mirror():
    """They are somewhat deeper than three deviations of the waves of a part that shows less than one length."""
    x, y = np.indices((SQUARES, SQUARES))
    troughs = np.where((x % 6 == 2) & (y % 7 < 5), -0.25, 0.0)
    assert is_water(troughs, 0.05, 1.0)
    assert not is_water(3 * troughs, 0.05, 1.0)


def test_squares_have_a_sill_only_if_a_wall_crosses_them():
    cells = np.zeros((SQUARES * SIDE,) * 2)
    cells[:, 43] = 2.0  # across all ways along the rows
    cells[::2, 100] = 2.0
    grid = ElevationGrid(1.0)
    grid.add(np.stack((*(np.indices(cells.shape).reshape(2, -1) + 0.5), cells.ravel())))
    found = squares_of(grid, grid.lowest, np.isfinite(grid.lowest))
    row = found.xy[1] - found.xy[1].min()
    np.testing.assert_array_equal(found.sill_m, [np.zeros(len(row)), 2.0 * (row == 43 // SIDE)])
    np.testing.assert_array_equal(found.top_m, 2.0 * np.isin(row, (43 // SIDE, 100 // SIDE)))
