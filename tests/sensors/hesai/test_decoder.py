"""Hesai decoder, on a real frame decoded by Nebula and on packets written according to the user manuals."""

import datetime as dt
import math
import struct
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from seaclutter_cli.errors import InputError
from seaclutter_cli.records import Message
from seaclutter_cli.sensors.hesai.decoder import Hesai
from seaclutter_cli.sensors.hesai.scans import parse_angles
from seaclutter_cli.sensors.packets import DecoderOptions, Packets
from seaclutter_cli.sources.rosbag2.db3 import Db3Source
from tests.pairs import covering
from tests.paths import shared

START = dt.datetime(2024, 2, 29, 23, 59, 59, tzinfo=dt.UTC)
START_NS = int(START.timestamp()) * 10**9
XT32, P40, P40_NUMBERED = "XT32", "P40", "P40 with sequence numbers"
# Channels, blocks per packet, time between blocks, and time from the packet's time to its last block, in nanoseconds.
P64, P64_NUMBERED, QT = "P64", "P64 with sequence numbers", "QT"
XT16, XT32M, QT128, P128, OT128 = "XT16", "XT32M2X", "QT128", "P128", "OT128"
SHAPES = {XT32: (32, 8, 50_000, 5_632), P40: (40, 10, 55_560, -28_580), P40_NUMBERED: (40, 10, 55_560, -28_580)}
SHAPES |= {P64: (64, 6, 55_560, -42_580), P64_NUMBERED: (64, 6, 55_560, -42_580), QT: (64, 4, 166_667, 525_711)}
SHAPES |= {XT16: (16, 8, 50_000, 5_632), XT32M: (32, 6, 50_000, 5_632), QT128: (128, 2, 111_110, 120_110)}
SHAPES |= {P128: (128, 2, 55_556, 3_148), OT128: (128, 2, 55_556, 0)}
FLAGGED = {QT128: (3, 2, 3), P128: (1, 4, 3), OT128: (1, 4, 130)}  # protocol and status version
FIRST_NS = {QT: 25_710, QT128: 9_000}  # sensors whose packet time is that of the beginning
XTS = (XT32, XT16, XT32M)
WITH_CONFIDENCE = (*XTS, QT, QT128)
SINGLE, DUAL = 0x37, 0x39
NOMINAL = DecoderOptions()


def scans(folder="xt32"):
    """Yield the log time and the packets of each recorded scan."""
    store = get_typestore(Stores.LATEST)
    packet = "builtin_interfaces/Time stamp\nuint8[1500] data\nuint32 size\n"
    scan = "std_msgs/Header header\npandar_msgs/PandarPacket[] packets\n"
    store.register(get_types_from_msg(packet, "pandar_msgs/msg/PandarPacket"))
    store.register(get_types_from_msg(scan, "pandar_msgs/msg/PandarScan"))
    for record in Db3Source(next(shared(f"nebula/{folder}").glob("*.db3"))).records():
        if isinstance(record, Message):
            found = store.deserialize_cdr(record.data, "pandar_msgs/msg/PandarScan").packets
            times = [packet.stamp.sec * 10**9 + packet.stamp.nanosec for packet in found]
            yield record.log_time_ns, Packets(np.array(times), np.stack([p.data[: p.size] for p in found]))


def all_scans(folder="xt32"):
    parts = [packets for _, packets in scans(folder)]
    return Packets(np.concatenate([p.times_ns for p in parts]), np.concatenate([p.payloads for p in parts]))


def nebula_points(folder="xt32"):
    data = next(shared(f"nebula/{folder}").glob("*.pcd")).read_bytes()
    return np.frombuffer(data[data.index(b"DATA binary\n") + 12 :], "<f4").reshape(-1, 3)


def decode(packets, batch=10_000, options=NOMINAL, sample=None):
    decoder = Hesai().decoder(sample or packets, options)
    frames = []
    for start in range(0, len(packets), batch):
        part = slice(start, start + batch)
        frames += decoder.add(Packets(packets.times_ns[part], packets.payloads[part]))
    return [*frames, *decoder.finish()], decoder.facts


