"""The shoreline by cell."""

import numpy as np
import pytest

from seaclutter_cli.airborne.cell_echoes import cell_variation
from seaclutter_cli.airborne.gridded import GriddedPoints
from seaclutter_cli.airborne.shoreline import with_ground
from tests.airborne.coasts import shares, waves

SIDES = 64, 48


def points(rng, count=20, sides=SIDES):
    """Return so many points in each metre, in two parts."""
    x, y = (np.repeat(side.ravel(), count) for side in np.mgrid[: sides[0], : sides[1]].astype(float))
    xyz = np.stack((x + rng.random(len(x)), y + rng.random(len(x)), np.zeros(len(x))))
    half = xyz.shape[1] // 3
    return GriddedPoints.of([xyz[:, :half], xyz[:, half:]], 1.0), xyz


def variation_of(intensity, gridded, **columns):
    top = np.full(gridded.grid.lowest.shape, 0.5)
    return cell_variation(gridded, top, {"intensity": intensity, **columns}.get)[0, : SIDES[0], : SIDES[1]]


def test_variation_is_that_of_water_and_of_ground():
    rng = np.random.default_rng(3)
    gridded, xyz = points(rng)
    water = xyz[0] < 32
    found = variation_of(np.where(water, rng.exponential(500, len(water)), rng.normal(800, 80, len(water))), gridded)
    assert np.median(found[:30]) == pytest.approx(1.0, abs=0.05)
    assert np.median(found[34:]) == pytest.approx(0.1, abs=0.01)
    assert (found[:30] > 0.6).all()
    assert (found[34:] < 0.33).all()


def test_variation_is_the_root_mean_square_of_that_within_cells():
    """By brute force over the three by three cells around one."""
    rng = np.random.default_rng(4)
    gridded, xyz = points(rng, count=3)
    intensity = rng.gamma(2.0, 100, xyz.shape[1]).astype(np.uint16)
    around = [
        intensity[(np.floor(xyz[0]) == i) & (np.floor(xyz[1]) == j)].astype(float)
        for i in (9, 10, 11)
        for j in (19, 20, 21)
    ]
    expected = np.sqrt(np.mean([(np.std(own, ddof=1) / own.mean()) ** 2 for own in around]))
    assert variation_of(intensity, gridded)[10, 20] == pytest.approx(expected, rel=1e-6)


def test_a_bright_bank_does_not_hide_the_variation_of_the_water_beside_it():
    rng = np.random.default_rng(3)
    gridded, xyz = points(rng)
    bank = xyz[0] < 32
    found = variation_of(np.where(bank, rng.normal(9000, 900, len(bank)), rng.exponential(100, len(bank))), gridded)
    assert (found[32] > 0.6).all()


def test_a_gradient_is_no_variation():
    rng = np.random.default_rng(3)
    gridded, xyz = points(rng)
    found = variation_of(100 + 200 * np.floor(xyz[0]) * rng.normal(1, 0.05, xyz.shape[1]), gridded)
    assert np.nanmax(found[2:]) < 0.1


@pytest.mark.parametrize(("doubled", "is_known"), [(0.0, False), (0.2, False), (0.5, True)])
def test_a_few_echoes_tell_nothing(doubled, is_known):
    """One in each cell never does; two in half of all are about twelve degrees of freedom in five by five cells."""
    rng = np.random.default_rng(3)
    _, one = points(rng, count=1)
    again = one[:, rng.permutation(one.shape[1])[: int(doubled * one.shape[1])]]
    gridded = GriddedPoints.of([np.hstack((one, again))], 1.0)
    found = np.isfinite(variation_of(rng.exponential(500, gridded.size), gridded)[5:-5, 5:-5])
    assert (found.mean() > 0.9) if is_known else (found.mean() < 0.2)


def test_five_by_five_cells_are_used_where_three_by_three_have_few_echoes():
    """Every fifth column has none; every other echo is of a pulse with several, which differ much, and do not count."""
    rng = np.random.default_rng(3)
    gridded, xyz = points(rng, count=4)
    several = np.arange(xyz.shape[1]) % 2
    intensity = np.where(several, rng.uniform(0, 1e5, len(several)), rng.normal(800, 80, len(several)))
    found = variation_of(intensity, gridded, number_of_returns=np.where(np.floor(xyz[0]) % 5 == 0, 2, 1 + several))
    assert (found[5:-5, 5:-5] < 0.2).all()


@pytest.mark.parametrize(("mean", "is_known"), [(205, True), (255, False)])
def test_where_many_echoes_are_saturated_nothing_is_known(mean, is_known):
    """Of 205, about one in forty is; of 255, every second one."""
    rng = np.random.default_rng(3)
    gridded, xyz = points(rng)
    intensity = rng.normal(mean, 25, xyz.shape[1]).clip(0, 255).astype(np.uint8)
    found = np.isfinite(variation_of(intensity, gridded)[1:-1, 1:-1])
    assert found.all() if is_known else not found.any()


