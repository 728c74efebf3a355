"""Point clouds from packet topics, in every encoding, intact and damaged."""

import struct
import sys
from pathlib import Path

import numpy as np
import pytest

from seaclutter_cli.cloud import from_array
from seaclutter_cli.errors import InputError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.messages import CODECS, find_codec
from seaclutter_cli.messages.definitions import ros2_schema
from seaclutter_cli.records import Channel, Message, Metadata, Schema, SensorFacts
from seaclutter_cli.sensors.families import PACKET_FAMILIES
from seaclutter_cli.sensors.packets import DecoderOptions, PacketFamily, PacketFrame, point_dtype
from seaclutter_cli.sensors.velodyne.decoder import Velodyne
from seaclutter_cli.sources.formats import wrap_packets
from seaclutter_cli.sources.shared import packet_topics
from seaclutter_cli.sources.shared.split import SplitSource

START = 1_600_000_000 * 10**9
VELODYNE_SCAN, PANDAR_SCAN = "velodyne_msgs/msg/VelodyneScan", "pandar_msgs/msg/PandarScan"
IMU = Channel(9, "/imu", "cdr", ros2_schema("sensor_msgs/msg/Imu"))


class Tens(PacketFamily):
    """A sensor with ten packets per revolution; each packet is a point, and its first byte is x."""

    title = "Tens"

    def __init__(self, error=None):
        self.error = error

    def recognises(self, payload):
        return True

    def decoder(self, packets, options):
        if self.error:
            raise self.error
        if options.model == "picky" and packets.payloads[0, 0] > 9:
            raise InputError("these packets are not supported")
        return TensDecoder()


class TensDecoder:
    places_end = 1 << 62

    def __init__(self):
        self.facts = SensorFacts("Tens", warnings=["a toy"])
        self.packets = []

    def add(self, packets):
        for time_ns, payload in zip(packets.times_ns.tolist(), packets.payloads, strict=True):
            if not len(payload):
                self.facts.bad_packets += 1
                continue
            self.facts.bad_packets += int(payload[0] == 255)
            self.facts.lost_packets += int(payload[0] == 254)
            self.packets.append((time_ns, payload[0], len(payload)))
            if len(self.packets) == 10:
                yield self.frame()

    def places(self, packets):
        return packets.times_ns

    def finish(self):
        if self.packets:
            yield self.frame(partial=True)

    def frame(self, *, partial=False):
        points = np.zeros(len(self.packets), point_dtype())
        points["x"] = [first for _, first, _ in self.packets]
        points["y"] = [size for _, _, size in self.packets]
        stamp_ns = self.packets[-1][0]
        self.packets = []
        return PacketFrame(points, stamp_ns, partial=partial)


class Log(Source):
    """A log in memory."""

    name, format = "log", "a list"
    channels = counts = span_ns = None

    def __init__(self, records, channels, *, counts=None):
        super().__init__()
        self._records, self.channels = records, channels
        self.counts = counts or {}
        self.closed = False

    def records(self, start_ns=None, end_ns=None):
        return iter(self._records)

    def close(self):
        self.closed = True


def channel(kind=VELODYNE_SCAN, *, number=1, topic="/velodyne_packets", encoding="cdr"):
    schema = ros2_schema(kind) if encoding == "cdr" else Schema(kind.replace("/msg/", "/"), "ros1msg", b"")
    return Channel(number, topic, encoding, schema)


