"""Bodies of water from the level, waves and reflections of squares."""

from dataclasses import replace

import numpy as np
import pytest

from seaclutter_cli.airborne.echoes import Echoes
from seaclutter_cli.airborne.land import _beside_water
from seaclutter_cli.airborne.reflection import are_foam
from seaclutter_cli.airborne.squares import SIDE, SquareWaves, are_moving, squares_of
from seaclutter_cli.airborne.water_bodies import WaterBody, _have_mirrors, find_bodies
from seaclutter_cli.grids.elevation import ElevationGrid

SQUARES = 20


def squares(level_m, spread_m=0.02):
    """Return squares of one point per square metre, of one level each, shape (20, 20)."""
    noise = np.random.default_rng(4).normal(0, spread_m, (SQUARES * SIDE,) * 2)
    cells = np.kron(level_m, np.ones((SIDE, SIDE))) + noise
    grid = ElevationGrid(1.0)
    grid.add(np.stack((*(np.indices(cells.shape).reshape(2, -1) + 0.5), cells.ravel())))
    return squares_of(grid, grid.lowest, np.isfinite(grid.lowest))


def echoes(variation):
    """Return echoes of single pulses from squares with this variation."""
    none, unknown = np.zeros(len(variation)), np.full(len(variation), np.nan)
    return Echoes(variation, none, none, none, unknown, none > 0, none.astype(np.int8))


def square_waves(level_m, deviation_m, measured):
    """Return waves of 50 m."""
    return SquareWaves(level_m, deviation_m, np.where(deviation_m > 0, 50.0, 0.0), measured)


def is_water(level_m, deviation_m, variation, spread_m=0.02):
    """Return whether there are bodies, and the largest is water, in waves of this deviation."""
    found = squares(level_m, spread_m)
    number = len(found.index)
    same = np.ones(number)
    waves = square_waves(same * np.median(level_m) if deviation_m else found.level_m, same * deviation_m, same > 0)
    bodies = find_bodies(found, echoes(same * variation), waves)
    return bool(bodies) and max(bodies, key=lambda body: len(body.squares)).is_water


def test_troughs_of_long_waves_do_not_drain_a_mirror():
    """They are somewhat deeper than three deviations of the waves of a part that shows less than one length."""
    x, y = np.indices((SQUARES, SQUARES))
    troughs = np.where((x % 6 == 2) & (y % 7 < 5), -0.25, 0.0)
    assert is_water(troughs, 0.05, 1.0)
    assert not is_water(3 * troughs, 0.05, 1.0)


@pytest.mark.parametrize(
    ("measured_share", "depth", "are_water"), [(0.5, 0.9, True), (0.2, 0.9, False), (0.5, 1.3, False)]
)
def test_troughs_beside_measured_waves_that_come_in_groups_do_not_drain_them(measured_share, depth, are_water):
    x, y = np.indices((SQUARES, SQUARES))
    found = squares(np.where((x % 6 == 2) & (y % 7 < 5), -depth, 0.0), 0.25)
    number = len(found.index)
    none, unknown = np.zeros(number), np.full(number, np.nan)
    free = Echoes(unknown, none, none, none, unknown, none > 0, none.astype(np.int8))
    measured = found.xy[0] - found.xy[0].min() < measured_share * SQUARES
    bodies = find_bodies(found, free, square_waves(none, np.full(number, 0.25), measured))
    assert any(body.is_water for body in bodies) == are_water


def test_a_slope_where_waves_were_measured_in_a_corner_of_still_water_does_not_count():
    x, y = np.indices((SQUARES, SQUARES))
    corner = (x < 6) & (y < 6)
    found = squares(np.where(corner, 0.016 * (x - 2.5), 0.0))
    measured = corner[tuple(found.xy - found.xy.min(axis=1, keepdims=True))]
    same = np.ones(len(measured))
    waves = square_waves(np.where(measured, 0.0, found.level_m), 0.03 * measured, measured)
    (body,) = find_bodies(found, echoes(same), waves)
    assert body.is_water


@pytest.mark.parametrize(("rise", "are_water"), [(0.25, True), (0.6, False)])
def test_a_crest_amid_waves_that_come_in_groups_is_water(rise, are_water):
    """Waves have a deviation of 0.15 m in a third of the tile, and of 0.05 m elsewhere, also around the crest."""
    x, y = np.indices((SQUARES, SQUARES))
    crest = (x >= 13) & (x < 15) & (y >= 8) & (y < 12)
    found = squares(rise * crest, 0.05)
    place = found.xy - found.xy.min(axis=1, keepdims=True)
    deviation = np.where(place[0] < SQUARES / 3, 0.15, 0.05)
    unknown, level = np.full(len(place[0]), np.nan), np.where(crest[tuple(place)], rise, 0.0)
    waves = square_waves(level, np.where(level > 0, 0, deviation), level == 0)
    bodies = find_bodies(found, echoes(unknown), waves)
    assert [len(body.squares) for body in bodies] == [SQUARES**2 - 8, 8]
    assert [body.is_water for body in bodies] == [True, are_water]


