"""The packet topic of every supported driver: short recordings of it, and captures of the same packets."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from seaclutter_cli.sensors.packets import Packets
from seaclutter_cli.sensors.robosense.models import MODELS
from seaclutter_cli.sensors.robosense.packets import write_data, write_info
from tests.sensors.hesai import test_decoder as hesai
from tests.sensors.hesai.mirrors import correction_file
from tests.sensors.hesai.mirrors import make_packets as make_at128_packets
from tests.sensors.ouster import test_decoder as ouster
from tests.sensors.robosense.test_decoder import angles_of, columns_of
from tests.sensors.velodyne.test_decoder import make_packets as velodyne_packets
from tests.sources.pcap import captures
from tests.sources.shared.packet_bags import DEFINITIONS, Types, array, write
from tests.sources.shared.test_other_packet_topics import (
    ANGLES,
    HESAI,
    HESAI_PACKET,
    HESAI_VERSIONS,
    OUSTER_1,
    OUSTER_2,
    hesai_messages,
    nebula_messages,
    ouster_messages,
    pairs,
)
from tests.sources.shared.test_other_packet_topics import DEFINITIONS as OTHERS
from tests.sources.shared.test_robosense_topics import old_messages, sdk_messages

VELODYNE_PACKET, VELODYNE = "velodyne_msgs/msg/VelodynePacket", "velodyne_msgs/msg/VelodyneScan"
PANDAR_PACKET, PANDAR = "pandar_msgs/msg/PandarPacket", "pandar_msgs/msg/PandarScan"
LIDAR_PACKET, LIDAR = "hesai_lidar/msg/PandarPacket", "hesai_lidar/msg/PandarScan"
HEADER = "std_msgs/Header header\n"
STAMPED = "builtin_interfaces/Time stamp\n"
ALL = {
    **DEFINITIONS,
    **OTHERS,
    HESAI_PACKET: HESAI_VERSIONS["times"][1],
    HESAI: HESAI_VERSIONS["times"][0] + "hesai_ros_driver/UdpPacket[] packets",
    VELODYNE_PACKET: STAMPED + "uint8[1206] data",
    VELODYNE: HEADER + "velodyne_msgs/VelodynePacket[] packets",
    PANDAR_PACKET: STAMPED + "uint8[1500] data\nuint32 size",
    PANDAR: HEADER + "pandar_msgs/PandarPacket[] packets",
    LIDAR_PACKET: STAMPED + "uint8[] data\nuint32 size",
    LIDAR: HEADER + "hesai_lidar/PandarPacket[] packets",
}


def robosense_packets(number=75, step=100):
    return [(time_ns, payload) for time_ns, payload, _ in captures.sensor_packets(number, step=step)]


def velodyne_messages(types, packets, per_scan=20):
    for first in range(0, len(packets), per_scan):
        part = packets[first : first + per_scan]
        made = [types.make(VELODYNE_PACKET, types.time(time_ns), array(payload)) for time_ns, payload in part]
        yield "/velodyne_packets", part[-1][0], types.make(VELODYNE, types.header(part[0][0], "velodyne"), made)


def pandar_messages(types, packets, per_scan=200, kinds=(PANDAR_PACKET, PANDAR), reserved=1500):
    packet, scan = kinds
    for first in range(0, len(packets), per_scan):
        part = packets[first : first + per_scan]
        made = [
            types.make(packet, types.time(time_ns), array(payload.ljust(reserved, b"\0")), len(payload))
            for time_ns, payload in part
        ]
        yield "/pandar_packets", part[-1][0], types.make(scan, types.header(part[0][0], "pandar"), made)


@dataclass(frozen=True)
class Driver:
    """A driver: packets of a sensor as (time, payload), and the messages in which it publishes them."""

    packets: Callable
    messages: Callable
    port: int
    files: Callable = lambda folder: {}
    """Writes files with calibrations, and returns decoder options of the capture."""
    options: Mapping = field(default_factory=dict)
    """Decoder options of capture and topic."""


def _ouster_metadata(folder):
    return {"calibration": ouster_metadata(folder)}


def ouster_metadata(folder, profile="RNG19_RFL8_SIG16_NIR16"):
    from tests.fuzz.seeds import write_ouster_metadata

    return write_ouster_metadata(folder, profile)


def _ouster(kind, spare=b""):
    def messages(types, packets, folder):
        yield from ouster_messages(types, packets, ouster_metadata(folder), kind=kind, spare=spare)

    return Driver(lambda: pairs(ouster.make_packets("RNG19_RFL8_SIG16_NIR16")), messages, 7502, _ouster_metadata)


def _angles(folder):
    path = folder / "angles.csv"
    path.write_text(ANGLES)
    return {"calibration": path}


def _corrections(folder):
    path = folder / "angles.dat"
    path.write_bytes(correction_file())
    return {"calibration": path}


def _xt32():
    return pairs(hesai.make_packets(hesai.XT32)[0])


def _plain(make):
    return lambda types, packets, _: make(types, packets)


def ruby_48_packets():
    """Return packets whose device information, in their middle, is shorter than data."""
    model = MODELS["RS-Ruby-48"]
    azimuth = np.arange(1200) * 40 % 36000
    columns = columns_of(model, azimuth)
    packets = pairs(Packets(columns.times_ns, write_data(model, columns)))
    half = len(packets) // 2
    return [*packets[:half], (packets[half][0], write_info(model, angles_of(model)).tobytes()), *packets[half:]]


DRIVERS = {
    "rslidar_sdk, RS-Ruby-48": Driver(
        ruby_48_packets, _plain(sdk_messages), 6699, lambda _: {}, {"model": "RS-Ruby-48"}
    ),
    "rslidar_sdk": Driver(robosense_packets, _plain(sdk_messages), 6699),
    "rslidar": Driver(robosense_packets, _plain(old_messages), 6699),
    "ouster_ros": _ouster(OUSTER_1, b"\0"),
    "ouster_sensor_msgs": _ouster(OUSTER_2),
    "nebula": Driver(_xt32, _plain(nebula_messages), 2368),
    "hesai_ros_driver": Driver(
        _xt32, lambda types, packets, _: hesai_messages(types, packets, "times", angles=ANGLES.encode()), 2368, _angles
    ),
    "hesai_ros_driver, AT128": Driver(
        lambda: pairs(make_at128_packets(1300)),
        lambda types, packets, _: hesai_messages(types, packets, "times", angles=correction_file()),
        2368,
        _corrections,
    ),
    "pandar": Driver(_xt32, _plain(pandar_messages), 2368),
    "hesai_lidar": Driver(_xt32, _plain(partial(pandar_messages, kinds=(LIDAR_PACKET, LIDAR), reserved=0)), 2368),
    "velodyne": Driver(lambda: pairs(velodyne_packets(60, first=35000, step=300)), _plain(velodyne_messages), 2368),
}
"""Drivers by name. Add new ones here."""


def write_topic(driver, container, folder, packets=None):
    """Write a recording with the packet topic of a driver, and return its path."""
    types = Types(container, ALL)
    packets = driver.packets() if packets is None else packets
    return write(folder, container, types, driver.messages(types, packets, folder))


def write_capture(driver, path, packets=None):
    """Write a capture of the same packets with times to the nanosecond, and return its path."""
    packets = driver.packets() if packets is None else packets
    rows = [(time_ns, payload, driver.port) for time_ns, payload in packets]
    path.write_bytes(captures.pcap(captures.frames(rows), nano=True))
    return path
