"""Packet topics of Ouster, Nebula and Hesai's newer driver: equal to the decoded packets, in every container."""

from contextlib import closing

import pytest

from seaclutter_cli.sources.formats import open_source
from tests import logs
from tests.pairs import covering
from tests.paths import shared
from tests.sensors.hesai import test_decoder as hesai
from tests.sensors.ouster import test_decoder as ouster
from tests.sensors.ouster.test_decoder import write_metadata  # noqa: F401 - a fixture
from tests.sources.shared.packet_bags import CONTAINERS, Types, array, captured, write
from tests.sources.shared.test_robosense_topics import clouds

OUSTER_1, OUSTER_2 = "ouster_ros/msg/PacketMsg", "ouster_sensor_msgs/msg/PacketMsg"
NEBULA_PACKET, NEBULA = "nebula_msgs/msg/NebulaPacket", "nebula_msgs/msg/NebulaPackets"
HESAI_PACKET, HESAI = "hesai_ros_driver/msg/UdpPacket", "hesai_ros_driver/msg/UdpFrame"
DEFINITIONS = {
    OUSTER_1: "uint8[] buf",
    OUSTER_2: "uint8[] buf",
    NEBULA_PACKET: "builtin_interfaces/Time stamp\nuint8[] data",
    NEBULA: "std_msgs/Header header\nnebula_msgs/NebulaPacket[] packets",
}
SIZED = "uint8[] data\nuint32 size"
HESAI_VERSIONS = {
    "times": ("std_msgs/Header header\n", "builtin_interfaces/Time stamp\n" + SIZED),
    "header": ("std_msgs/Header header\n", SIZED),
    "plain": ("", SIZED),
}
ANGLES = "Laser id,Elevation,Azimuth\n" + "".join(f"{n},{16 - n - n / 100},{n % 3 / 10}\n" for n in range(1, 33))


def pairs(packets):
    return list(zip(packets.times_ns.tolist(), map(bytes, packets.payloads), strict=True))


def contents(frames):
    return [(frame.stamp_ns, frame.points.tobytes()) for frame in frames]


def ouster_messages(types, packets, metadata, *, kind=OUSTER_2, spare=b""):
    """Return messages of Ouster's driver; those of its older versions have a spare byte at the end of packets."""
    yield "/ouster/metadata", packets[0][0], types.make("std_msgs/msg/String", metadata.read_text())
    for time_ns, payload in packets:
        yield "/ouster/imu_packets", time_ns, types.make(kind, array(bytes(48) + spare))
        yield "/ouster/lidar_packets", time_ns, types.make(kind, array(payload + spare))


def test_ouster_packets_without_metadata(write_metadata, tmp_path):  # noqa: F811
    metadata, packets = write_metadata(), ouster.make_packets()
    types = Types("mcap", DEFINITIONS)
    messages = list(ouster_messages(types, pairs(packets), metadata))[1:]
    path = write(tmp_path, "mcap", types, messages)
    found, (warning,), *_ = clouds(path)
    assert not found
    assert "pass --calibration METADATA.json" in warning
    found, *_ = clouds(path, calibration=metadata)
    assert found["/ouster/points"] == contents(ouster.decode(packets, metadata)[0])


def test_real_ouster_packets_equal_their_capture(tmp_path):
    name = "OS-1-32-G_v2.1.1_1024x10"
    folder = shared("ouster")
    types = Types("mcap", DEFINITIONS)
    packets = captured(folder / f"{name}.pcap")
    messages = ouster_messages(types, packets, folder / f"{name}.json")
    found, *_ = clouds(write(tmp_path, "mcap", types, messages))
    assert found["/ouster/points"] == clouds(folder / f"{name}.pcap")[0]["/points"]


def nebula_messages(types, packets, per_scan=100):
    for first in range(0, len(packets), per_scan):
        part = packets[first : first + per_scan]
        made = [types.make(NEBULA_PACKET, types.time(time_ns), array(payload)) for time_ns, payload in part]
        yield "/nebula_packets", part[-1][0], types.make(NEBULA, types.header(part[0][0], "lidar_top"), made)


def test_real_packets_as_nebula_packets_equal_the_scans(tmp_path):
    packets = pairs(hesai.all_scans())
    types = Types("db3", DEFINITIONS)
    found, *_ = clouds(write(tmp_path, "db3", types, nebula_messages(types, packets)))
    scans, *_ = clouds(next(shared("nebula/xt32").glob("*.db3")))
    assert found["/nebula_points"] == scans["/pandar_points"]


def test_nebula_packets_of_another_sensor(tmp_path):
    types = Types("mcap", DEFINITIONS)
    path = write(tmp_path, "mcap", types, nebula_messages(types, [(10**18 + n, bytes(600)) for n in range(300)]))
    found, (warning,), *_ = clouds(path)
    assert not found
    assert "packets of 600 bytes are not from a supported sensor" in warning