@pytest.mark.parametrize(
    ("variation", "deviation", "rise", "are_water"),
    [(0.42, 0.2, 0.1, 2), (0.3, 0.2, 0.0, 1), (0.42, 0.0, 0.0, 2), (0.42, 0.0, 0.1, 1), (0.3, 0.0, 0.0, 1)],
)
def test_dark_water_amid_water_that_hardly_reflects_like_a_mirror(variation, deviation, rise, are_water):
    """Near the holes below the aircraft, echoes are weak; a raft on still water is higher."""
    x, y = np.indices((SQUARES, SQUARES))
    patch = (x >= 8) & (x < 10) & (y >= 8) & (y < 12)
    found = squares(rise * patch, 0.05)
    own = patch[tuple(found.xy - found.xy.min(axis=1, keepdims=True))]
    same = np.ones(len(own))
    waves = square_waves(0.0 * same, deviation * same, same > 0)
    bodies = find_bodies(found, echoes(np.where(own, variation, 0.8)), waves)
    assert sum(body.is_water for body in bodies) == are_water


@pytest.mark.parametrize(("rise", "are_water"), [(0.25, True), (2.0, False)])
def test_dark_crests_and_troughs_side_by_side_amid_water(rise, are_water):
    """The one in the corner of the tile mostly touches the other, which may be a rock."""
    x, y = np.indices((SQUARES, SQUARES))
    inner, outer = ((x < 3) & (y // 2 == at) for at in (0, 1))
    found = squares(-0.25 * inner + rise * outer, 0.05)
    place = tuple(found.xy - found.xy.min(axis=1, keepdims=True))
    own = (inner | outer)[place]
    same = np.ones(len(own))
    waves = square_waves(0.0 * same, 0.2 * same, same > 0)
    bodies = find_bodies(found, echoes(np.where(own, 0.42, 0.8)), waves)
    assert sorted(len(body.squares) for body in bodies) == [6, 6, SQUARES**2 - 12]
    assert all(body.is_water for body in bodies) == are_water


@pytest.mark.parametrize(
    ("variation", "brightness", "are_water"),
    [(0.4, 0.1, True), (0.4, 1.0, False), (0.2, -1.0, False)],
)
def test_weak_echoes_at_the_edge_of_a_strip(variation, brightness, are_water):
    """They are 4 % of the tile, around six squares whose level the waves make another region."""
    x, y = np.indices((SQUARES, SQUARES))
    corner, inner = ((x < side) & (y < high) for side, high in ((4, 4), (2, 3)))
    found = squares(0.2 + 0.3 * inner, 0.05)
    own = corner[tuple(found.xy - found.xy.min(axis=1, keepdims=True))]
    same = np.ones(len(own))
    waves = square_waves(0.2 * same, 0.15 * same, same > 0)
    seen = replace(echoes(np.where(own, variation, 0.8)), brightness=np.where(own, brightness, 0.0))
    bodies = find_bodies(found, seen, waves)
    assert sorted(len(body.squares) for body in bodies) == [6, 10, SQUARES**2 - 16]
    assert all(body.is_water for body in bodies) == are_water


def test_a_trough_has_the_level_of_the_waves_in_it():
    """It is a region of its own, as their level is another than that of the waves around."""
    x, y = np.indices((SQUARES, SQUARES))
    trough = (x >= 8) & (x < 10) & (y >= 8) & (y < 12)
    found = squares(-0.8 * trough)
    own = trough[tuple(found.xy - found.xy.min(axis=1, keepdims=True))]
    waves = square_waves(np.where(own, -0.3, 0.0), np.full(len(own), 0.25), own | ~own)
    bodies = find_bodies(found, echoes(np.ones(len(own))), waves)
    assert [len(body.squares) for body in bodies] == [SQUARES**2 - 8, 8]
    assert all(body.is_water for body in bodies)
    assert [body.level_m for body in bodies] == pytest.approx([0.0, -0.3], abs=0.05)


@pytest.mark.parametrize(("measured", "expected"), [(True, -0.3), (False, -0.8)])
def test_a_trough_at_the_edge_of_a_tile_is_no_basin_of_its_own(measured, expected):
    """It is a twentieth of the tile; the waves were measured in it."""
    x, y = np.indices((SQUARES, SQUARES))
    trough = (x < 2) & (y < 10)
    found = squares(-0.8 * trough)
    own = trough[tuple(found.xy - found.xy.min(axis=1, keepdims=True))]
    waves = square_waves(np.where(own, -0.3, 0.0), np.full(len(own), 0.25), measured | ~own)
    bodies = find_bodies(found, echoes(np.ones(len(own))), waves)
    assert [len(body.squares) for body in bodies] == [SQUARES**2 - 20, 20]
    assert [body.level_m for body in bodies] == pytest.approx([0.0, expected], abs=0.05)


@pytest.mark.parametrize(("variation", "are_water"), [(0.5, True), (0.2, False)])
def test_squares_that_vary_less_by_chance_are_no_ground_around_water(variation, are_water):
    """Every third column of squares varies less than the others."""
    x, _ = np.indices((SQUARES, SQUARES))
    found = squares(np.zeros((SQUARES, SQUARES)), 0.05)
    less = (x % 3 == 0)[tuple(found.xy - found.xy.min(axis=1, keepdims=True))]
    still = np.zeros(len(less))
    seen = echoes(np.where(less, variation, 0.65))
    bodies = find_bodies(found, seen, square_waves(found.level_m, still, still > 0))
    assert [body.is_water for body in bodies if len(body.squares) == 2 * SQUARES] == 6 * [are_water]


@pytest.mark.parametrize(("move", "are_water"), [(True, True), (False, False)])
def test_foam_reflects_like_ground_and_moves(move, are_water):
    rng = np.random.default_rng(5)
    one, other = rng.normal(0, 0.1, (2, SQUARES, SQUARES))
    x, _ = np.indices((SQUARES, SQUARES))
    found = squares(one, 0.05)
    place = tuple(found.xy - found.xy.min(axis=1, keepdims=True))
    foam, same = (x >= SQUARES // 2)[place], np.ones(len(found.index))
    change = (one - other if move else 0.2 * other)[place]
    moving = are_moving(found, change)
    assert moving.mean() > 0.75 if move else not moving.any()
    seen = replace(echoes(np.where(foam, 0.35, 0.8)), change_m=change, moving=moving)
    bodies = find_bodies(found, seen, square_waves(0.0 * same, 0.1 * same, same > 0))
    assert len(bodies) == 2
    assert [body.is_water for body in bodies if foam[body.squares].all()] == [are_water]


@pytest.mark.parametrize("few", [True, False])
def test_foam_is_bright_and_in_tiles_whose_water_reflects_like_a_mirror(few):
    """Bright and dark squares that move amid mirrors, which a tile has few of; most squares have no intensities."""
    kind = np.arange(400) % 25
    mirror, bright, dark = (kind == number for number in (1, 2, 3))
    mirror &= np.arange(400) < (25 if few else 400)
    variation = np.select([mirror, bright | dark], [0.8, 0.3], np.nan)
    still = echoes(variation)
    seen = replace(still, moving=bright | dark, brightness=np.select([bright, dark], [1.0, -1.0], 0.0))
    np.testing.assert_array_equal(are_foam(seen), bright & (not few))
    assert not are_foam(still).any()


def test_the_strip_of_a_beach_beside_the_sea_does_not_move():
    """The sea moves as far as the beach, which both strips show alike, is steep from square to square."""
    rng = np.random.default_rng(6)
    one, other = rng.normal(0, 0.2, (2, SQUARES, SQUARES))
    x, _ = np.indices((SQUARES, SQUARES))
    sea = x < 12
    found = squares(np.where(sea, one, 0.3 * (x - 11)))
    place = tuple(found.xy - found.xy.min(axis=1, keepdims=True))
    moving = are_moving(found, np.where(sea, one - other, 0.0)[place])
    assert moving[(x < 10)[place]].mean() > 0.75
    assert not moving[~sea[place]].any()
    assert not are_moving(found, np.full(len(moving), np.nan)).any()
    assert not are_moving(squares(0.05 * one), 0.05 * (one - other)[place]).any()


@pytest.mark.parametrize(("variation", "is_sure"), [(0.2, True), (0.4, False)])
def test_a_beach_that_is_clearly_ground_is_dry(variation, is_sure):
    """Its lowest squares are no higher than the waves, and than the bank of rough water."""
    x, _ = np.indices((SQUARES, SQUARES))
    found = squares(np.where(x < 10, 0.0, 0.3 + 0.2 * (x - 10)))
    place = (found.xy - found.xy.min(axis=1, keepdims=True))[0]
    waves = square_waves(0.0 * place, 0.2 + 0.0 * place, place < 10)
    sea, land = (np.flatnonzero(own) for own in (place < 10, place >= 14))
    regions = WaterBody(sea, 0.0, 0.12, is_water=True), WaterBody(land, 1.7, 0.02, is_water=False)
    shore = _beside_water(found, echoes(np.where(place < 10, 0.8, variation)), waves, regions)
    np.testing.assert_array_equal(shore.land, place >= 10)
    assert (shore.is_sure[place == 10] == is_sure).all()


@pytest.mark.parametrize(("change_m", "bodies"), [(0.003, 1), (np.nan, 0)])
def test_fields_whose_relief_two_strips_show_alike_are_land(change_m, bodies):
    """They slope by less than a river, and a part of them looks like waves."""
    rng = np.random.default_rng(5)
    found = squares(rng.normal(0, 0.05, (SQUARES, SQUARES)))
    same = np.ones(len(found.index))
    waves = square_waves(0.0 * same, 0.03 * (found.xy[0] < 4), found.xy[0] < 4)
    seen = replace(echoes(0.2 * same), change_m=change_m * rng.normal(0, 1, len(same)))
    land = find_bodies(found, seen, waves)
    assert len(land) == bodies
    assert not any(body.is_water for body in land)


@pytest.mark.parametrize(("share", "bodies"), [(0.7, 2), (0.3, 0)])
def test_fields_beside_a_relief_that_most_of_the_tile_has_are_land(share, bodies):
    """One strip shows the other fields, which look like waves and slope."""
    rng = np.random.default_rng(5)
    x, _ = np.indices((SQUARES, SQUARES))
    seen_twice = x < share * SQUARES
    found = squares(np.where(seen_twice, rng.normal(0, 0.05, x.shape), 1.0 + 0.015 * (x - share * SQUARES)))
    twice = seen_twice[tuple(found.xy - found.xy.min(axis=1, keepdims=True))]
    same = np.ones(len(twice))
    waves = square_waves(found.level_m, np.where(twice, 0.0, 0.01), ~twice)
    seen = replace(echoes(0.2 * same), change_m=np.where(twice, 0.003 * rng.normal(0, 1, len(same)), np.nan))
    land = find_bodies(found, seen, waves)
    assert [body.is_water for body in land] == bodies * [False]


def test_still_water_around_flats_is_no_field():
    """One region in a hollow: two squares of five are 10 cm higher, and two strips show that alike."""
    x, y = np.indices((SQUARES, SQUARES))
    flat = (x // 2 + 2 * (y // 2)) % 5 < 2
    edge = np.maximum(np.abs(x - 9.5), np.abs(y - 9.5)) > 9
    found = squares(np.where(edge, 2.0, 0.1 * flat))
    same = np.ones(len(found.index))
    seen = replace(echoes(0.2 * same), change_m=0.001 * np.random.default_rng(5).normal(0, 1, len(same)))
    assert not find_bodies(found, seen, square_waves(found.level_m, 0 * same, same < 0))


@pytest.mark.parametrize("trusted", [0, 1, -1])
def test_a_tile_without_regions_has_no_bodies(trusted):
    found = squares(np.add.outer(np.arange(SQUARES), np.arange(SQUARES)))
    same = np.ones(len(found.index))
    seen = replace(echoes(same), known=(trusted * (found.xy[0] + found.xy[1] < 2)).astype(np.int8))
    assert not find_bodies(found, seen, square_waves(found.level_m, 0 * same, same < 0))


@pytest.mark.parametrize(("share", "are_water"), [(0.0, True), (0.1, False)])
def test_nothing_rises_from_most_squares_of_water(share, are_water):
    x, y = np.indices((SQUARES, SQUARES))
    found = squares(np.maximum(np.maximum(x, y) - 12.0, 0))
    unknown = np.full(len(found.index), np.nan)
    inside = found.level_m < 0.5
    seen = replace(echoes(unknown), tall=np.where(inside, share, 0.0))
    waves = square_waves(found.level_m, 0 * found.level_m, np.zeros(len(inside), np.bool_))
    bodies = find_bodies(found, seen, waves)
    assert any(body.is_water for body in bodies) == are_water


@pytest.mark.parametrize("spread", [0.02, 0.1])
def test_a_corner_is_water_if_its_squares_differ_less_than_their_cells(spread):
    """Waves that are shorter than squares do that; fields differ more than the ground within them."""
    x, y = np.indices((SQUARES, SQUARES))
    level = np.where((x < 10) & (y < 10), np.random.default_rng(1).normal(0, 0.05, x.shape), np.maximum(x, y) - 9.0)
    assert is_water(level, 0.0, np.nan, spread) == (spread > 0.05)


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


@pytest.mark.parametrize(
    ("mirrors", "others", "expected"),
    [(30, 0.16, True), (30, 0.5, False), (60, 0.5, True), (15, 0.16, False)],
    ids=["a river amid clear ground", "amid other echoes", "many", "few"],
)
def test_few_mirrors_suffice_amid_clear_ground(mirrors, others, expected):
    variation = np.where(np.arange(1000) < mirrors, 1.0, others)
    unknown = np.full(1000, np.nan)
    echoes = Echoes(variation, unknown, unknown, unknown, unknown, unknown > 0, np.zeros(1000, np.int8))
    assert _have_mirrors(echoes, [np.arange(mirrors), np.arange(mirrors, 1000)]) is expected