def test_echoes_above_the_surface_and_bad_intensities_do_not_count():
    rng = np.random.default_rng(3)
    gridded, xyz = points(rng)
    high = rng.random(xyz.shape[1]) < 0.3
    whole = np.where(high, 3.0, xyz[2])
    half = gridded.cells[0].size
    raised = GriddedPoints.of(
        [np.stack((*xyz[:2, :half], whole[:half])), np.stack((*xyz[:2, half:], whole[half:]))], 1.0
    )
    ground = rng.normal(800, 80, len(high))
    found = variation_of(np.where(high, 9e4, ground), raised)
    assert np.nanmax(found) < 0.2
    assert cell_variation(gridded, np.zeros((1, 256, 256)), {}.get) is None
    assert not np.isfinite(variation_of(np.zeros(len(high)), gridded)).any()


def masks():
    """Return land, water and a variation: land up to row 20, ground up to 26, an island of ground, and mirrors."""
    gridded, _ = points(np.random.default_rng(1), count=1)
    land, water, variation = (np.zeros((1, 256, 256), kind) for kind in (np.bool_, np.bool_, np.float64))
    land[0, :20, : SIDES[1]] = True
    water[0, 16 : SIDES[0], : SIDES[1]] = True
    variation[:] = np.nan
    variation[0, : SIDES[0], : SIDES[1]] = 0.9
    variation[0, :26, : SIDES[1]] = 0.2
    variation[0, 40:44, 10:14] = 0.2
    return gridded.grid, land, water, variation


def test_land_goes_on_as_ground():
    """Ground that is not connected to land is left out: a raft reflects in all directions, too."""
    grid, land, water, variation = masks()
    found = with_ground(grid, land, water, variation)
    assert found[0, :26, : SIDES[1]].all()
    assert not found[0, 26:].any()


@pytest.mark.parametrize("of_water", [0.4, np.nan])
def test_land_does_not_go_on_beside_water_that_varies_as_little_or_is_unknown(of_water):
    grid, land, water, variation = masks()
    variation[variation == 0.9] = of_water
    assert (with_ground(grid, land, water, variation) == land).all()


def test_water_of_which_a_part_reflects_like_ground_is_no_land():
    """It is one surface, so intensities tell nothing."""
    rng = np.random.default_rng(7)
    x, y = rng.uniform(0, 300, 400_000), rng.uniform(0, 200, 400_000)
    land = x < 80
    mirror = x > 170
    intensity = np.where(mirror, rng.exponential(60, len(x)), rng.normal(60, 8, len(x))).clip(1)
    z = np.where(land, 4.0 + 0.5 * np.sin(x / 3) * np.sin(y / 4), rng.normal(0, 0.02, len(x)))
    columns = {"intensity": intensity, "number_of_returns": np.ones(len(x), int)}
    on_land, on_water = shares(np.stack((x, y, z)), land, columns)
    assert on_land > 0.99
    assert on_water < 0.02


@pytest.mark.parametrize("speckle", [True, False])
def test_the_foot_of_a_beach_is_land_below_the_crests(speckle):
    """Its intensities distinguish it from water, unless both vary alike."""
    rng = np.random.default_rng(7)
    x, y = rng.uniform(0, 300, 600_000), rng.uniform(0, 200, 600_000)
    sea, sand = waves(rng, x, y, 0.6, 30.0), 0.03 * (150 - x) + rng.normal(0, 0.02, len(x))
    land = sand > sea
    water = rng.exponential(60, len(x)) if speckle else rng.normal(60, 6, len(x))
    intensity = np.where(land, rng.normal(1, 0.1, len(x)) * np.where(sand < 0.4, 70, 180), water).clip(1)
    columns = {"intensity": intensity, "number_of_returns": np.ones(len(x), int)}
    xyz = np.stack((x, y, np.maximum(sea, sand)))
    on_foot, _ = shares(xyz, land & (sand < 0.3), columns)
    assert (on_foot > 0.8) == speckle
    assert shares(xyz, land, columns)[1] < 0.03


def test_trusted_water_is_no_land_though_it_reflects_like_ground():
    """A strip beside land; most of its points have class 9, and the others follow them."""
    rng = np.random.default_rng(7)
    x, y = rng.uniform(0, 300, 400_000), rng.uniform(0, 200, 400_000)
    land, strip = x < 80, (x >= 80) & (x < 88) & (y < 120)
    intensity = np.where(strip, rng.normal(60, 6, len(x)), rng.exponential(60, len(x))).clip(1)
    intensity[land] = rng.normal(200, 20, np.count_nonzero(land))
    z = np.where(land, 4.0 + 0.5 * np.sin(x / 3) * np.sin(y / 4), rng.normal(0, 0.02, len(x)))
    own = strip & (rng.random(len(x)) < 0.3)
    classes = np.where(land | own, 0, 9).astype(np.uint8)
    columns = {"intensity": intensity, "number_of_returns": np.ones(len(x), int), "classification": classes}
    _, on_strip = shares(np.stack((x, y, z)), ~own, columns, trust_classes=(9,))
    assert on_strip < 0.02