def hesai_messages(types, packets, version, *, angles=None):
    """Return messages of Hesai's driver, with the angle correction file in a topic of its own."""
    if angles is not None:
        layout = types.make("std_msgs/msg/MultiArrayLayout", [], 0)
        message = types.make("std_msgs/msg/UInt8MultiArray", layout, array(angles))
        yield "/lidar_corrections", packets[0][0], message
    for first in range(0, len(packets), 200):
        part = packets[first : first + 200]
        values = [(types.time(time_ns),) * (version == "times") for time_ns, _ in part]
        made = [
            types.make(HESAI_PACKET, *time, array(payload), len(payload))
            for time, (_, payload) in zip(values, part, strict=True)
        ]
        header = () if version == "plain" else (types.header(part[0][0], "hesai_lidar"),)
        yield "/lidar_packets", part[-1][0], types.make(HESAI, *header, made)


@pytest.mark.parametrize(("version", "container"), covering(HESAI_VERSIONS, CONTAINERS))
@pytest.mark.parametrize("angles", [None, ANGLES])
def test_hesai_frames_with_and_without_angles(container, version, angles, tmp_path):
    header, packet = HESAI_VERSIONS[version]
    types = Types(container, {HESAI_PACKET: packet, HESAI: header + "hesai_ros_driver/UdpPacket[] packets"})
    packets, _ = hesai.make_packets(hesai.XT32)
    options = hesai.NOMINAL
    if angles:
        (tmp_path / "angles.csv").write_text(angles)
        options = hesai.DecoderOptions(tmp_path / "angles.csv")
    frames, _ = hesai.decode(packets, options=options)
    path = write(
        tmp_path, container, types, hesai_messages(types, pairs(packets), version, angles=angles and angles.encode())
    )
    found, warnings, damage, _ = clouds(path)
    assert found == {"/lidar_points": contents(frames)}
    assert [("nominal angles" in text) for text in warnings] == ([] if angles else [True])
    assert damage == []


def test_a_truncated_packet_is_reported(tmp_path):
    types = Types("mcap", DEFINITIONS)
    entries = list(nebula_messages(types, pairs(hesai.make_packets(hesai.XT32)[0])))
    whole = types.bytes
    sizes = iter([None, None, 5000, 30, *[None] * len(entries)])
    types.bytes = lambda message: whole(message)[: next(sizes)]
    source = open_source(write(tmp_path, "mcap", types, entries))
    assert len(list(source.records())) > len(entries)
    assert [damage.lost_messages for damage in source.damage] == [1, 1]
    assert "declares 1,080 bytes, but contains only 588 more" in str(source.damage[0])
    source.close()


UNDECODED = (
    "robosense_msgs/msg/RobosensePacket",
    "innovusion_msgs/msg/InnovusionPacket",
    "innovusion_msgs/msg/InnovusionScan",
    "innoviz_msgs/msg/InnovizScan",
    "livox_msgs/msg/LidarScan",
    "lslidar_msgs/msg/LslidarPacket",
    "lslidar_msgs/msg/LslidarScan",
    "seyond/msg/SeyondScan",
    "vanjee_lidar_msg/msg/VanjeelidarPacket",
    "hesai_lidar/msg/PandarPacket",
    "hesai_ros_driver/msg/UdpPacket",
    "nebula_msgs/msg/NebulaPacket",
    "pandar_msgs/msg/PandarJumboPacket",
    "pandar_msgs/msg/PandarPacket",
    "velodyne_msgs/msg/VelodynePacket",
    "sensor_msgs/msg/PointCloud",
    "foxglove_msgs/msg/LaserScan",
    "foxglove.LaserScan",
)


@pytest.mark.parametrize("encoding", ["cdr", "ros1", "protobuf"])
@pytest.mark.parametrize("kind", UNDECODED)
def test_known_messages_that_are_not_supported_are_named(tmp_path, kind, encoding):
    if ("/" in kind) == (encoding == "protobuf"):
        pytest.skip("messages of ROS are not protobuf, and others are")
    path, name = tmp_path / "log.mcap", kind.replace("/msg/", "/") if encoding == "ros1" else kind
    form = {"cdr": "ros2msg", "ros1": "ros1msg", "protobuf": "protobuf"}[encoding]
    topic = logs.Topic("/other", encoding, (name, form, b""))
    logs.write_log(path, [topic], [logs.Entry("/other", logs.START_NS, b"")])
    with closing(open_source(path)) as source:
        (warning,) = source.warnings
    assert warning.startswith(f"/other is not decoded: {name} is not supported; ")
    assert "sensor_msgs/PointCloud2" in warning
