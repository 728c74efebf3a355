"""The water surface of a frame: what is below it."""

import numpy as np
import pytest

from seaclutter_cli.water import WaterSurface
from seaclutter_cli.water.plane import Plane
from seaclutter_cli.water.surface import BEYOND

SLOPE_DEVIATION = 0.01


def below(places, bodies):
    """Return which echoes at places, rows of x, y and height, are below the water, and which are images."""
    x, y, height = np.array(places, float).T
    covariance = np.diag((0.0, SLOPE_DEVIATION**2, SLOPE_DEVIATION**2))
    surface = WaterSurface(Plane(-2.0, 0.0, 0.0), 0.02, np.zeros((2, BEYOND + 1)), 0.0, covariance)
    _, deviation, _ = surface.above(x, y, height - 2.0)
    deep, mirrored = surface.below(x, y, height, deviation, np.array(bodies))
    return deep.tolist(), mirrored.tolist()


@pytest.mark.parametrize("range_m", [10.0, 40.0, 200.0])
def test_an_image_is_below_a_body(range_m):
    depth_m = -5 * np.hypot(0.05, SLOPE_DEVIATION * range_m)
    echo = (range_m, 0, depth_m)
    assert below([echo, (range_m + 1, 1, 2.0)], [False, True]) == ([True, False], [True, False])
    assert below([echo, (range_m - 30, 0, 2.0)], [False, True]) == ([False, False], [False, False])


def test_an_echo_far_below_the_water_needs_no_body():
    assert below([(40, 0, -9.5), (40, 0, -8.5)], [False, False]) == ([True, False], [False, False])


def test_echoes_below_the_water_are_no_bodies():
    assert below([(40, 0, -2.0), (40, 1, -2.0)], [False, True]) == ([False, False], [False, False])
