"""The catalogue: recognition of sensors by clouds, names, and packets of known sensors without a decoder."""

import json

import numpy as np
import pytest

from seaclutter_cli.errors import InputError
from seaclutter_cli.records import SensorFacts
from seaclutter_cli.sensors.catalog import SENSORS, name_unsupported, recognise
from seaclutter_cli.sensors.families import PACKET_FAMILIES
from seaclutter_cli.sensors.hesai import models as hesai_models
from seaclutter_cli.sensors.robosense import models as robosense_models
from seaclutter_cli.sensors.velodyne import decoder as velodyne
from seaclutter_cli.sources.formats import open_source
from tests.running import execute
from tests.sources.pcap import captures
from tests.sources.shared.driver_topics import DRIVERS, write_topic

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


NAMES = [
    *robosense_models.MODELS,
    *(model.name for model in hesai_models.MODELS),
    *(model.name for model in velodyne.MODELS.values()),
    velodyne.VLP32B.name,
]


@pytest.mark.parametrize("name", NAMES)
def test_every_model_of_a_decoder_is_a_known_sensor(name):
    assert name in SENSORS


PACKETS = {
    "RoboSense RS-M1": bytes.fromhex("55aa5aa5").ljust(1210, b"\0"),
    "RoboSense RS-E1": bytes.fromhex("55aa5aa5").ljust(1200, b"\0"),
    "RoboSense RS-M2": bytes.fromhex("55aa5aa5").ljust(1342, b"\0"),
    "Hesai ATX (protocol 4.7)": b"\xee\xff\x04\x07".ljust(1127, b"\0"),
    "Hesai AT128 (protocol 4.1)": b"\xee\xff\x04\x01".ljust(1118, b"\0"),
    "Hesai JT128, or another with protocol 1.4 that is not a Pandar128 or OT128": b"\xee\xff\x01\x04".ljust(893, b"\0"),
}
START_NS = 1_760_000_000 * 10**9


def array(payload):
    return np.frombuffer(payload, np.uint8)


@pytest.mark.parametrize("name", PACKETS)
def test_names(name):
    assert name_unsupported(array(PACKETS[name])) == name


def test_packets_with_a_decoder_are_not_unsupported():
    for driver in DRIVERS.values():
        for _, payload in driver.packets()[:3]:
            assert name_unsupported(array(payload)) is None
            assert any(family.recognises(array(payload)) for family in PACKET_FAMILIES.values())


@pytest.mark.parametrize("name", PACKETS)
def test_captures(name, tmp_path):
    rows = [(START_NS + n * 10**6, PACKETS[name], 2368) for n in range(200)]
    path = tmp_path / "log.pcap"
    path.write_bytes(captures.pcap(captures.frames(rows)))
    with pytest.raises(InputError, match="not supported; record the sensor_msgs/PointCloud2") as error:
        open_source(path)
    assert name in str(error.value)


@pytest.mark.parametrize("name", PACKETS)
def test_topics(name, tmp_path):
    packets = [(START_NS + n * 10**6, PACKETS[name]) for n in range(300)]
    source = open_source(write_topic(DRIVERS["nebula"], "mcap", tmp_path, packets))
    assert any(f"packets of a {name} are not supported; record the" in text for text in source.warnings)
    source.close()


def test_info_names_it_beside_a_supported_sensor(tmp_path):
    rows = captures.sensor_packets(75)
    rows += [(time_ns, PACKETS["Hesai ATX (protocol 4.7)"], 2368) for time_ns, _, _ in rows]
    path = tmp_path / "log.pcap"
    path.write_bytes(captures.pcap(captures.frames(sorted(rows, key=lambda row: row[0]))))
    result = execute("info", path, code=0)
    assert "(Hesai ATX (protocol 4.7): not supported; record the" in result.output
    assert json.loads(execute("info", path, "--json").stdout)
