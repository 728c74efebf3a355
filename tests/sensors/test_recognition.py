"""Recognition of sensors from fields and rings: lists against the catalogue."""

import pytest

from seaclutter_cli.records import SensorFacts
from seaclutter_cli.sensors.catalog import SENSORS
from seaclutter_cli.sensors.recognition import recognise

XYZI = ("x", "y", "z", "intensity")
VELODYNE, ROBOSENSE = (*XYZI, "ring", "time"), (*XYZI, "ring", "timestamp")
OUSTER = (*XYZI, "t", "reflectivity", "ring", "range")


@pytest.mark.parametrize(
    ("fields", "rings", "points", "models"),
    [
        (VELODYNE, 16, 28_000, {"VLP-16", "Puck Hi-Res"}),
        (VELODYNE, 32, 50_000, {"VLP-32A", "VLP-32B", "VLP-32C", "HDL-32E"}),
        (OUSTER, 128, 100_000, {"OS0-128", "OS1-128", "OS2-128"}),
        (
            ROBOSENSE,
            22,
            2_630,
            {"RS-LiDAR-32", "RS-Helios", "RS-Bpearl", "PandarXT-32", "PandarXT-32M2X"},
        ),  # beams above the horizon see nothing
        (ROBOSENSE, 40, 60_000, {"Pandar40P"}),
        (VELODYNE, 16, 500_000, {"Alpha Prime"}),  # more points than 16 beams can return
        (VELODYNE, 200, 1_000, set()),
        (XYZI, None, 28_000, set()),
    ],
)
def test_sensors_that_clouds_resemble(fields, rings, points, models):
    found = recognise(fields, rings, points)
    assert set(found.models) == models
    assert not found.is_stated
    assert set(found.models) <= found.possible
    assert str(found) == ("resembles " + " or ".join(found.models) if models else "not recognised")


def test_facts_are_stronger_than_the_layout():
    found = recognise(ROBOSENSE, 32, 27_000, SensorFacts("OS1-32", {"intensity": "signal, photons"}))
    assert (found.models, found.is_stated, found.described) == (("OS1-32",), True, "OS1-32 (signal, photons)")


@pytest.mark.parametrize(
    ("fields", "rings", "model", "is_other"),
    [
        (VELODYNE, 32, "RS-LiDAR-32", True),
        (VELODYNE, 32, "VLP-32C", False),
        (VELODYNE, 10, "VLP-32C", False),  # calm water: most beams see nothing
        (ROBOSENSE, 40, "RS-LiDAR-32", True),
        (XYZI, None, "RS-LiDAR-32", False),
        (VELODYNE, 32, None, False),
        (VELODYNE, 32, "a lidar of our own", True),
    ],
)
def test_a_sensor_is_another_one_only_if_that_is_certain(fields, rings, model, is_other):
    assert recognise(fields, rings, 20_000).is_other_than(model) == is_other


def stated(model, mode=None):
    return recognise((), None, 1, SensorFacts(model, {"intensity": mode} if mode else {}))


@pytest.mark.parametrize(
    ("one", "other", "differ"),
    [
        (stated("VLP-16"), stated("VLP-16"), False),
        (stated("VLP-16"), stated("VLP-32C"), True),
        (stated("OS1-32", "signal"), stated("OS1-32", "reflectivity"), True),
        (stated("OS1-32", "signal"), stated("OS1-32"), False),
        (stated("VLP-32C"), recognise(VELODYNE, 32, 20_000), False),
        (stated("RS-LiDAR-32"), recognise(VELODYNE, 32, 20_000), True),
        (stated("RS-LiDAR-32"), recognise(XYZI, None, 20_000), False),
        (recognise(VELODYNE, 32, 20_000), recognise(VELODYNE, 14, 20_000), False),
        (recognise(VELODYNE, 32, 20_000), recognise(OUSTER, 32, 20_000), True),
    ],
)
def test_two_topics_differ_only_if_that_is_certain(one, other, differ):
    assert one.differs_from(other) == other.differs_from(one) == differ


@pytest.mark.parametrize(("model", "top"), [("RS-LiDAR-32", 255), ("OS1-32", None)])
def test_limits_of_intensities(model, top):
    assert SENSORS[model].max_intensity == top
