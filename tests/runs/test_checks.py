"""Warnings about thresholds that are for another sensor, or have no effect in a range ring."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

import seaclutter
from seaclutter_cli.cloud import from_array
from seaclutter_cli.config import load_config
from seaclutter_cli.frame import Frame
from seaclutter_cli.records import SensorFacts
from seaclutter_cli.runs.checks import Checks
from seaclutter_cli.validation import find_file
from tests.paths import ROOT

POINT = np.dtype([("x", "f4"), ("y", "f4"), ("z", "f4"), ("intensity", "f4")])
VELODYNE = np.dtype([("x", "f4"), ("y", "f4"), ("z", "f4"), ("intensity", "f4"), ("ring", "u2"), ("time", "f4")])


def frame(size=4000, *, scale=1.0, dtype=POINT, seed=0, quay=None):
    """Return clutter from 10 to 70 m that is weaker with range, and a bright quay from 40 m on."""
    rng = np.random.default_rng(seed)
    cloud = np.zeros(size, dtype)
    cloud["x"] = rng.uniform(10, 70, size)
    cloud["intensity"] = np.clip(np.floor(scale * (1 + rng.exponential(300 / cloud["x"]))), 0, 255 * scale)
    if quay is not None:
        cloud["intensity"][cloud["x"] > 40] = quay
    cloud["z"] = rng.normal(0, 0.01, size)
    if "ring" in dtype.names:
        cloud["ring"] = np.arange(size) % 32
    return Frame(from_array(cloud, stamp_ns=10**9))


def warnings(frames, facts=None, overrides=(), file=None):
    config = load_config(file, overrides=overrides)
    checks, method = Checks(config, facts or {}), config.make_filter()
    found = [text for one in frames for text in checks.add(method.step(one))]
    return found + checks.finish()


def test_points_at_one_height_are_named_for_methods_that_need_heights():
    flat = frame().cloud.points.copy()
    flat["z"] = -2
    flat = Frame(from_array(flat, stamp_ns=10**9))
    for method in ("confirmed", "sea_surface", "none"):
        config = load_config(method=method)
        checks = Checks(config, {})
        checks.add(config.make_filter().step(flat))
        found = [text for text in checks.finish() if "at one height" in text]
        assert len(found) == (method != "none")
        assert not [text for text in checks.finish() if "at one height" in text], "once"


def test_clutter_that_fits_gives_no_warning():
    assert warnings([frame(seed=seed) for seed in range(30)]) == []


@pytest.mark.parametrize("number", [1, 30])
@pytest.mark.parametrize("file", [None, "rs-lidar-32"])
def test_thresholds_of_another_sensor_give_one_warning(number, file):
    path = find_file(file, "", "file") if file else None
    facts = {"/points": SensorFacts("VLP-32C")}
    (text,) = warnings([frame(scale=300, seed=seed) for seed in range(number)], facts, file=path)
    assert text.startswith("the thresholds are for RS-LiDAR-32, but the log is from VLP-32C; find")
    assert "seaclutter calibrate" in text


def test_clouds_that_resemble_another_sensor():
    (text,) = warnings([frame(dtype=VELODYNE)])
    assert "are for RS-LiDAR-32, but the log resembles VLP-32A or" in text


def test_another_intensity_mode():
    facts = {"/points": SensorFacts("RS-LiDAR-32", {"intensity": "raw (mode 2)"})}
    (text,) = warnings([frame()], facts)
    assert "'calibrated by the sensor (mode 3)', but the log has 'raw (mode 2)'" in text


@pytest.mark.parametrize(
    "overrides",
    [("filter.initial_thresholds=[31, 16, 7, 4]",), ("filter.method=confirmed", "filter.use_intensity=false")],
)
def test_thresholds_of_unknown_origin_and_methods_without_any_are_not_compared(overrides):
    with seaclutter.open_log(ROOT / "samples" / "sea.mcap") as log:  # of a sea with water and a target
        assert warnings(islice(log.frames(), 30), {"/points": SensorFacts("VLP-32C")}, overrides) == []


def test_intensities_beyond_those_of_the_sensor():
    (text,) = warnings([frame(scale=25)])
    assert "RS-LiDAR-32, whose intensities end at 255, but those of the log reach 2833" in text


def test_a_range_ring_in_which_every_point_passes():
    (text,) = warnings([frame(quay=5)], overrides=("filter.initial_thresholds=[30, 16, 5, 5]",))
    assert text.startswith(
        "no point from 40 to 55 m (and 1 other range ring) is below the threshold: intensities are 5"
    )


def test_a_range_ring_in_which_no_point_can_pass():
    (text,) = warnings([frame(quay=5)], overrides=("filter.initial_thresholds=[30, 16, 11, 6]",))
    assert text.startswith("no point from 40 to 55 m can pass: intensities are 5 to 5, the threshold 11;")


def test_few_points_give_no_warning_about_a_range_ring():
    assert warnings([frame(size=1500, quay=5)], overrides=("filter.initial_thresholds=[30, 16, 5, 5]",)) == []


def test_the_shipped_configuration_is_the_default_and_names_its_sensor():
    shipped, default = load_config(ROOT / "configs" / "rs-lidar-32.yaml"), load_config()
    assert shipped.filter == default.filter
    assert shipped.sensor == default.threshold_sensor
    assert shipped.sensor.model == "RS-LiDAR-32"
    assert shipped.sensor.intensity == "calibrated by the sensor (mode 3)"


@pytest.mark.parametrize(("name", "remedy"), [("signal", "; use --intensity-field signal"), ("noise", "")])
def test_intensities_that_are_always_zero_are_said_with_the_field_that_works(name, remedy):
    points = np.zeros(400, [*POINT.descr, (name, "f4")])
    points["x"], points[name] = np.linspace(10, 70, 400), 40
    dark = Frame(from_array(points, stamp_ns=10**9))
    assert f"no point can pass: the intensities are always 0{remedy}" in warnings([dark])


def test_intensities_that_are_always_zero_let_bodies_on_water_pass():
    points = frame(scale=0).cloud.points.copy()
    points["y"], points["z"] = np.random.default_rng(0).uniform(-70, 70, len(points)), points["z"] - 2
    dark = Frame(from_array(points, stamp_ns=10**9))
    found = warnings([dark], overrides=("filter.method=confirmed",))
    assert "no point reaches its threshold: the intensities are always 0" in found


@pytest.mark.parametrize(("interval_s", "count", "warns"), [(0.01, 20, True), (0.01, 19, False), (0.04, 60, False)])
def test_more_frames_per_second_than_a_lidar_scans_may_be_parts_of_scans(interval_s, count, warns):
    frames = [replace(frame(seed=k), stamp_ns=round(1e9 * (1 + k * interval_s))) for k in range(count)]
    expected = ["100 frames per second are more than a lidar scans; if they are parts of scans, join them with "]
    assert [text.partition("--")[0] for text in warnings(frames)] == expected * warns
