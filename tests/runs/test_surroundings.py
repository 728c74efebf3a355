"""Own ship, what is beside it, and the smallest buoy that beams meet, as `info` and `filter` report them."""

import re

import numpy as np
import pytest
from click.testing import CliRunner

from seaclutter_cli.commands import cli
from seaclutter_cli.frame import Frame, WaterState
from seaclutter_cli.runs.surroundings import Ground, Surroundings, met_up_to_m, smallest
from seaclutter_cli.simulation.lidar import LIDARS
from tests.filters.seas import Body
from tests.paths import ROOT
from tests.structure.test_own_ship import MAST, sea

SNOW = ROOT / "samples" / "snow.mcap"
SAMPLE = ROOT / "samples" / "sea.mcap"
BESIDE = Body(9, 6.5, vx=-2, length=2, width=1, height=0.9, points=40)


def around(log, reach_m=10.0):
    found = Surroundings(reach_m)
    for frame in log:
        found.add(frame)
    return found


@pytest.mark.parametrize("lidar", ["OS1-64", "OS1-128", "PandarXT-32", "RS-LiDAR-16", "generic-64-905"])
@pytest.mark.parametrize("beams", [1, 2])
def test_evenly_spaced_beams(lidar, beams):
    """A body is met if it is as high as the beams are apart, from every height of the lidar and in between."""
    elevations = np.sort(LIDARS[lidar].elevations_deg)
    apart = np.radians(beams * np.diff(elevations).max())
    for lidar_m in (0.8, 1.2):
        found = met_up_to_m(elevations, 0.4, lidar_m, beams)
        assert found <= 0.4 / np.tan(apart) <= found + 2
        for range_m in range(8, found + 1):
            for shift in np.linspace(0, apart, 20):  # of the beams, against a body on the water
                rays = range_m * np.tan(np.radians(elevations) + shift - apart / 2) + lidar_m
                assert np.count_nonzero((rays >= 0) & (rays <= 0.4 * 1.02)) >= beams or range_m * 0.9 < lidar_m / 0.26


def test_beams_that_meet_no_buoy_are_not_said_to():
    assert met_up_to_m(np.array([-15.0, 15.0]), 0.4, 2.0, 1) == 0
    assert met_up_to_m(np.array([5.0, 6.0, 7.0]), 0.4, 2.0, 1) == 0, "they look at the sky"


def test_a_boat_beside_own_ship_gives_a_warning():
    found = around(sea([BESIDE], frames=20))
    assert re.search(r"moves in (1[5-9]|20) of 20 frames examined", found.warning())
    assert "own ship reaches 5." in found.warning()
    assert found.own_ship() == f"reaches {found.end_m:.1f} m; filter.start_m: 6 suffices, or auto"


def test_own_ship_and_water_alone_give_none():
    assert around(sea(frames=20)).warning() is None
    assert around(sea(mast=MAST[:0], frames=20)).own_ship().startswith("nothing constant from 3 to 10 m")
    few = around(sea(frames=19))
    assert (few.warning(), few.own_ship(), smallest(("OS1-64",), few.beams_deg, None)) == (None, None, None)


def test_info_shows_own_ship_and_the_smallest_buoy():
    text = CliRunner().invoke(cli, ["info", str(SAMPLE)]).stdout
    assert "  own ship   reaches 4.5 m; filter.start_m: 5 suffices, or auto\n" in text
    assert "  beams      a buoy of 0.4 m is met by one beam up to 68 m, by two up to 34 m\n" in text


def test_a_filter_run_shows_them_in_its_summary(tmp_path):
    line = ["filter", str(SAMPLE), "-n", "30", "-o", str(tmp_path / "x.mcap"), "-m"]
    text = CliRunner().invoke(cli, [*line, "confirmed"]).stdout
    assert "  own ship (filter.start_m)   " in text
    assert "\n  a buoy of 0.4 m is met by one beam up to 68 m, by two up to 34 m\n" in text
    text = CliRunner().invoke(cli, [*line, "joint", "--force"]).stdout
    assert "% of the removed points are nearer than 10 m (filter.start_m)" in text
    assert "a buoy" not in text


def flat(share, seed=0):
    """Return a frame of a level surface 2 m below a lidar of 32 beams, which returns a share of the shots."""
    random = np.random.default_rng(seed)
    azimuth, elevation = np.meshgrid(np.radians(np.arange(0, 360, 0.25)), np.radians(np.linspace(-25, -3, 32)))
    returned = random.random(azimuth.shape) < share
    azimuth, elevation = azimuth[returned], elevation[returned]
    distance = 2 / -np.tan(elevation) * random.normal(1, 0.005, azimuth.shape)
    unit = np.cos(azimuth), np.sin(azimuth), np.tan(elevation)
    return Frame.of_arrays(np.column_stack([distance * axis for axis in unit]))


@pytest.mark.parametrize(("share", "is_land"), [(0.95, True), (0.6, True), (0.35, False), (0.1, False)])
@pytest.mark.parametrize("wave_height_m", [0.1, 1.0])
def test_land_returns_most_shots_at_grazing_angles(share, is_land, wave_height_m):
    ground = Ground()
    for seed in range(3):
        ground.add(flat(share, seed), WaterState(-2.0, 0.0, 0.0, wave_height_m, 0.1))
    found = ground.warning()
    assert bool(found) == (is_land and wave_height_m < 0.5), "what is rough is not asked"
    if found:
        stated = float(re.search(r"2\.0 m below the lidar.* returns (.*) % of the shots", found)[1])
        assert stated == pytest.approx(100 * share, abs=5)


def test_info_and_filter_say_what_is_land(tmp_path):
    frames = tmp_path / "frames"
    frames.mkdir()
    for number in range(3):
        points = flat(0.95, number).coordinates.T
        np.save(frames / f"{number}.npy", np.column_stack((points, np.full(len(points), 40))))
    output = str(tmp_path / "a.mcap")
    for words in (["info", str(frames)], ["filter", str(frames), "-o", output, "-m", "confirmed"]):
        result = CliRunner().invoke(cli, words)
        assert "the surface 2.0 m below the lidar seems to be land: it returns 9" in result.output
    assert "the surface 2.1 m below the lidar seems to be land" in CliRunner().invoke(cli, ["info", str(SNOW)]).output
