"""The water from frame to frame, amid what is taken for it."""

import numpy as np
import pytest

from seaclutter_cli.water import Faces, WaterTracker


def around(rng, size, level_m, distance_m, bearings_deg=(-180, 180)):
    bearing, distance = np.radians(rng.uniform(*bearings_deg, size)), rng.uniform(*distance_m, size)
    return np.stack((distance * np.cos(bearing), distance * np.sin(bearing), np.broadcast_to(level_m, size)))


def water_of(frames):
    """Return the plane of the last frame."""
    tracker = WaterTracker()
    for number, xyz in enumerate(frames):
        surface = tracker.step(xyz, Faces.of(xyz), number / 10)
    return surface.plane


def test_water_that_appears_below_pontoons_is_found_at_once():
    rng = np.random.default_rng(1)
    heights = (-1.0,) * 10 + (-1.9,) * 3
    frames = (around(rng, 600, level_m, (5, 25)) + rng.normal(0, 0.02, (3, 600)) for level_m in heights)
    assert water_of(frames).level_m == pytest.approx(-1.9, abs=0.1)


def test_images_below_hulls_do_not_lower_the_water():
    """Hulls on three sides are mirrored as deep as they are high; ahead, little of the calm water is seen."""
    rng = np.random.default_rng(2)

    def frame():
        water = around(rng, 100, -1.3, (5, 16), (-60, 60))
        columns = [
            np.stack((*np.outer(place[:2], np.ones(30)), -1.3 + np.linspace(-deep, high, 30)))
            for place in around(rng, 120, 0.0, (10, 30), (100, 260)).T
            for deep, high in [(rng.uniform(0.4, 1.6), 2.0)]
        ]
        return np.hstack((water, *columns)) + rng.normal(0, 0.02, (3, 100 + 120 * 30))

    assert water_of(frame() for _ in range(10)).height(8.0, 0.0) == pytest.approx(-1.3, abs=0.05)


@pytest.mark.parametrize("top_m", [-4.5, -6.0])
def test_the_top_of_a_quay_is_no_water(top_m):
    """The lidar is 7 m above the water, of which it sees nothing, beside a quay."""
    rng = np.random.default_rng(3)
    place = around(rng, 300, 0.0, (12, 16), (0, 120))
    walls = [np.stack((*np.outer(one[:2], np.ones(25)), np.linspace(-7, top_m, 25))) for one in place.T]
    top = around(rng, 3000, top_m, (16, 40), (0, 120))
    xyz = np.hstack((*walls, top)) + rng.normal(0, 0.02, (3, 300 * 25 + 3000))
    surface = WaterTracker().step(xyz, Faces.of(xyz), 0.0)
    assert surface is None or surface.plane.level_m == pytest.approx(-7, abs=0.5)
