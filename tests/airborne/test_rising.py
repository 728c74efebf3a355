"""What rises out of rough water."""

import numpy as np
import pytest

from seaclutter_cli.airborne.following import FollowedSurface
from seaclutter_cli.airborne.rising import _are_objects, _highest_of_water, _low_objects
from seaclutter_cli.airborne.separation import OTHER, separate
from seaclutter_cli.airborne.surface import SeparationParams
from seaclutter_cli.grids.elevation import ElevationGrid


@pytest.mark.parametrize(
    ("crests", "certain", "contrast", "expected"),
    [(40, 0, 3.0, False), (40, 3, 3.0, False), (10, 0, 3.0, True), (40, 8, 3.0, True), (40, 3, 1.5, True)],
    ids=["foam", "its highest cells", "not on a crest", "a boat on a crest", "dark"],
)
def test_bright_groups_on_crests_are_foam(crests, certain, contrast, expected):
    shape = (1, 10, 8)
    group = np.zeros(shape, np.int32)
    group.reshape(-1)[:40] = 1
    first = np.arange(80).reshape(shape)
    none = np.zeros(shape)
    sea = FollowedSurface(none, none, none, np.full(shape, contrast), none > 0, first < crests)
    found = _are_objects(group, group > 0, first < certain, sea, np.full(shape, 3.0), 1.0)
    np.testing.assert_array_equal(found, [False, expected])


@pytest.mark.parametrize(
    ("cells", "beside", "on_crest", "expected"),
    [(8, False, 4, True), (7, False, 0, False), (1, True, 0, True), (8, False, 5, False), (8, True, 5, False)],
    ids=["long", "short", "beside an object", "on a crest", "on a crest beside an object"],
)
def test_low_groups_are_objects_by_size_or_beside_others(cells, beside, on_crest, expected):
    grid = ElevationGrid(1.0)
    grid.add(np.stack((*(np.indices((40, 40)).reshape(2, -1) + 0.5), np.zeros(1600))))
    risen, near, crests = np.zeros((3, *grid.lowest.shape), np.bool_)
    risen[0, 10, 5 : 5 + cells] = True
    near[0, 10, 5] = beside
    crests[0, 10, 5 : 5 + on_crest] = True
    np.testing.assert_array_equal(_low_objects(grid, risen, near, crests), risen & expected)


def test_the_highest_echoes_of_cells_that_show_two_moments_are_compared_with_those_around():
    rng = np.random.default_rng(3)
    grid = ElevationGrid(1.0)
    place = np.indices((120, 120)).reshape(2, -1) + 0.5
    grid.add(np.stack((*place, np.zeros(place.shape[1]))))
    used = np.isfinite(grid.lowest)
    mixed = np.zeros(used.shape, np.bool_)
    mixed[0, 108:118, :120] = True
    high = np.where(mixed, rng.normal(3, 2, used.shape), rng.normal(0, 1, used.shape))
    high[0, 20:60, 50] = 6
    for may_mix in (True, False):
        risen = used & (high > _highest_of_water(grid, high, used, may_mix=may_mix))
        assert risen[0, 20:60, 50].all()
        assert (risen & mixed).mean() < 0.001 if may_mix else (risen & mixed)[mixed].mean() > 0.1


@pytest.mark.parametrize(("length", "least", "most"), [(40, 0.8, 1), (3, 0, 0)], ids=["boom", "as short as a crest"])
def test_low_objects_narrower_than_a_cell_are_found_by_their_length(length, least, most):
    rng = np.random.default_rng(5)
    x, y = rng.uniform(0, 150, (2, 8 * 150**2))
    z = sum(np.sin(2 * np.pi * (np.cos(a) * x + np.sin(a) * y) / 20 + rng.uniform(0, 7)) for a in rng.normal(0, 0.4, 9))
    z = 0.8 / 4 * z / z.std()
    boom = (np.abs(y - 75.5) < 0.2) & (np.abs(x - 70) < length / 2)
    z += np.where(boom, 0.24, 0) + rng.normal(0, 0.02, len(z))
    found = separate([np.stack((x, y, z))], SeparationParams())
    other = found.classification == OTHER
    assert found.sea.surface == "followed"
    assert least <= other[boom].mean() <= most
    assert other[~boom].mean() < 1e-4