def scan(packets, *, kind=VELODYNE_SCAN, encoding="cdr", frame_id="velodyne", big_endian=False):
    """Return a scan message of packets, given as times and bytes, written field by field."""
    order, ros1 = (">" if big_endian else "<"), encoding == "ros1"
    data = bytearray(struct.pack("<III", 7, 3, 4) if ros1 else struct.pack(order + "II", 3, 4))

    def put(code, value):
        data.extend(bytes(0 if ros1 else -len(data) % 4) + struct.pack(order + code, value))

    name = frame_id.encode() + (b"" if ros1 else b"\0")
    put("I", len(name))
    data.extend(name)
    put("I", len(packets))
    most = 1206 if kind == VELODYNE_SCAN else 1500
    for time_ns, payload in packets:
        put("I", time_ns // 10**9)
        put("I", time_ns % 10**9)
        data.extend(payload.ljust(most, b"\0"))
        if kind == PANDAR_SCAN:
            put("I", len(payload))
    return bytes(data) if ros1 else bytes((0, not big_endian, 0, 0)) + bytes(data)


def numbered(first, count, size=1206):
    return [(START + number * 10**6, bytes([number % 256]) * size) for number in range(first, first + count)]


def messages(chan, scans):
    return [Message(chan, START + n * 10**8, START + n * 10**8 + 5, n, data) for n, data in enumerate(scans)]


def wrapped(records, channels, *, options=None, family=None, counts=None):
    return decoded(Log(records, channels, counts=counts), options, family)


def decoded(log, options=None, family=None):
    """Return a log with clouds, as if all packets were from one family."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(packet_topics, "PACKET_FAMILIES", dict.fromkeys(PACKET_FAMILIES, family or Tens()))
        return wrap_packets(log, options)


def clouds(source):
    """Return the clouds of a source with their messages."""
    return [(m, find_codec(m.channel).decode(m.data)) for m in source.records() if is_cloud(m)]


def is_cloud(record):
    return isinstance(record, Message) and find_codec(record.channel) is not None


FORMS = [
    {"kind": kind, "encoding": encoding, "big_endian": big}
    for kind in (VELODYNE_SCAN, PANDAR_SCAN)
    for encoding, big in (("cdr", False), ("cdr", True), ("ros1", False))
]


@pytest.mark.parametrize("form", FORMS, ids=str)
@pytest.mark.parametrize("frame_id", ["", "a", "velodyne", "lidar_é"])
def test_clouds_from_scans(form, frame_id):
    chan = channel(form["kind"], encoding=form["encoding"])
    scans = messages(chan, [scan(numbered(n * 7, 7), frame_id=frame_id, **form) for n in range(3)])
    other = Message(IMU, START + 15 * 10**7, 0, 0, b"imu")
    records = [scans[0], scans[1], other, Metadata("note", {}), scans[2]]
    source = wrapped(records, [chan, IMU], counts={1: 3, 9: 1})
    (_, _, decoded) = source.channels
    assert (decoded.topic, decoded.message_encoding) == ("/velodyne_points", form["encoding"])
    assert source.counts == {1: 3, 9: 1, decoded.id: 3}
    read = list(source.records())
    assert [record for record in read if not is_cloud(record)] == records
    assert [is_cloud(record) for record in read] == [False, False, True, False, False, False, True, True]
    (first, cloud), (second, _), (rest, last) = clouds(source)
    assert cloud.points["x"].tolist() == list(range(10))
    assert last.points["x"].tolist() == [20]
    assert set(cloud.points["y"].tolist()) == {1206}
    assert (cloud.stamp_ns, cloud.frame_id) == (START + 9 * 10**6, frame_id)
    assert [(m.log_time_ns, m.publish_time_ns) for m in (first, second, rest)] == [
        (scans[n].log_time_ns, scans[n].publish_time_ns) for n in (1, 2, 2)
    ]
    assert [m.sequence for m in (first, second, rest)] == [0, 1, 2]
    assert source.facts["/velodyne_points"].details["partial revolutions"].startswith("1,")
    assert source.damage == []


def test_ros_1_clouds_have_a_ros_1_schema():
    chan = channel(encoding="ros1")
    source = wrapped(messages(chan, [scan(numbered(0, 10), encoding="ros1")]), [chan])
    decoded = source.channels[-1]
    assert (decoded.schema.name, decoded.schema.encoding) == ("sensor_msgs/PointCloud2", "ros1msg")
    assert b"MSG: std_msgs/Header\nuint32 seq\ntime stamp" in decoded.schema.data
    assert clouds(source)[0][1].extra == 0


def test_packets_of_several_lengths_are_in_order():
    chan = channel(PANDAR_SCAN)
    sizes = [1080, 1080, 512, 1080, 9999, 1080, 0, 1080, 1080, 1080]
    data = bytearray(scan([(START + n, bytes([n]) * 1080) for n in range(10)], kind=PANDAR_SCAN))
    for n, size in enumerate(sizes):
        struct.pack_into("<I", data, len(data) - (10 - n) * 1512 + 1508, size)
    ((_, cloud),) = clouds(wrapped(messages(chan, [bytes(data)]), [chan]))
    assert cloud.points["y"].tolist() == [min(size, 1500) for size in sizes if size]


def test_state_is_kept_per_channel_and_passes_are_equal():
    chans = [channel(), channel(number=2, topic="/front/scan")]
    records = [m for n in range(6) for chan in chans for m in messages(chan, [scan(numbered(n * 5 * chan.id, 5))])]
    source = wrapped(records, chans)
    assert [c.topic for c in source.channels[2:]] == ["/velodyne_points", "/front/scan/points"]
    first = clouds(source)
    assert [(m.channel.topic, cloud.size) for m, cloud in first] == [
        (topic, 10) for _ in range(3) for topic in ("/velodyne_points", "/front/scan/points")
    ]
    assert first == clouds(source)
    assert source.warnings == [f"{topic}: a toy" for topic in ("/velodyne_points", "/front/scan/points")]


def test_a_split_recording_is_one_stream():
    chan = channel()
    files = {Path(f"log_{n}.db3"): Log(messages(chan, [scan(numbered(n * 7, 7))]), [chan]) for n in range(3)}
    source = decoded(SplitSource(list(files), files.__getitem__))
    assert [cloud.points["x"].tolist() for _, cloud in clouds(source)] == [[*range(10)], [*range(10, 20)], [20]]


def test_packets_whose_clouds_were_recorded_too_are_not_decoded():
    chan = channel()
    taken = Channel(2, "/velodyne_points", "cdr", ros2_schema("sensor_msgs/msg/PointCloud2"))
    cloud = from_array(np.zeros(2, point_dtype()))
    records = [*messages(chan, [scan(numbered(0, 10))]), Message(taken, START, START, 0, CODECS_CDR.encode(cloud))]
    source = wrapped(records, [chan, taken])
    assert [c.topic for c in source.channels] == ["/velodyne_packets", "/velodyne_points"]
    assert len(list(source.records())) == 2


CODECS_CDR = CODECS["sensor_msgs/msg/PointCloud2", "cdr"]


def test_bad_and_lost_packets_are_reported():
    chan = channel()
    packets = [*numbered(0, 8), (START, b"\xff" * 1206), (START, b"\xfe" * 1206)]
    source = wrapped(messages(chan, [scan(packets)]), [chan])
    for _ in range(2):
        clouds(source)
        (damage,) = source.damage
        assert str(damage) == "log: /velodyne_points: 1 packet that cannot be decoded; left out: 1,206 bytes"
        assert source.warnings[1:] == ["/velodyne_points: 1 packet missing, counted from gaps"]


def test_a_log_without_packet_topics_is_returned_unchanged():
    log = Log([], [IMU, Channel(2, "/raw", "cdr", None), channel(encoding="json")])
    assert wrap_packets(log, DecoderOptions()) is log


def test_an_empty_packet_topic_has_no_clouds():
    chan = channel()
    for counts in ({}, {1: 0}):
        source = wrapped([], [chan], counts=counts)
        assert list(source.channels) == [chan]
        assert list(source.records()) == []
    source.close()
    assert source._inner.closed


def test_topics_that_cannot_be_decoded_are_kept_with_a_warning():
    chan = channel()
    records = messages(chan, [scan(numbered(0, 10)), b"", scan(numbered(0, 10))])
    source = wrapped(records, [chan], family=Tens(InputError("angles are needed: --calibration")))
    assert source.warnings == ["/velodyne_packets is not decoded: angles are needed: --calibration"]
    assert list(source.channels) == [chan]
    assert list(source.records()) == records
    assert source.damage == []


def test_a_missing_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "velodyne_decoder", None)
    chan, payload = channel(), (b"\xff\xee" + bytes(98)) * 12 + bytes(4) + b"\x37\x22"
    records = messages(chan, [scan([(START, payload)])])
    source = wrapped(records, [chan], family=Velodyne())
    (warning,) = source.warnings
    assert warning.startswith("/velodyne_packets is not decoded: decoding Velodyne packets requires an optional dep")
    assert warning.endswith("pip install 'seaclutter[velodyne]'")
    assert list(source.records()) == records


def test_the_first_scan_may_be_damaged():
    chan = channel()
    scans = [b"", scan([]), scan(numbered(50, 5)), scan(numbered(0, 10))]
    source = wrapped(messages(chan, scans), [chan], options=DecoderOptions(model="picky"))
    assert [cloud.size for _, cloud in clouds(source)] == [10, 5]
    (damage,) = source.damage
    assert damage.lost_messages == 1
    assert "scan 0 of /velodyne_packets" in str(damage)


@pytest.mark.parametrize("form", FORMS, ids=str)
def test_a_scan_truncated_anywhere_is_reported(form):
    chan = channel(form["kind"], encoding=form["encoding"])
    whole = scan(numbered(0, 3), **form)
    for size in [*range(60), *range(len(whole) - 60, len(whole))]:
        source = wrapped(messages(chan, [whole, whole[:size]]), [chan])
        ((_, cloud),) = clouds(source)
        assert (cloud.size, len(source.damage)) == (3, 1)
