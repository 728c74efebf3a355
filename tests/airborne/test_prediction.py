"""Water under objects, predicted from the water around them."""

import numpy as np
import pytest

from seaclutter_cli.airborne.prediction import predict_under
from seaclutter_cli.airborne.separation import OTHER, separate
from seaclutter_cli.airborne.surface import SeparationParams
from seaclutter_cli.grids.elevation import BLOCK, ElevationGrid


def waves(x, y, seed=3):
    """Return a swell and a wind sea that cross each other, with a deviation of about 0.35 m."""
    rng = np.random.default_rng(seed)
    total = np.zeros(x.shape)
    for length, height, heading in [(90, 0.3, 0.2)] * 3 + [(24, 0.25, 1.3)] * 6:
        k = 2 * np.pi / (length * rng.normal(1, 0.05))
        angle = heading + rng.normal(0, 0.1)
        total += height / 2 * np.sin(k * (np.cos(angle) * x + np.sin(angle) * y) + rng.uniform(0, 7))
    return total


def predicted(origin, size=(30, 12), noise=0.02):
    """Return true and predicted elevations and the variances under an object in a field of waves."""
    x, y = (axis.ravel() + 0.5 for axis in np.meshgrid(np.arange(200.0), np.arange(150.0), indexing="ij"))
    true = waves(x, y)
    z = true + np.random.default_rng(1).normal(0, noise, len(x))
    under = (np.abs(x - 90) < size[0] / 2) & (np.abs(y - 80) < size[1] / 2)
    grid = ElevationGrid(1.0)
    cells = grid.add(np.stack((x + origin[0], y + origin[1], z)))
    objects = np.zeros(grid.lowest.shape, np.bool_)
    objects.reshape(-1)[cells[under]] = True
    water = np.isfinite(grid.lowest) & ~objects
    lowest = np.where(objects, 5.0, grid.lowest)
    cell, elevation, variance = predict_under(grid, lowest, water, objects, 0.0)
    order = np.argsort(cells[under])
    np.testing.assert_array_equal(cell, cells[under][order])
    return true[under][order], elevation, variance


def test_waves_go_on_below_a_mat():
    true, elevation, variance = predicted((0, 0))
    assert np.std(elevation - true) < 0.35 * np.std(true)
    assert np.mean(variance) < 0.3 * np.var(true)
    assert np.mean((elevation - true) ** 2) < 3 * np.mean(variance)


@pytest.mark.parametrize("origin", [(-80, -70), (BLOCK - 90, BLOCK - 80), (1e6 + BLOCK - 100, 0)])
def test_the_division_into_blocks_hardly_matters(origin):
    here, there = (predicted(at)[1] for at in ((0, 0), origin))
    np.testing.assert_allclose(np.sort(here), np.sort(there), atol=0.1)


def test_far_from_any_water_nothing_is_known():
    true, elevation, variance = predicted((0, 0), size=(120, 110))
    middle = np.argsort(variance)[-len(true) // 4 :]
    assert np.abs(elevation[middle]).max() < np.abs(true).max()
    assert variance[middle].mean() > 0.6 * np.var(true)


def test_a_low_bright_mat_in_swell_and_wind_sea_is_found_in_a_sparse_strip():
    rng = np.random.default_rng(8)
    x, y = rng.uniform(0, 300, 110_000), rng.uniform(0, 250, 110_000)
    mat = (np.abs(x - 120) < 14) & (np.abs(y - 200) < 8)
    z = 1.2 * waves(x, y) + rng.normal(0, 0.02, len(x)) + np.where(mat, rng.normal(0.38, 0.1, len(x)), 0)
    intensity = np.where(mat, rng.normal(250, 40, len(x)), rng.gamma(2.0, 30, len(x))).clip(1)
    found = separate([np.stack((x, y, z))], SeparationParams(land="ignore"), {"intensity": intensity}.get)
    assert found.sea.surface == "followed"
    other = found.classification == OTHER
    assert other[mat].mean() > 0.9
    assert other[~mat].mean() < 0.003
