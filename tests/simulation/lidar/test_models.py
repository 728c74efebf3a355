import numpy as np
import pytest

from seaclutter_cli.simulation.lidar import LIDARS


@pytest.mark.parametrize("lidar", LIDARS.values(), ids=LIDARS)
class TestEveryLidar:
    def test_has_values_for_each_beam(self, lidar):
        assert len(lidar.elevations_deg) == len(lidar.azimuth_offsets_deg) == len(lidar.firing_us)
        assert sorted(lidar.rings) == list(range(len(lidar.elevations_deg)))

    def test_fires_within_a_column_or_all_at_once(self, lidar):
        if lidar.rotates:
            assert (np.diff(lidar.times_s[:, 0]) > 0).all()
            assert lidar.times_s[0].max() < 1 / (lidar.columns * lidar.rate_hz)
        else:
            assert not lidar.times_s.any()

    def test_points_in_a_direction_when_its_column_is_fired(self, lidar):
        number = lidar.columns // 3
        columns, level = lidar.directions[:, 0], np.radians(lidar.azimuth_offsets_deg[0])
        azimuths = np.arctan2(columns[:, 1], columns[:, 0]) + level
        assert lidar.firing_times_s(azimuths[[number]])[0] == pytest.approx(lidar.times_s[number, 0])

    def test_directions_match_the_elevations(self, lidar):
        directions = lidar.directions
        assert directions.shape == (lidar.columns, len(lidar.elevations_deg), 3)
        np.testing.assert_allclose(np.linalg.norm(directions, axis=2), 1)
        np.testing.assert_allclose(np.degrees(np.arcsin(directions[7, :, 2])), lidar.elevations_deg)

    def test_rings_count_from_the_lowest_beam(self, lidar):
        lowest = int(np.argmin(lidar.elevations_deg))
        assert lidar.rings[lowest] == 0

    def test_a_reflectivity_of_a_tenth_has_intensity_one_at_the_detection_range(self, lidar):
        assert lidar.gain * 0.1 / lidar.detection_m**2 == pytest.approx(1)


def test_rs_lidar_32_matches_its_manual():
    lidar = LIDARS["RS-LiDAR-32"]
    assert lidar.columns == 1800
    elevations = sorted(lidar.elevations_deg)
    assert len(set(elevations)) == 32
    assert (elevations[0], elevations[-1]) == (-25, 15)
    assert lidar.elevations_deg[0] == -10.281  # B.13
    assert lidar.azimuth_offsets_deg[9] == -2.672  # B.14, channel 10
    steps = np.diff(elevations)
    assert steps.min() == pytest.approx(0.333, abs=0.01)
    assert steps.max() > 10
    assert (lidar.firing_us[14], lidar.firing_us[15], lidar.firing_us[31]) == (pytest.approx(40.32), 44.64, 46.08)


def test_rs_lidar_32_rotates_clockwise_by_a_fifth_of_a_degree():
    lidar = LIDARS["RS-LiDAR-32"]
    level = lidar.elevations_deg.index(0.0)
    azimuth = np.degrees(np.arctan2(lidar.directions[:, level, 1], lidar.directions[:, level, 0]))
    np.testing.assert_allclose(np.diff(np.unwrap(azimuth, period=360)), -0.2, atol=1e-9)


def test_ce30_d_matches_its_datasheet():
    lidar = LIDARS["CE30-D"]
    x, y, z = lidar.directions.reshape(-1, 3).T
    azimuth, elevation = np.degrees(np.arctan2(y, x)).reshape(320, 20), np.degrees(np.arcsin(z)).reshape(320, 20)
    np.testing.assert_allclose(azimuth[:, 0], np.arange(320) * -60 / 320 + 30 - 30 / 320, atol=1e-9)
    np.testing.assert_allclose(elevation[5], np.arange(1.9, -2, -0.2), atol=1e-9)  # table 2
    np.testing.assert_allclose(azimuth, azimuth[:, :1] * np.ones(20), atol=1e-9)
    assert (lidar.min_range_m, lidar.max_range_m, lidar.rate_hz) == (0.4, 28.0, 30.0)
    assert [name for name, one in LIDARS.items() if one.noise.false_return_share or one.noise.mixed_pixel_share] == [
        "CE30-D"
    ]
