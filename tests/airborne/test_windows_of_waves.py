"""Windows at the edge of a tile show less than half of a wave, and coasts divide others."""

import numpy as np
import pytest

from seaclutter_cli.airborne.separation import separate
from seaclutter_cli.airborne.surface import OTHER, SeparationParams

SIDE, COUNT = 300.0, 300_000


def lost(z, xy, intensity):
    """Return the share of the points of a sea that are not."""
    columns = {"intensity": intensity}
    return (separate([np.stack((*xy, z))], SeparationParams(), columns.get).classification == OTHER).mean()


@pytest.mark.parametrize(("angle", "phase", "offset"), [(1.45, 3, 0), (0.1, 1, -12), (1.45, 1, -12)])
def test_crests_above_the_opened_surface_do_not_divide_a_sea(angle, phase, offset):
    """The opening with a window of 20 m does not follow a sine of 40 m, whose parts at the edge slope like a beach."""
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0, SIDE, (2, COUNT))
    z = 0.5 * np.cos(2 * np.pi / 40 * (np.cos(angle) * x + np.sin(angle) * y) + phase) + rng.normal(0, 0.03, COUNT)
    assert lost(z, (x, y + offset), np.zeros(COUNT)) < 0.002


@pytest.mark.parametrize(
    ("length", "height", "width", "speckle"), [(60, 1.0, 17, False), (80, 1.5, 20, True), (80, 1.5, 24, False)]
)
def test_less_than_half_a_wave_in_a_narrow_quarter_is_no_basin(length, height, width, speckle):
    """Blocks begin at multiples of 256 m, and cut narrow strips off the tile."""
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0, SIDE, (2, COUNT))
    phase = 2 * np.pi / length * (y - width / 2) + 0.1 * np.sin(x / 90)
    z = -height / 2 * np.cos(phase) + rng.normal(0, 0.03, COUNT)
    intensity = rng.gamma(2.0, 30, COUNT) if speckle else np.zeros(COUNT)
    assert lost(z, (x, y - width), intensity) < 0.002


@pytest.mark.parametrize(("height", "length"), [(1.5, 80.0), (1.0, 40.0)])
def test_waves_between_quarters_that_a_cliff_divides(height, length):
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0, SIDE, (2, COUNT))
    land = x < 150 + 10 * np.sin(y / 40)
    sea = height / 2 * np.cos(2 * np.pi / length * x + 0.3) + 0.1 * np.cos(2 * np.pi / 9 * (0.6 * x + 0.8 * y))
    z = np.where(land, 20 + np.sin(x / 30) * np.sin(y / 25), sea) + rng.normal(0, 0.03, COUNT)
    found = separate([np.stack((x + 152, y + 112, z))], SeparationParams()).classification
    assert (found[~land] == OTHER).mean() < 0.01
    assert (found[land] == OTHER).mean() > 0.99


def test_smooth_swell_at_many_moments_is_rough_only_where_they_are_mixed():
    """Four strips in each cell; the opened surface follows the swell of each."""
    rng, parts = np.random.default_rng(3), []
    for strip in range(4):
        x, y = rng.uniform(0, SIDE, (2, 60_000))
        phase = 2 * np.pi / 90 * (np.cos(0.5) * x + np.sin(0.5) * y) + 1.9 * strip
        parts.append((x, y, 0.45 * np.cos(phase) + rng.normal(0, 0.03, len(x)), np.full(len(x), strip)))
    x, y, z, strips = (np.concatenate(values) for values in zip(*parts, strict=True))
    found = separate([np.stack((x, y, z))], SeparationParams(), {"point_source_id": strips}.get)
    assert (found.classification == OTHER).mean() < 0.01
    assert found.sea.wave_height_m == pytest.approx(4 * 0.45 / np.sqrt(2), rel=0.3)
