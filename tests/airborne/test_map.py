"""Maps of tiles: what is in each cell, and the shoreline."""

import numpy as np
import pytest

from seaclutter_cli.airborne import map as airborne_map
from seaclutter_cli.airborne.map import IS_LAND, IS_OBJECT, IS_WATER, UNKNOWN, TileMap, map_of, shoreline_of
from seaclutter_cli.airborne.separation import separate
from seaclutter_cli.airborne.surface import SeparationParams

pytest.importorskip("contourpy")
CENTER, RADIUS = np.array([120.0, 90.0]), 40.0


@pytest.fixture(scope="module")
def island():
    """Return a round island, a ship and a gap in calm water, one point per cell, as points and their separation."""
    x, y = (side.ravel() + 0.5 for side in np.mgrid[:250, :180].astype(float))
    z = np.where(np.hypot(x - CENTER[0], y - CENTER[1]) < RADIUS, 6.0, 0.5)
    z[(np.abs(x - 220) < 5) & (np.abs(y - 50) < 20)] = 4.0
    kept = ~((x > 200) & (y > 150))
    xyz = np.stack((x, y, z))[:, kept]
    return xyz, separate([xyz], SeparationParams())


def test_cells(island):
    xyz, found = island
    tile = map_of([xyz[:, :9000], xyz[:, 9000:]], found, 1.0)
    assert tile.first == (0, 0)
    assert tile.kind.shape == (250, 180)
    for place, kind in (((120, 90), IS_LAND), ((220, 50), IS_OBJECT), ((20, 20), IS_WATER), ((240, 170), UNKNOWN)):
        assert tile.kind[place] == kind
    assert tile.level_m[20, 20] == pytest.approx(0.5)
    assert np.isnan(tile.level_m[120, 90])


def test_the_shoreline_of_a_round_island_is_a_circle(island):
    xyz, found = island
    (line,) = shoreline_of(map_of([xyz], found, 1.0))
    np.testing.assert_allclose(np.hypot(*(line - CENTER).T), RADIUS, atol=1.5)
    np.testing.assert_array_equal(line[0], line[-1])
    x, y = (line - CENTER).T
    turned = (x[:-1] * y[1:] - x[1:] * y[:-1]).sum()
    assert turned == pytest.approx(2 * np.pi * RADIUS**2, rel=0.1)  # counter-clockwise: land is on the left


def test_places_are_those_of_the_points(island):
    xyz, found = island
    far = xyz + np.array([[1_000_000.25], [-2_000_000.0], [0.0]])
    (line,) = shoreline_of(map_of([far], separate([far], SeparationParams()), 1.0))
    np.testing.assert_allclose(line.mean(axis=0), np.add(CENTER, (1_000_000.25, -2_000_000.0)), atol=1.5)
    assert len(found.land.blocks) > 0


def test_no_shoreline_without_land_or_with_single_cells_of_it(island):
    xyz, found = island
    tile = map_of([xyz], found, 1.0)
    kind = tile.kind.copy()
    kind[kind == IS_LAND] = IS_WATER
    assert shoreline_of(TileMap(1.0, (0, 0), kind, tile.level_m)) == []
    kind[50:58, 50:58] = IS_LAND
    assert shoreline_of(TileMap(1.0, (0, 0), kind, tile.level_m)) == []


def test_coarser_maps_keep_objects(island):
    xyz, found = island
    fine = map_of([xyz], found, 1.0)
    coarse = fine.coarser(12.0)
    assert (coarse.cell_m, coarse.kind.shape) == (12.0, (21, 15))
    assert coarse.kind[220 // 12, 50 // 12] == IS_OBJECT
    assert coarse.kind[10, 7] == IS_LAND
    np.testing.assert_allclose(coarse.level_m[coarse.kind == IS_WATER], 0.5)
    assert fine.coarser(0.3).kind is not None
    np.testing.assert_array_equal(fine.coarser(0.3).kind, fine.kind)


def test_outlying_points_do_not_make_large_maps(island, monkeypatch):
    assert airborne_map._MAX_CELLS <= 2**24
    monkeypatch.setattr(airborne_map, "_MAX_CELLS", 2**16)
    xyz, _ = island
    far = np.concatenate([xyz, [[60_000.0], [60_000.0], [0.5]]], axis=1)
    tile = map_of([far], separate([far], SeparationParams()), 1.0)
    assert tile.kind.size <= 2**16
    assert tile.cell_m == 256.0
