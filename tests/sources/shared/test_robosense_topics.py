"""RoboSense packet topics of every driver: equal to captures of the same packets, in every container."""

import numpy as np
import pytest

from seaclutter_cli.messages import find_codec
from seaclutter_cli.records import Message
from seaclutter_cli.sensors.packets import DecoderOptions
from seaclutter_cli.sources.formats import open_source
from tests.pairs import covering
from tests.paths import ROOT, shared
from tests.sources.shared.packet_bags import CONTAINERS, Types, array, captured, write

CAPTURE = ROOT / "samples" / "rs-lidar-32.pcap"
SDK, SCAN, OLD = "rslidar_msg/msg/RslidarPacket", "rslidar_msgs/msg/rslidarScan", "rslidar_msgs/msg/rslidarPacket"
INFO = b"\xa5\xff"


def clouds(path, **options):
    """Return stamps and points by topic, the sources' warnings and damage, and the log times of clouds."""
    source = open_source(path, decoding=DecoderOptions(**options))
    found, times = {}, []
    for record in source.records():
        if isinstance(record, Message) and (codec := find_codec(record.channel)):
            cloud = codec.decode(record.data)
            found.setdefault(record.channel.topic, []).append((cloud.stamp_ns, cloud.points.tobytes()))
            times.append((record.log_time_ns, cloud.stamp_ns, cloud.frame_id))
    source.close()
    return found, list(source.warnings), [str(damage) for damage in source.damage], times


@pytest.fixture(scope="module")
def packets():
    return captured(CAPTURE)


@pytest.fixture(scope="module")
def expected():
    (found, *_) = clouds(CAPTURE)
    return found["/points"]


def sdk_messages(types, packets, topic="/rslidar_packets"):
    """Return messages of rslidar_sdk: data and device information in one topic."""
    for time_ns, payload in packets:
        header = types.header(time_ns, "rslidar")
        yield topic, time_ns + 10**6, types.make(SDK, header, int(payload[:2] == INFO), 0, array(payload))


def old_messages(types, packets, topic="/rslidar_packets", per_scan=90):
    """Return messages of older drivers: scans, and device information in a topic of its own."""
    waiting = []
    for time_ns, payload in packets:
        packet = types.make(OLD, types.time(time_ns), array(payload))
        if payload[:2] == INFO:
            yield f"{topic}_difop", time_ns, packet
            continue
        waiting.append(packet)
        if len(waiting) == per_scan:
            yield topic, time_ns, types.make(SCAN, types.header(time_ns, "rslidar"), waiting)
            waiting = []
    if waiting:
        yield topic, time_ns, types.make(SCAN, types.header(time_ns, "rslidar"), waiting)


@pytest.mark.parametrize(("container", "messages"), covering(CONTAINERS, (sdk_messages, old_messages)))
def test_topics_equal_the_capture(container, messages, packets, expected, tmp_path):
    types = Types(container)
    found, warnings, damage, times = clouds(write(tmp_path, container, types, messages(types, packets)))
    assert found == {"/rslidar_points": expected}
    assert (warnings, damage) == ([], [])
    log_ns, stamps_ns, frames = zip(*times, strict=True)
    assert list(log_ns) == sorted(log_ns)
    assert set(frames) == {"rslidar"}
    assert all(0 <= log - stamp < 10**8 for log, stamp in zip(log_ns[:-1], stamps_ns[:-1], strict=True))


def test_ros_2_scans_of_older_drivers_equal_the_capture(packets, expected, tmp_path):
    new_names = {OLD: "rslidar_msg/msg/RslidarPacket", SCAN: "rslidar_msg/msg/RslidarScan"}
    definitions = {
        new_names[OLD]: "builtin_interfaces/Time stamp\nuint8[1248] data",
        new_names[SCAN]: "std_msgs/Header header\nrslidar_msg/RslidarPacket[] packets",
    }
    types = Types("db3", definitions)
    make = types.make
    types.make = lambda name, *values: make(new_names.get(name, name), *values)
    found, *_ = clouds(write(tmp_path, "db3", types, old_messages(types, packets)))
    assert found == {"/rslidar_points": expected}


def test_scans_of_nebula_with_slots_of_the_size_of_a_packet(packets, expected, tmp_path):
    """The data are 1,248 bytes and their length; a device information packet is among them."""
    name = "robosense_msgs/msg/Robosense"
    packet = "builtin_interfaces/Time stamp\nuint8[1248] data\nuint32 size\n"
    definitions = {f"{name}Packet": packet, f"{name}Scan": "std_msgs/Header header\nRobosensePacket[] packets\n"}
    types = Types("mcap", definitions)

    def scans(size=90):
        for first in range(0, len(packets), size):
            part = packets[first : first + size]
            sent = [types.make(f"{name}Packet", types.time(t), array(data), len(data)) for t, data in part]
            yield (
                "/robosense_packets",
                part[-1][0],
                types.make(f"{name}Scan", types.header(part[0][0], "robosense"), sent),
            )

    found, *_ = clouds(write(tmp_path, "mcap", types, scans()))
    assert found == {"/robosense_points": expected}


