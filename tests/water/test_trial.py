"""The plane of the water while none is seen: with own ship's attitude and without, beside the true one."""

import numpy as np
import pytest

from seaclutter_cli.frame import Attitude
from seaclutter_cli.water import Faces, WaterTracker

HEIGHT_M, ROLL_DEG, PERIOD_S, STEP_S = 3.0, 8.0, 6.0, 0.1
SOURCE = ("/imu/data", "imu", 0)


def attitude(time_s):
    """Return the rotation from the lidar to fixed axes, of a ship that rolls and turns."""
    roll, yaw = np.radians((ROLL_DEG * np.sin(2 * np.pi * time_s / PERIOD_S), 15 * time_s))
    about_x = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
    about_z = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    return about_z @ about_x


def sea(time_s, *, visible):
    """Return echoes, shape (3, N), of water if it is visible, and else of eleven decks, in the axes of the lidar."""
    rng, size = np.random.default_rng(round(1000 * time_s)), 300 if visible else 11
    distance, bearing = rng.uniform(6, 35, size), rng.uniform(0, 2 * np.pi, size)
    height = rng.normal(0, 0.03, size) if visible else np.full(size, 1.2)
    fixed = np.stack((distance * np.cos(bearing), distance * np.sin(bearing), height - HEIGHT_M))
    return attitude(time_s).T @ fixed


def states(told=lambda _: None, seconds=11.0, seen_s=7.0):
    """Return the states of the water frame by frame, and warnings; attitudes are told by a function of the time."""
    tracker, found = WaterTracker(), []
    for time_s in np.arange(0, seconds, STEP_S).tolist():
        xyz = sea(time_s, visible=time_s < seen_s)
        rotation = told(time_s)
        surface = tracker.step(xyz, Faces.of(xyz), time_s, None if rotation is None else Attitude(rotation, SOURCE))
        found.append(None if surface is None else surface.state)
    return found, tracker.trial.warnings


def errors(found):
    """Return the errors of roll in degrees and of the level in metres."""
    times_s = STEP_S * np.arange(len(found))
    true = ROLL_DEG * np.sin(2 * np.pi * times_s / PERIOD_S)
    level_m = -HEIGHT_M / np.cos(np.radians(true))
    return np.array([(one.roll_deg, one.level_m) for one in found]).T - (true, level_m)


def test_the_plane_turns_with_own_ship_while_no_water_is_seen():
    found, warnings = states(attitude)
    assert np.abs(errors(found)[0]).max() < 0.2
    assert np.abs(errors(found)[1]).max() < 0.05
    assert not warnings


@pytest.fixture(scope="module")
def alone():
    """Return the states of the water without attitudes."""
    return states()[0]


def test_without_attitudes_it_does_not(alone):
    assert np.abs(errors(alone)[0]).max() > ROLL_DEG


def test_the_level_is_less_certain_the_longer_no_water_is_seen():
    found, _ = states(attitude)
    deviation_m = np.array([one.level_deviation_m for one in found])
    wave_m = found[-1].significant_wave_height_m / 4
    assert np.diff(deviation_m[70:] ** 2) == pytest.approx(wave_m**2 * STEP_S)  # a random walk
    assert (np.abs(errors(found)[1]) < 2 * deviation_m).mean() > 0.95


@pytest.mark.parametrize(
    "told",
    {
        "opposite": lambda time_s: attitude(time_s).T,
        "pitch for roll": lambda time_s: attitude(time_s) @ [[0, 1, 0], [-1, 0, 0], [0, 0, 1]],
        "late": lambda time_s: attitude(time_s - 1.5),
        "unset": lambda _: np.eye(3),
        "wild": lambda time_s: np.linalg.qr(np.random.default_rng(round(1000 * time_s)).normal(size=(3, 3)))[0],
    }.values(),
    ids=["opposite", "pitch for roll", "late", "unset", "wild"],
)
def test_attitudes_that_disagree_with_the_water_change_nothing(told, alone):
    assert states(told)[0] == alone


def test_attitudes_that_disagree_are_reported_once():
    _, (warning,) = states(lambda time_s: attitude(time_s).T)
    assert warning == "own ship's attitude on /imu/data is not used: it does not agree with the water"


def test_the_plane_holds_for_fifteen_seconds():
    found, _ = states(attitude, seconds=19.0, seen_s=3.0)
    assert [one is None for one in found].index(True) * STEP_S == pytest.approx(3 + 15, abs=2 * STEP_S)
