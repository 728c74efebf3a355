"""Objects in rough water by the steps at their edges."""

import numpy as np
import pytest

from seaclutter_cli.airborne.looks import Look
from seaclutter_cli.airborne.separation import OTHER, WATER, separate
from seaclutter_cli.airborne.steps import mean_edge, with_steps
from seaclutter_cli.airborne.surface import SeparationParams
from seaclutter_cli.grids.elevation import ElevationGrid

X, Y = (side.ravel() + 0.5 for side in np.mgrid[:200, :160].astype(float))


def swell(height=1.5, length=100.0, seed=1):
    """Return swell of a significant height, with 2 cm of noise."""
    k = 2 * np.pi / length
    z = height / 2 / np.sqrt(2) * np.sin(k * (0.8 * X + 0.6 * Y))
    return z + np.random.default_rng(seed).normal(0, 0.02, len(X))


def rectangle(length, width, center=(100.0, 80.0)):
    return (np.abs(X - center[0]) < length / 2) & (np.abs(Y - center[1]) < width / 2)


def found(z, known=slice(None), shift=(0.0, 0.0), used=None):
    """Return whether the cell of each point has steps all around."""
    xyz = np.stack((X + shift[0], Y + shift[1], z))
    grid = ElevationGrid(1.0)
    grid.add(xyz[:, known])
    look = Look.of(grid, 20.0, 1.0)
    may_be = np.isfinite(look.lowest)
    if used is not None:
        may_be.reshape(-1)[grid.locate(*xyz[:2, ~used])] = False
    above = np.where(np.isfinite(look.lowest), look.lowest - look.opened, -np.inf)
    return with_steps(grid, look.lowest, may_be, above).reshape(-1)[grid.locate(*xyz[:2])]


def test_the_mean_edge_is_that_of_all_sides_beside_known_cells():
    rng = np.random.default_rng(7)
    z = rng.normal(0, 1, len(X))
    grid = ElevationGrid(1.0)
    grid.add(np.stack((X, Y, z))[:, rng.random(len(X)) < 0.8])
    known = np.isfinite(grid.lowest)
    member = np.zeros(known.shape, np.int32)
    member[0, 50:60, 40:48], member[0, 100:104, 90:97] = 1, 2
    member[~known] = 0
    expected = [[], [], []]
    for i, j in np.argwhere(member[0]).tolist():
        for row, column in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)):
            if known[0, row, column] and not member[0, row, column]:
                expected[member[0, i, j]].append(max(grid.lowest[0, i, j] - grid.lowest[0, row, column], 0))
    found = mean_edge(grid, grid.lowest, known, member)
    assert found[0] == np.inf
    assert found[1:] == pytest.approx([np.mean(own) for own in expected[1:]])


@pytest.mark.parametrize("size", [(40, 11), (10, 7), (4, 3)])
@pytest.mark.parametrize("height", [0.5, 2.0])
def test_rafts_and_barges(size, height):
    own = rectangle(*size)
    z = swell()
    np.testing.assert_array_equal(found(np.where(own, z[own].mean() + height, z)), own)


def test_across_blocks():
    own = rectangle(20, 9)
    z = np.where(own, 1.5, swell())
    np.testing.assert_array_equal(found(z, shift=(156.0, 176.0)), own)  # a corner of four blocks is amid the barge


def test_some_cells_are_empty():
    own, known = rectangle(30, 11), np.random.default_rng(2).random(len(X)) < 0.7
    z = np.where(own, 1.5, swell())
    inside = found(z, known)
    assert inside[known & own].mean() > 0.98  # a cell amid empty ones is not connected
    assert not inside[known & ~own].any()


@pytest.mark.parametrize(
    ("height", "length"), [(0.5, 12.0), (0.8, 20.0), (1.5, 36.0), (1.5, 60.0), (2.0, 100.0), (1.5, 8.0)]
)
def test_waves_have_no_steps(height, length):
    crossing = swell(height, length) + swell(height / 2, length / 2, seed=3)[::-1]
    assert not found(crossing).any()


def test_a_reef_that_slopes_is_left_to_its_height():
    z = swell() + np.maximum(1.5 - np.hypot(X - 100, Y - 80) / 7, 0)
    assert not found(z).any()


@pytest.mark.parametrize("size", [(2, 3), (7, 1)])
def test_what_is_smaller_than_eight_cells(size):
    own = rectangle(*size, center=(100.0, 80.5))
    assert not found(np.where(own, 1.5, swell())).any()


def test_a_step_along_two_of_four_sides_is_not_enough():
    own = rectangle(12, 12)
    z = np.where(own, (X - 94) / 12 * 1.2, 0.0) + swell(0.02)
    assert not found(z).any()


def test_sides_on_land_do_not_count():
    own, land = rectangle(10, 7), rectangle(30, 20) & ~rectangle(10, 7)
    assert not found(np.where(own, 1.5, swell(0.4)), used=~land).any()


def test_a_barge_in_sparse_swell_is_an_object():
    rng = np.random.default_rng(4)
    own = rectangle(45, 11)
    z = swell(1.5, 90.0) + 0.15 * np.sin(X + rng.normal(0, 0.3, len(X)))
    xyz = np.stack((X, Y, np.where(own, z[own].mean() + 0.9, z)))
    known = rng.random(len(X)) < 0.6
    classes = separate([xyz[:, known]], SeparationParams(land="ignore")).classification
    assert (classes[own[known]] == OTHER).mean() > 0.98
    assert (classes[~own[known]] == WATER).mean() > 0.995