def test_two_sensors_have_their_own_device_information(packets, expected, tmp_path):
    from seaclutter_cli.sensors.robosense.models import MODELS
    from seaclutter_cli.sensors.robosense.packets import make_angles, write_info

    other = write_info(MODELS["RS-LiDAR-32"], make_angles(np.arange(32) * 50 - 700, np.zeros(32, int))).tobytes()
    right = [(time_ns, other if payload[:2] == INFO else payload) for time_ns, payload in packets]
    types = Types("mcap")
    both = [
        *old_messages(types, right, "/right/rslidar_packets"),
        *old_messages(types, packets, "/left/rslidar_packets"),
    ]
    found, *_ = clouds(write(tmp_path, "mcap", types, sorted(both, key=lambda message: message[1])))
    assert found["/left/rslidar_points"] == expected
    assert [stamp for stamp, _ in found["/right/rslidar_points"]] == [stamp for stamp, _ in expected]
    assert found["/right/rslidar_points"] != expected


@pytest.mark.parametrize("messages", [sdk_messages, old_messages])
def test_without_device_information(messages, packets, tmp_path):
    types = Types("mcap")
    data = [packet for packet in packets if packet[1][:2] != INFO]
    path = write(tmp_path, "mcap", types, messages(types, data))
    found, (warning,), *_ = clouds(path)
    assert not found
    assert warning.startswith(
        "/rslidar_packets is not decoded: RoboSense: RS-LiDAR-32, RS-LiDAR-16 and RS-Bpearl share"
    )
    angles = tmp_path / "angles.csv"
    angles.write_text("".join(f"{-25 + n},0\n" for n in range(32)))
    found, warnings, *_ = clouds(path, model="RS-LiDAR-32", calibration=angles)
    assert len(found["/rslidar_points"]) > 3
    assert any("no device information (DIFOP)" in warning for warning in warnings)


def test_device_information_alone_has_no_clouds(packets, tmp_path):
    types = Types("mcap")
    info = [packet for packet in packets if packet[1][:2] == INFO]
    found, warnings, *_ = clouds(write(tmp_path, "mcap", types, sdk_messages(types, info)))
    assert not found
    assert warnings == ["/rslidar_packets is not decoded: only device information, no data packets"]


@pytest.mark.parametrize("messages", [sdk_messages, old_messages])
def test_lost_packets_are_counted(messages, packets, tmp_path):
    data = [number for number, (_, payload) in enumerate(packets) if payload[:2] != INFO]
    lost = set(data[200:203]) | set(data[500:501])
    types = Types("bag")
    left = [packet for number, packet in enumerate(packets) if number not in lost]
    _, warnings, damage, _ = clouds(write(tmp_path, "bag", types, messages(types, left)))
    assert warnings == ["/rslidar_points: 4 packets missing, counted from gaps"]
    assert damage == []


def test_damaged_messages_are_reported(packets, expected, tmp_path):
    types = Types("db3")
    entries = list(sdk_messages(types, packets))
    whole = types.bytes
    sizes = iter([*[None] * 310, 0, 3, 20, 40, *[None] * len(entries)])
    types.bytes = lambda message: whole(message)[: next(sizes)]
    found, warnings, damage, _ = clouds(write(tmp_path, "db3", types, entries))
    assert len(damage) == 4
    assert all("of /rslidar_packets cannot be read" in text for text in damage)
    assert warnings == ["/rslidar_points: 4 packets missing, counted from gaps"]
    equal = [one == other for one, other in zip(found["/rslidar_points"], expected, strict=True)]
    assert equal.count(False) == 1


def test_recorded_clouds_are_preferred(packets, tmp_path):
    types = Types("mcap")
    fields = (types.header(1, "rslidar"), 1, 0, [], False, 0, 0, np.zeros(0, np.uint8), True)
    cloud = ("/rslidar_points", packets[0][0], types.make("sensor_msgs/msg/PointCloud2", *fields))
    source = open_source(write(tmp_path, "mcap", types, [cloud, *sdk_messages(types, packets)]))
    assert [channel.topic for channel in source.channels] == ["/rslidar_points", "/rslidar_packets"]
    source.close()


def test_real_packets_of_an_rs_helios_in_scans_of_nebula():
    """Whole revolutions have stamps 100 ms apart and points on all 32 rings."""
    found, _, damage, _ = clouds(shared("nebula/robosense_helios"))
    (frames,) = found.values()
    sizes = [len(points) // 26 for _, points in frames]
    assert sizes == [28_126, 28_694, 28_746, 28_776, 28_801, 627]
    assert np.allclose(np.diff([stamp_ns for stamp_ns, _ in frames[:5]]) / 1e9, 0.1, atol=1e-5)
    layout = np.dtype({"names": ["ring"], "formats": ["<u2"], "offsets": [16], "itemsize": 26})
    assert np.unique(np.frombuffer(frames[2][1], layout)["ring"]).tolist() == list(range(32))
    assert damage == []
