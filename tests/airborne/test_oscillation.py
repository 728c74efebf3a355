"""Oscillation of elevations in full and sparse grids."""

import numpy as np
import pytest

from seaclutter_cli.airborne.waves import oscillation, tilt

SIDE = 256


def sea(length):
    x, y = np.indices((SIDE, SIDE))
    rng = np.random.default_rng(3)
    total = np.zeros(x.shape)
    for _ in range(40):
        k, angle = 2 * np.pi / (length * rng.normal(1, 0.08)), rng.normal(0.6, 0.2)
        total += np.sin(k * (np.cos(angle) * x + np.sin(angle) * y) + rng.uniform(0, 7))
    return total


def water(share, seed=1):
    return np.random.default_rng(seed).random((SIDE, SIDE)) < share


@pytest.mark.parametrize("share", [0.05, 0.1, 0.4, 0.6, 1.0])
@pytest.mark.parametrize("length", [12.0, 40.0, 100.0, 170.0])
def test_length_of_waves(length, share):
    own = water(share)
    found, depth = oscillation(np.where(own, sea(length), np.inf), own)
    assert found == pytest.approx(length, rel=0.25)
    assert depth > 0.3


@pytest.mark.parametrize("share", [0.05, 0.1, 0.4, 1.0])
@pytest.mark.parametrize("seed", range(5))
def test_noise_does_not_oscillate(seed, share):
    own = water(share, seed)
    assert oscillation(np.random.default_rng(seed).normal(size=own.shape), own)[1] < 0.1


@pytest.mark.parametrize("share", [0.1, 1.0])
def test_a_slope_has_no_length(share):
    own = water(share)
    assert oscillation(0.01 * np.indices((SIDE, SIDE))[0], own) == (0.0, 0.0)


def test_tilt_is_the_deviation_of_a_plane():
    x, y = np.indices((SIDE, SIDE))
    assert tilt(np.where(water(0.3), 0.01 * x - 0.02 * y + sea(8.0), np.inf)) == pytest.approx(
        np.hypot(0.01, 0.02) * SIDE / np.sqrt(12), rel=0.02
    )