def xyz(points):
    return np.stack([points[axis] for axis in "xyz"], axis=1)


def assert_same(one, two):
    assert [(f.stamp_ns, f.partial) for f in one] == [(f.stamp_ns, f.partial) for f in two]
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a.points, b.points)


def test_a_real_recording_contains_complete_revolutions():
    packets = all_scans()
    frames, facts = decode(packets)
    assert facts.model == "PandarXT-32"
    assert facts.details["return mode"] == "last, strongest"
    assert facts.lost_packets == facts.bad_packets == 0
    assert [frame.partial for frame in frames] == [True, False, False, False, True]
    assert [len(frame.points) for frame in frames[1:4]] == pytest.approx([63000] * 3, abs=100)
    # The clock of this sensor is in 2019.
    assert "not synchronised" in facts.details["clock"]
    assert abs(frames[-1].stamp_ns - packets.times_ns[-1]) < 10_000_000


def unit_angles(frames, expected):
    """Return the angles of the unit, which the recording lacks, fitted to the points decoded by Nebula."""
    points = np.concatenate([frame.points for frame in frames])
    ranges, lengths = np.linalg.norm(xyz(points), axis=1), np.linalg.norm(expected, axis=1)
    elevations = np.degrees(np.arcsin(expected[:, 2] / lengths))
    lines = ["Laser id,Elevation,Azimuth"]
    for channel in range(32):
        theirs = np.rint(15 - elevations) == channel
        ours = np.flatnonzero(points["ring"] == channel)
        count, wanted = int(theirs.sum()), lengths[theirs]
        starts = np.flatnonzero(np.isclose(ranges[ours], wanted[0], atol=1e-3))
        shift = next(n for n in starts if np.allclose(ranges[ours[n : n + count]], wanted, atol=1e-3))
        difference = azimuths_of(expected[theirs]) - azimuths_of(xyz(points[ours[shift : shift + count]]))
        offset = np.median((difference + 180) % 360 - 180)
        lines.append(f"{channel + 1},{np.median(elevations[theirs]):.4f},{offset:.4f}")
    return "\n".join(lines)


def azimuths_of(positions):
    return np.degrees(np.arctan2(positions[:, 0], positions[:, 1]))


def test_every_point_agrees_with_nebula(tmp_path):
    packets, expected = all_scans(), nebula_points()
    path = tmp_path / "unit.csv"
    path.write_text(unit_angles(decode(packets)[0], expected))
    found = decode(packets, options=DecoderOptions(path))[0][3].points
    assert len(found) == len(expected) == 63021
    assert np.abs(xyz(found) - expected).max() < 1e-3


@pytest.mark.parametrize("batch", [1, 37, 500])
def test_batch_size_does_not_matter_for_real_packets(batch):
    packets = all_scans()
    part = Packets(packets.times_ns[:900], packets.payloads[:900])
    assert_same(decode(part, batch)[0], decode(part)[0])


def test_real_packets_are_recognised():
    assert all(Hesai().recognises(payload) for payload in all_scans().payloads)


def returns_of(kind, number, block, channel, mode):
    """Return distance and intensity of a slot. Some slots are empty, some pairs of returns are equal."""
    return return_of(*firing_of(kind, number, block, mode), channel)


def firing_of(kind, number, block, mode):
    """Return which of 50 firings, that repeat, a block has, and whether it has their second returns."""
    blocks, pair = SHAPES[kind][1], 2 if mode == DUAL else 1
    return (number * blocks + block) // pair % 50, pair == 2 and block % 2 == 1


def return_of(firing, is_second, channel):
    if (firing + channel) % 5 == 0:
        return 0, 0
    distance = 1000 + 10 * channel + firing
    return (distance + 700, 40) if is_second and channel % 2 else (distance, 30 + channel)


@cache
def block_data(kind, firing, is_second):
    """Return the bytes of all channels of a block."""
    confidence = b"\x01" if kind in WITH_CONFIDENCE else b""
    channels = range(SHAPES[kind][0])
    return b"".join(struct.pack("<HB", *return_of(firing, is_second, channel)) + confidence for channel in channels)


