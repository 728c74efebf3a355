"""Confirmed objects seen by lidars that are mounted tilted or upside down."""

from dataclasses import replace

import numpy as np
import pytest

from seaclutter_cli.cloud import from_array
from seaclutter_cli.config import load_config
from seaclutter_cli.errors import ConfigError
from seaclutter_cli.filters import FILTERS
from seaclutter_cli.frame import Reason
from seaclutter_cli.water import Mounting
from tests.filters.seas import random_bodies, sea_log

TIMES = np.arange(15) / 10
LOG = sea_log(1, random_bodies(1), TIMES)


def run(log, **params):
    method = FILTERS["confirmed"](FILTERS["confirmed"].Params(**params))
    return [result for frame in log for result in method.process(frame)] + method.flush()


def seen_by(log, roll, pitch):
    """Return a log as a lidar in an attitude records it."""
    return [turned(frame, Mounting(roll, pitch)) for frame in log]


def turned(frame, mounting):
    points = frame.cloud.points.copy()
    for axis, values in zip("xyz", mounting.unlevelled(frame.coordinates), strict=True):
        points[axis] = values
    return replace(frame, cloud=from_array(points))


def test_a_lidar_upside_down_gives_the_same_reasons():
    log = seen_by(LOG, 180, 0)
    results = run(log, mounting_roll_deg=180)
    for result, frame, expected in zip(results, log, run(LOG), strict=True):
        assert result.frame is frame, "the result is about the recorded points"
        assert result.reason.tolist() == expected.reason.tolist()
        assert result.water == expected.water


@pytest.mark.parametrize(("roll", "pitch"), [(20, 0), (0, -25), (160, 15), (90, 0)])
def test_a_tilted_lidar_sees_the_same_water_and_objects(roll, pitch):
    results = run(seen_by(LOG, roll, pitch), mounting_roll_deg=roll, mounting_pitch_deg=pitch)
    for result, expected in zip(results, run(LOG), strict=True):
        # Rounding moves echoes across borders of cells, where bodies stand.
        assert result.water.level_m == pytest.approx(expected.water.level_m, abs=0.025)
        assert result.water.roll_deg == pytest.approx(expected.water.roll_deg, abs=0.1)
        assert result.water.pitch_deg == pytest.approx(expected.water.pitch_deg, abs=0.1)
    # Rounding moves points across cells, and other beams leave other gaps.
    same = np.concatenate([one.keep == other.keep for one, other in zip(results, run(LOG), strict=True)])
    assert same.mean() > (0.95 if abs(roll) == 90 else 0.97)  # on its side, beams are no rows of elevation


def test_without_the_option_a_lidar_upside_down_sees_no_water():
    assert all(result.water is None for result in run(seen_by(LOG, 180, 0)))


def test_the_state_is_the_attitude_of_the_vessel():
    """A vessel that heels by 5° does so by 5° for a lidar on its side, too."""
    mounting, heel = Mounting(90, 0), Mounting(5, 0)
    log = [turned(turned(frame, heel), mounting) for frame in sea_log(2, [], TIMES, amplitude_m=0.0)]
    for result in run(log, mounting_roll_deg=90):
        assert result.water.roll_deg == pytest.approx(5, abs=0.1)
        assert result.water.pitch_deg == pytest.approx(0, abs=0.1)


def test_boxes_of_own_structure_are_in_the_frame_of_the_lidar():
    log = seen_by(LOG, 180, 0)
    box = (10, 30, 10, 30, -10, 10)
    x, y, _ = log[0].coordinates
    inside = log[0].valid & (x >= 10) & (x <= 30) & (y >= 10) & (y <= 30)
    assert inside.any()
    (result, *_) = run(log, mounting_roll_deg=180, exclude_boxes=(box,))
    assert np.array_equal(result.reason == Reason.EXCLUDED, inside)


@pytest.mark.parametrize(
    ("override", "range_"),
    [("mounting_roll_deg=181", "-180 to 180"), ("mounting_pitch_deg=-91", "-90 to 90")],
)
def test_angles_out_of_range_are_refused(override, range_):
    with pytest.raises(ConfigError, match=f"must be a number from {range_}"):
        load_config(None, method="confirmed", overrides=[f"filter.{override}"])
