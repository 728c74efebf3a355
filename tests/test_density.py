"""Point density, compared with counted beams and with the curves in [Bi]."""

import numpy as np
import pytest

from seaclutter_cli.simulation.lidar import LIDARS

formulas = pytest.importorskip("benchmarks.density", reason="benchmarks are not in the source distribution")
STEPS_DEG, points_in_rectangle, mean_spacing = formulas.STEPS_DEG, formulas.points_in_rectangle, formulas.mean_spacing
density, density_slope = formulas.density, formulas.density_slope

UNIT = (1.0, 1.0)


def count_beams(distance_m, size_m, steps_rad):
    """Return the mean number of beams that hit a rectangle, over even grids shifted by quarters of a step."""
    counts = []
    for shift in np.arange(4) / 4:
        azimuth = (np.arange(-2000, 2000) + shift) * steps_rad[0]
        azimuth = azimuth[np.abs(azimuth) < 1.5]
        y = distance_m * np.tan(azimuth)
        elevation = (np.arange(-2000, 2000) + shift) * steps_rad[1]
        z = np.tan(elevation[np.abs(elevation) < 1.5])[:, None] * np.hypot(distance_m, y)
        inside = (np.abs(y) <= size_m[0] / 2) & (np.abs(z) <= size_m[1] / 2)
        counts.append(np.count_nonzero(inside))
    return np.mean(counts)


@pytest.mark.parametrize("distance_m", [1.5, 4, 10])
@pytest.mark.parametrize("steps", [(0.002, 0.002), (0.0035, 0.006)])
@pytest.mark.parametrize("size_m", [(1.0, 1.0), (2.0, 0.5)])
def test_points_agree_with_counted_beams(distance_m, steps, size_m):
    """Away from its centre, a rectangle gets more beams than the angles suggest; at long range, this is negligible."""
    tolerance = 0.1 if distance_m < 2 else 0.03
    expected = count_beams(distance_m, size_m, steps)
    assert points_in_rectangle(distance_m, size_m, steps) == pytest.approx(expected, rel=tolerance)


def test_curves_agree_with_the_paper():
    steps = (np.radians(0.1), np.radians(0.2))
    range_m = np.linspace(0.01, 30, 500)
    spacing, slope = mean_spacing(range_m, UNIT, steps), density_slope(range_m, UNIT, steps)
    assert (np.diff(spacing) > 0).all()
    assert (np.diff(slope) < 0).all(), "the density falls at an increasing rate"
    np.testing.assert_allclose(slope[range_m > 1.5], -np.sqrt(np.prod(steps)), rtol=0.035), "constant beyond 1.5 m"
    assert density(1e-9, UNIT, steps) == pytest.approx(1, abs=1e-3)
    np.testing.assert_allclose(mean_spacing(range_m, UNIT, steps[::-1]), spacing, rtol=1e-12)
    assert points_in_rectangle(1 / np.sqrt(np.prod(steps)), UNIT, steps) == pytest.approx(1, rel=1e-3)


@pytest.mark.parametrize("size_m", [(1.0, 1.0), (3.0, 0.4)])
def test_the_slope_is_the_derivative_of_the_density(size_m):
    steps, step = (0.003, 0.005), 1e-5
    range_m = np.linspace(0.1, 20, 50)
    ahead, behind = (density(range_m + side, size_m, steps) for side in (step, -step))
    np.testing.assert_allclose(density_slope(range_m, size_m, steps), (ahead - behind) / (2 * step), rtol=1e-6)


@pytest.mark.parametrize("name", sorted(set(STEPS_DEG) & set(LIDARS)))
def test_steps_are_those_of_the_simulated_lidars(name):
    horizontal, vertical = STEPS_DEG[name]
    lidar = LIDARS[name]
    assert horizontal == pytest.approx(lidar.field_deg / lidar.columns, rel=0.01)
    assert vertical == pytest.approx(np.median(np.diff(sorted(lidar.elevations_deg))), rel=0.02)
