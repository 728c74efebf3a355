"""Mountings: the conventions of REP 103, rotations, and the attitude that a direction gives."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from seaclutter_cli.water import Faces, Mounting, WaterTracker

ATTITUDES = [(0, 0), (180, 0), (20, 0), (0, -25), (-160, 10), (90, 0), (30, 45), (0, 90)]


@pytest.mark.parametrize(("roll", "pitch"), ATTITUDES)
def test_roll_and_pitch_turn_about_fixed_axes(roll, pitch):
    points = np.random.default_rng(1).normal(size=(3, 20))
    expected = Rotation.from_euler("xyz", [roll, pitch, 0], degrees=True).apply(points.T).T
    np.testing.assert_allclose(Mounting(roll, pitch).levelled(points), expected, atol=1e-12)


@pytest.mark.parametrize(("roll", "pitch"), ATTITUDES)
def test_unlevelled_is_the_inverse(roll, pitch):
    points, mounting = np.random.default_rng(2).normal(size=(3, 20)), Mounting(roll, pitch)
    np.testing.assert_allclose(mounting.unlevelled(mounting.levelled(points)), points, atol=1e-12)


def test_a_level_mounting_copies_nothing():
    points = np.ones((3, 4))
    assert Mounting().levelled(points) is points
    assert Mounting().unlevelled(points) is points


def test_upside_down_is_exact():
    points = np.random.default_rng(3).normal(size=(3, 50))
    assert np.array_equal(Mounting(180).levelled(points), points * [[1], [-1], [-1]])


def test_a_point_is_turned_in_the_same_way_wherever_it_stands():
    points = np.random.default_rng(4).normal(size=(3, 1001))
    turned = Mounting(12, 7).levelled(points)
    assert np.array_equal(turned[:, ::-1], Mounting(12, 7).levelled(np.ascontiguousarray(points[:, ::-1])))


def test_points_that_are_not_finite_stay_so():
    points = np.array([[np.nan, np.inf, 1], [1, 1, 1], [1, 1, 1]])
    assert np.isfinite(Mounting(10, 5).levelled(points)).all(axis=0).tolist() == [False, False, True]


@pytest.mark.parametrize(("roll", "pitch"), [*ATTITUDES[:-1], (-179, -80)])
def test_the_upward_direction_gives_the_mounting(roll, pitch):
    found = Mounting.of_up(3 * Mounting(roll, pitch).up)
    assert (found.roll_deg, found.pitch_deg) == pytest.approx((roll, pitch), abs=1e-9)


def test_the_angle_between_mountings():
    assert Mounting(180).tilt_deg(Mounting()) == pytest.approx(180)
    assert Mounting(20).tilt_deg(Mounting(0, 30)) == pytest.approx(np.degrees(np.arccos(np.cos(np.pi / 9) * 0.75**0.5)))
    assert Mounting(5).tilt_deg(Mounting(5)) == 0


@pytest.mark.parametrize(("roll", "pitch"), [(4, 0), (0, -5), (3, 4)])
def test_its_signs_are_those_of_the_water_state(roll, pitch):
    """A lidar that is mounted at an attitude sees the water as one on a vessel that heels and trims by as much."""
    x, y = np.random.default_rng(5).uniform(-30, 30, (2, 2000))
    seen = Mounting(roll, pitch).unlevelled(np.stack([x, y, np.full_like(x, -2.5)]))
    state = WaterTracker().step(seen, Faces.of(seen), 0.0).state
    assert (state.roll_deg, state.pitch_deg) == pytest.approx((roll, pitch), abs=0.05)
