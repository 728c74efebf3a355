"""Morphological opening: equal to scipy on full grids, and to the definition, cell by cell, on any grid."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from seaclutter_cli.errors import InputError
from seaclutter_cli.grids import elevation as grids
from seaclutter_cli.grids import opening as openings
from seaclutter_cli.grids.elevation import ElevationGrid
from seaclutter_cli.grids.opening import filled, half_window, open_grid, opened, without_pits
from tests.filters.reference import Opening

GRIDS = st.builds(
    lambda seed, rows, columns, empty: _random(seed, (rows, columns), empty),
    st.integers(0, 2**32),
    st.integers(1, 12),
    st.integers(1, 12),
    st.sampled_from([0.0, 0.3, 0.8]),
)


def _random(seed, shape, empty):
    rng = np.random.default_rng(seed)
    values = rng.integers(-5, 6, shape).astype(float)
    values[rng.random(shape) < empty] = np.inf
    return values


@pytest.mark.parametrize("half", [0, 1, 3, 11])
def test_a_full_grid_is_opened_as_by_scipy(half):
    values = np.random.default_rng(1).normal(size=(37, 23))
    np.testing.assert_array_equal(
        opened(values, half), ndimage.grey_opening(values, 2 * half + 1, mode="constant", cval=-np.inf)
    )


@given(values=GRIDS, half=st.integers(0, 4))
@settings(deadline=None)
def test_any_grid_is_opened_as_defined(values, half):
    """The reference gets only the cells with points; points in the corners give it the extent of the array."""
    values[0, 0], values[-1, -1] = 1.0, 2.0
    loops = Opening({cell: values[cell] for cell in zip(*np.nonzero(np.isfinite(values)), strict=True)}, half)
    found = opened(filled(values, 2 * half + 1), half)
    for cell in loops.lowest:
        assert found[cell] == loops.opened(cell)


@given(values=GRIDS, half=st.integers(0, 4))
@settings(deadline=None)
def test_an_opening_is_not_above_the_grid_and_is_idempotent(values, half):
    once = opened(values, half)
    assert (once <= values).all()
    known = np.where(np.isinf(once), np.inf, once)
    if np.isfinite(known).all():
        np.testing.assert_array_equal(opened(known, half), once)


@pytest.mark.parametrize("bits", [3, 4])
def test_the_result_does_not_depend_on_blocks(monkeypatch, bits):
    rng = np.random.default_rng(3)
    xyz = np.vstack([rng.uniform(-40, 50, (2, 900)), rng.normal(size=(1, 900))])
    whole = ElevationGrid(1.0)
    cells = whole.add(xyz)
    expected = open_grid(whole, 7.0).ravel()[cells]
    for module in (grids, openings):
        monkeypatch.setattr(module, "BLOCK", 1 << bits)
    monkeypatch.setattr(grids, "_BITS", bits)
    monkeypatch.setattr(grids, "FREE_BLOCKS", 900)
    divided = ElevationGrid(1.0)
    cells = np.concatenate([divided.add(xyz[:, start : start + 250]) for start in range(0, 900, 250)])
    assert len(divided.blocks) > 30
    np.testing.assert_array_equal(open_grid(divided, 7.0).ravel()[cells], expected)


def test_window_in_cells():
    assert [half_window(w, 0.1) for w in (0.1, 0.2, 0.6, 20.0)] == [0, 1, 3, 100]


def test_an_outlying_point_costs_one_block_and_many_are_refused():
    grid = ElevationGrid(1.0)
    grid.add(np.array([[0.0, 1e9, -1e300], [0, 1e9, 1e300], [0, 1, 2]]))
    assert len(grid.blocks) == 3
    far = np.arange(130) * 1e4
    with pytest.raises(
        InputError, match=r"133 points are scattered over more than 128 squares of 256 m.* cut the tile"
    ):
        grid.add(np.stack((far, far, far)))


def test_more_points_may_be_in_more_blocks():
    grid = ElevationGrid(1.0)
    far = np.repeat(np.arange(200) * 1e4, 200)
    grid.add(np.stack((far, far, far)))
    assert len(grid.blocks) == 200
    with pytest.raises(InputError, match="more than 800 squares"):
        grid.add(np.repeat(np.arange(1000) * 1e4, 500) * np.ones((3, 1)))


def test_scattered_points_take_small_windows(monkeypatch):
    sizes = []

    def counted(lowest, half):
        sizes.append(lowest.size)
        return opened(lowest, half)

    monkeypatch.setattr(openings, "opened", counted)
    grid = ElevationGrid(1.0)
    far = np.arange(50) * 1e4
    cells = grid.add(np.stack((far, -far, far % 7)))
    surface = open_grid(grid, 4.0)
    np.testing.assert_array_equal(surface.ravel()[cells], far % 7)
    assert len(sizes) == 50
    assert max(sizes) <= (2 * 9 + 1) ** 2


def test_two_pits_beside_an_empty_cell_and_an_object_are_filled():
    """Below a platform, two pulses return from below the surface, and one not at all."""
    values = np.random.default_rng(3).normal(0, 0.02, (40, 40))
    values[21, 12:20] = 3.0
    values[20, 14], values[20, 15], values[21, 14] = -17.0, -17.4, np.inf
    known = np.isfinite(values)
    grid = ElevationGrid(1.0)
    grid.add(np.stack((*np.nonzero(known), values[known])) + np.array([[0.5], [0.5], [0]]))
    assert without_pits(grid, 1.0)[0, :40, :40][known].min() > -0.1