def make_packet(kind, number, azimuths, time_ns, mode=SINGLE, utc=None):
    """Return packet ``number``, according to the tables of the user manual."""
    channels, blocks, _, _ = SHAPES[kind]
    body = b""
    for block in range(blocks):
        body += (b"\xff\xee" if kind in (P40, P40_NUMBERED) else b"") + struct.pack("<H", azimuths[block])
        body += block_data(kind, *firing_of(kind, number, block, mode))
    moment = dt.datetime.fromtimestamp(time_ns // 10**9, dt.UTC)
    micros = time_ns % 10**9 // 1000
    first = moment.year - (1900 if kind in (*XTS, *FLAGGED) else 2000)
    utc = utc or bytes([first, moment.month, moment.day, moment.hour, moment.minute, moment.second])
    if kind in FLAGGED:
        return make_flagged_packet(kind, number, body, time_ns, mode, utc)
    if kind in XTS:
        head = bytes([0xEE, 0xFF, 6, 1, 0, 0, channels, blocks, 0, 4, 2 if mode == DUAL else 1, 1])
        tail = bytes(10) + struct.pack("<BH6sIB", mode, 600, utc, micros, 0x42)
        return head + body + tail + struct.pack("<I", (number + 2**32 - 5) % 2**32)
    end = struct.pack("<HIBB6s", 600, micros, mode, 0x42, utc)
    numbered = struct.pack("<I", number + 1) if kind in (P40_NUMBERED, P64_NUMBERED, QT) else b""
    if kind == QT:
        head = bytes([0xEE, 0xFF, 3, 1, 0, 0, 64, 4, 0, 4, 2 if mode == DUAL else 1, 1])
        return head + body + bytes(10) + end + numbered
    head = bytes([0xEE, 0xFF, 64, 6, 0, 4, 0, 0]) if kind in (P64, P64_NUMBERED) else b""
    return head + body + bytes(8) + end + numbered


def make_flagged_packet(kind, number, body, time_ns, mode, utc, operation=2):
    """Return a packet with safety information and sequence number; with confidence and signature, or inertial data."""
    flags, unit_end = (0b11101, bytes(32)) if kind == QT128 else (0b00111, b"")
    inertial = bytes(22) if flags & 2 else b""
    head = bytes([0xEE, 0xFF, *FLAGGED[kind], 0, 128, 2, 0, 4, 2 if mode == DUAL else 1, flags])
    state = bytes([0, 0, 0, 0, 0, number % 2, 0, 0, 0]) + struct.pack("<H", 0x1000)  # state 0, then 1
    tail = state + struct.pack("<BBH6sIB", operation, mode, 600, utc, time_ns % 10**9 // 1000, 0x42)
    return head + body + bytes(4 + 17) + tail + struct.pack("<I", number + 1) + inertial + bytes(4) + unit_end


def make_packets(kind, revolutions=3.0, mode=SINGLE, start=0.0, *, backwards=False, behind_ns=0):
    """Return packets of a sensor at 600 rpm, and packet number, block, azimuth and time of each firing or return."""
    _, blocks, block_ns, last_ns = SHAPES[kind]
    pair = 2 if mode == DUAL else 1
    step = 3600 * block_ns / 1e9
    count = math.ceil(revolutions * 360 / (step * blocks / pair))
    made, times, slots = [], [], []
    for number in range(count):
        firings = [number * blocks // pair + block // pair for block in range(blocks)]
        angles = [start + firing * step for firing in firings]
        azimuths = [round((-angle if backwards else angle) * 100) % 36000 for angle in angles]
        time_ns = START_NS + round(firings[-1] * block_ns / 1000) * 1000
        made.append(make_packet(kind, number, azimuths, time_ns - behind_ns, mode))
        times.append(time_ns + 20_000)
        if kind in FIRST_NS:
            last_ns = FIRST_NS[kind] + (blocks // pair - 1) * block_ns
        for block in range(blocks):
            late_ns = last_ns - (blocks - 1 - block) // pair * block_ns
            slots += [(number, block, azimuths[block], time_ns + late_ns)]
    return Packets(np.array(times), np.stack([np.frombuffer(packet, np.uint8) for packet in made])), slots


XT_ELEVATION = list(range(15, -17, -1))
P40_ELEVATION = {1: 15.0, 5: 3.0, 12: 0.0, 17: -1.66, 30: -6.0, 38: -14.0, 39: -19.0, 40: -25.0}
P40_AZIMUTH = {1: -1.042, 7: 3.125, 8: -5.208, 9: -1.042, 28: 3.125, 29: -5.208, 30: -1.042, 40: -1.042}
P40_FIRING = {1: -42.22, 4: -3.62, 8: -54.67, 21: -23.89, 40: -3.62}
P64_ELEVATION = {1: 14.708, 7: 1.686, 17: -0.005, 33: -2.71, 54: -6.235, 55: -7.237, 63: -19.063, 64: -25.071}
P64_AZIMUTH = {1: -1.042, 7: 1.042, 17: -3.125, 33: 5.208, 54: -1.042, 55: -1.042, 63: -1.042, 64: -1.042}
P64_FIRING = {1: -23.18, 7: -11.444, 17: -48.764, 33: -25.148, 54: -16.66, 55: -7.532, 63: -8.836, 64: -12.748}
QT_ELEVATION = {1: -52.121, 16: -24.517, 17: -22.964, 32: -0.725, 33: 0.725, 49: 24.524, 64: 52.133}
QT_AZIMUTH = {1: 8.736, 16: 5.987, 17: -5.27, 32: -4.881, 33: 5.493, 49: -5.33, 64: -7.892}
QT_FIRING = {1: 2.31, 16: 33.56, 17: 36.61, 32: 67.86, 33: 70.9, 49: 105.2, 64: 136.45}
TABLES = dict.fromkeys((P40, P40_NUMBERED), (P40_ELEVATION, P40_AZIMUTH, P40_FIRING))
TABLES |= dict.fromkeys((P64, P64_NUMBERED), (P64_ELEVATION, P64_AZIMUTH, P64_FIRING))
TABLES[QT] = (QT_ELEVATION, QT_AZIMUTH, QT_FIRING)
TABLES[XT16] = ({n: 17 - 2 * n for n in range(1, 17)}, dict.fromkeys(range(1, 17), 0.0), {})
TABLES[XT32M] = ({1: 19.433708, 16: -0.0325, 17: -1.339997}, {1: 0.175281, 16: 0.153816, 17: 0.153966}, {})
TABLES[QT128] = ({1: -52.62676282, 64: 7.093696848, 128: 52.62676282}, {1: 10.10830596, 64: -5.937608821}, {})
TABLES[QT128][1][128] = -10.10830596
TABLES[P128] = ({1: 14.436, 17: 6.466905, 127: -24.12274}, {1: 3.257, 17: 1.099655, 127: -3.445786}, {})
TABLES[OT128] = ({1: 14.985, 64: -2.876, 127: -23.044}, {1: 0.186, 64: -1.526, 127: 0.196}, {})
# Microseconds of a channel in the two states of a block.
STATES = {
    (QT128, 1): (0, 2.312),
    (QT128, 64): (49.832, 0),
    (QT128, 128): (48.12, 48.976),
    (P128, 1): (4.436, 4.436),
    (P128, 17): (32.564, 31.864),
    (P128, 127): (6.441, 6.091),
    (OT128, 1): (46.645, 46.645),
    (OT128, 64): (22.838, 24.982),
    (OT128, 127): (12.578, 14.722),
}


def fired_us(kind, mode, number, block, channel):
    """Return the time of a channel relative to its block."""
    if kind in XTS:
        steps = {XT32: 1.512 * (channel - 1), XT16: 3.024 * (channel - 1), XT32M: 2.888 * ((channel - 1) % 16)}
        return 0.368 + steps[kind]
    if kind not in FLAGGED:
        return TABLES[kind][2].get(channel, 0)
    later = mode == SINGLE and block == 1
    return STATES[kind, channel][(number + later + 1) % 2 if kind == QT128 else later]


@pytest.mark.parametrize("kind", SHAPES)
@pytest.mark.parametrize("mode", [SINGLE, DUAL])
def test_points_agree_with_the_manual(kind, mode):
    packets, slots = make_packets(kind, revolutions=0.5, mode=mode, start=30.0)
    points = np.concatenate([frame.points for frame in decode(packets)[0]])
    points = points[np.argsort(points["timestamp"], kind="stable")]
    known = range(1, 33) if kind == XT32 else TABLES[kind][0].keys() & TABLES[kind][1].keys()
    for channel in known:
        found = points[points["ring"] == channel - 1]
        expected = slow_points(kind, mode, slots, channel)
        assert len(found) == len(expected) > 100
        assert np.abs(xyz(found) - expected[:, :3]).max() < 1e-4
        np.testing.assert_array_equal(found["intensity"], expected[:, 3])
        if kind in (*XTS, *FLAGGED) or channel in TABLES[kind][2]:
            assert np.abs(found["timestamp"] - expected[:, 4]).max() < 1e-6
        if mode == DUAL:
            np.testing.assert_array_equal(found["return_number"], expected[:, 5])


def slow_points(kind, mode, slots, channel):
    """Return x, y, z, intensity, time and return number of a channel's points."""
    if kind == XT32:
        elevation, offset = XT_ELEVATION[channel - 1], 0.0
    else:
        elevation, offset = (table.get(channel, 0) for table in TABLES[kind][:2])
    points = []
    for number, block, azimuth, time_ns in slots:
        second = mode == DUAL and block % 2 == 1
        distance, intensity = returns_of(kind, number, block, channel - 1, mode)
        if distance == 0 or (second and returns_of(kind, number, block - 1, channel - 1, mode)[0] == distance):
            continue
        length, angle, height = distance * 0.004, math.radians(azimuth / 100 + offset), math.radians(elevation)
        x, y = length * math.cos(height) * math.sin(angle), length * math.cos(height) * math.cos(angle)
        fired = fired_us(kind, mode, number, block, channel)
        points.append((x, y, length * math.sin(height), intensity, time_ns / 1e9 + fired / 1e6, 1 + second))
    return np.array(points)


def test_high_resolution_halves_the_time_between_firings():
    azimuths = [1000, 1010]
    times = {}
    for operation in (0, 2):
        packet = make_packet(P128, 0, azimuths, START_NS)
        tail = len(packet) - 4 - 22 - 4 - 15
        packet = packet[:tail] + bytes([operation]) + packet[tail + 1 :]
        found = decode(Packets(np.array([START_NS]), np.frombuffer(packet, np.uint8)[None]))[0]
        points = np.concatenate([frame.points for frame in found])
        times[operation] = np.unique(points["timestamp"][points["ring"] == 26]) - START_NS / 1e9
    # Channel 27 fires 14.951 and 15.301 µs after its block, or 43.079 and 42.379 µs.
    assert times[0] * 1e6 == pytest.approx([3.148 - 27.778 + 14.951, 3.148 + 15.301], abs=0.5)
    assert times[2] * 1e6 == pytest.approx([3.148 - 55.556 + 43.079, 3.148 + 42.379], abs=0.5)


def test_small_distances_of_an_ot128_are_codes():
    packet = bytearray(make_packet(OT128, 0, [0, 10], START_NS))
    for channel, distance in enumerate((0, 1, 2, 3, 4)):
        packet[14 + 3 * channel : 16 + 3 * channel] = struct.pack("<H", distance)
    frames, _ = decode(Packets(np.array([START_NS]), np.frombuffer(bytes(packet), np.uint8)[None]))
    points = np.concatenate([frame.points for frame in frames])
    near = points["ring"][np.linalg.norm(xyz(points), axis=1) < 0.02]
    assert near.tolist() == [4]


@pytest.mark.parametrize("mode", [SINGLE, DUAL])
@pytest.mark.parametrize(("kind", "backwards"), covering(SHAPES, (False, True)))
def test_each_channel_is_split_where_it_crosses_azimuth_0(kind, mode, backwards):
    packets, slots = make_packets(kind, revolutions=3.2, mode=mode, start=90.0, backwards=backwards)
    frames, facts = decode(packets)
    assert [frame.partial for frame in frames] == [True, False, False, True]
    assert facts.lost_packets == facts.bad_packets == 0
    for frame in frames[1:3]:
        order = np.argsort(frame.points["ring"], kind="stable")
        ring = frame.points["ring"][order].astype(int)
        steps = (np.diff(azimuths_of(xyz(frame.points[order]))) + 180) % 360 - 180
        steps = np.where(np.diff(ring) == 0, -steps if backwards else steps, 0)
        assert (steps > -1e-3).all()
        turned = np.bincount(ring[1:], steps)[np.unique(ring)]
        assert turned.min() > 358.5
        assert turned.max() < 360.01
    assert all(one.stamp_ns < two.stamp_ns for one, two in pairwise(frames))
    assert frames[-1].stamp_ns / 1e9 == pytest.approx(slots[-1][3] / 1e9, abs=2e-4)


@pytest.mark.parametrize("kind", SHAPES)
def test_lost_packets_are_counted(kind):
    packets, _ = make_packets(kind, revolutions=2)
    keep = np.delete(np.arange(len(packets)), [10, 11, 12, 200])
    assert decode(Packets(packets.times_ns[keep], packets.payloads[keep]))[1].lost_packets == 4


@pytest.mark.parametrize(("kind", "gap"), covering(SHAPES, (0.3, 0.6, 1.0, 1.4)))
def test_revolutions_are_separated_across_a_gap(kind, gap):
    packets, _ = make_packets(kind, revolutions=4, start=180.0)
    count = len(packets) / 4
    lost = np.arange(round(1.2 * count), round((1.2 + gap) * count))
    keep = np.delete(np.arange(len(packets)), lost)
    frames, facts = decode(Packets(packets.times_ns[keep], packets.payloads[keep]))
    assert facts.lost_packets == len(lost)
    assert max(np.ptp(frame.points["timestamp"]) for frame in frames) < 0.1 + 21 / 3600
    assert sum(len(frame.points) for frame in frames) == pytest.approx(len(keep) * 0.8 * slots_of(kind), rel=0.01)


def slots_of(kind):
    return SHAPES[kind][0] * SHAPES[kind][1]


@pytest.mark.parametrize("kind", SHAPES)
def test_late_packets_are_not_lost(kind):
    packets, _ = make_packets(kind, revolutions=2)
    order = np.arange(len(packets))
    order[[50, 51, 120, 121]] = [51, 50, 121, 120]
    frames, facts = decode(Packets(packets.times_ns[order], packets.payloads[order]))
    straight = decode(packets)[0]
    assert facts.lost_packets == 0
    assert [len(frame.points) for frame in frames] == [len(frame.points) for frame in straight]


def test_a_recording_that_begins_and_ends_at_azimuth_0_is_complete():
    frames, _ = decode(make_packets(XT32, revolutions=2)[0])
    assert [frame.partial for frame in frames[:2]] == [False, False]


def test_a_clock_that_is_not_set_is_corrected():
    packets, _ = make_packets(XT32, behind_ns=5 * 365 * 86400 * 10**9)
    frames, facts = decode(packets)
    assert "not synchronised" in facts.details["clock"]
    assert abs(frames[0].stamp_ns - START_NS - 10**8) < 10**6
    assert decode(make_packets(XT32)[0])[1].details.get("clock") is None


def test_seconds_of_unix_time_are_read():
    seconds = START_NS // 10**9
    payload = make_packet(XT32, 0, [0] * 8, START_NS, utc=b"\0\0" + struct.pack(">I", seconds))
    packets = Packets(np.array([START_NS]), np.frombuffer(payload, np.uint8)[None])
    assert decode(packets)[0][0].points["timestamp"][0] == pytest.approx(START_NS / 1e9, abs=1e-3)


def test_a_stationary_rotor_does_not_fill_the_memory(monkeypatch):
    monkeypatch.setattr("seaclutter_cli.sensors.hesai.decoder._MAX_SLOTS", 10_000)
    payloads = [make_packet(XT32, n, [500] * 8, START_NS + n * 400_000) for n in range(200)]
    packets = Packets(np.full(200, START_NS), np.stack([np.frombuffer(payload, np.uint8) for payload in payloads]))
    frames, _ = decode(packets, batch=10)
    assert len(frames) > 3
    assert sum(len(frame.points) for frame in frames) == pytest.approx(200 * 256 * 0.8, rel=0.01)


def test_the_return_mode_may_change():
    one, _ = make_packets(XT32, revolutions=0.2, mode=DUAL)
    two, _ = make_packets(XT32, revolutions=0.2, mode=SINGLE)
    both = Packets(np.concatenate([one.times_ns, two.times_ns]), np.concatenate([one.payloads, two.payloads]))
    _, facts = decode(both)
    assert facts.details["return mode"] == "last, strongest; strongest"
    assert any("return mode changes" in warning for warning in facts.warnings)


def test_nominal_angles_give_a_warning(tmp_path):
    packets, _ = make_packets(P40, revolutions=0.1)
    assert "--calibration" in decode(packets)[1].warnings[0]
    path = tmp_path / "unit.csv"
    path.write_text("Channel,Elevation,Azimuth\n" + "".join(f"{n},{15 - n},{n / 10}\n" for n in range(1, 41)))
    frames, facts = decode(packets, options=DecoderOptions(path))
    assert facts.warnings == []
    point = frames[-1].points[frames[-1].points["ring"] == 19][0]
    height = math.degrees(math.atan2(point["z"], math.hypot(point["x"], point["y"])))
    assert height == pytest.approx(-5, abs=1e-3)


@pytest.mark.parametrize(
    "text", ["", "Laser id,Elevation,Azimuth\n1,2,3", "1,a,b", "1,2", "1,nan,0\n2,0,0", "\x00\xff"]
)
def test_an_invalid_calibration_is_an_error(text, tmp_path):
    path = tmp_path / "unit.csv"
    path.write_text(text, encoding="latin-1")
    with pytest.raises(InputError, match=r"unit\.csv"):
        parse_angles(path.read_bytes(), str(path), 2)


def test_other_sensors_are_rejected():
    with pytest.raises(InputError, match=r"PandarXT-32, .*Pandar128, OT128"):
        Hesai().decoder(Packets(np.zeros(1, np.int64), np.zeros((1, 893), np.uint8)), DecoderOptions())


def test_position_packets_are_not_counted_as_invalid():
    decoder = Hesai().decoder(make_packets(XT32, revolutions=0.1)[0], DecoderOptions())
    assert list(decoder.add(Packets(np.zeros(2, np.int64), np.zeros((2, 512), np.uint8)))) == []
    assert decoder.facts.bad_packets == 0


@cache
def valid_packets(kind, mode):
    return make_packets(kind, revolutions=0.06, mode=mode, start=350.0)[0]


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_broken_bytes_raise_no_error_and_batch_size_does_not_matter(data):
    packets = valid_packets(data.draw(st.sampled_from(sorted(SHAPES))), data.draw(st.sampled_from([SINGLE, DUAL])))
    payloads = packets.payloads.copy()
    for _ in range(data.draw(st.integers(1, 12))):
        packet = data.draw(st.integers(0, len(payloads) - 1))
        start = data.draw(st.integers(-40, payloads.shape[1] - 1)) % payloads.shape[1]
        found = np.frombuffer(data.draw(st.binary(min_size=1, max_size=12)), np.uint8)[: payloads.shape[1] - start]
        payloads[packet, start : start + len(found)] = found
    broken = Packets(packets.times_ns, payloads)
    frames, facts = decode(broken, sample=packets)
    assert_same(frames, decode(broken, data.draw(st.integers(1, 5)), sample=packets)[0])
    assert 0 <= facts.bad_packets <= len(payloads)
    for frame in frames:
        assert np.isfinite(xyz(frame.points)).all()
        assert abs(frame.stamp_ns - START_NS) < 2 * 86400 * 10**9
