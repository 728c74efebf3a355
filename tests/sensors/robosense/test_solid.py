"""Decoder of lidars without a rotor, compared with a slow one that reads one value after the other."""

import math
import struct

import numpy as np
import pytest

from seaclutter_cli.errors import InputError
from seaclutter_cli.sensors.families import PACKET_FAMILIES
from seaclutter_cli.sensors.packets import DecoderOptions, Packets
from seaclutter_cli.sensors.robosense.solid import RoboSenseSolid

START_NS = 1_760_000_000 * 10**9
PERIOD_NS = {"M1": 158_730, "E1": 347_222}
SHAPES = {"M1": (25, 5), "E1": (96, 1)}
F = np.float32


def header(number, time_ns):
    time = (time_ns // 10**9).to_bytes(6, "big") + (time_ns % 10**9 // 1000).to_bytes(4, "big")
    return b"\x55\xaa\x5a\xa5" + struct.pack(">HHBB", number, 1, 4, 2) + time + bytes(10) + bytes((6, 100))


def m1_packet(rng, number, time_ns):
    data = header(number, time_ns)
    for block in range(25):
        data += bytes((block * 6, 1))
        for _ in range(5):
            distance = rng.choice((0, 39, 40, 8000, 40000, 40001, rng.integers(0, 65536)))
            pitch, yaw = rng.integers(32768 - 1250, 32768 + 1250), rng.integers(32768 - 6000, 32768 + 6000)
            data += struct.pack(">HHHBBB", distance, pitch, yaw, rng.integers(0, 256), 0, 0)
    return data + bytes(3)


def e1_packet(rng, number, time_ns):
    data = header(number, time_ns)
    for block in range(96):
        distance = rng.choice((0, 1, 8000, 40000, 40001, rng.integers(0, 65536)))
        vector = rng.integers(-32768, 32768, 3).tolist()
        data += struct.pack(">HHhhhBB", block * 300, distance, *vector, rng.integers(0, 256), 0)
    return data + bytes(16)


WRITERS = {"M1": m1_packet, "E1": e1_packet}


def make_packets(kind, numbers, seed=0, behind_ns=0):
    rng = np.random.default_rng(seed)
    times = START_NS + np.arange(len(numbers)) * PERIOD_NS[kind]
    payloads = [WRITERS[kind](rng, number, int(time) - behind_ns) for number, time in zip(numbers, times, strict=True)]
    return Packets(times + 200_000, np.stack([np.frombuffer(payload, np.uint8) for payload in payloads]))


def slow_points(kind, payload):
    """Return (x, y, z, intensity, ring, time) of the points of a packet."""
    data, points = payload.tobytes(), []
    start = int.from_bytes(data[10:16], "big") + int.from_bytes(data[16:20], "big") / 1e6
    blocks, channels = SHAPES[kind]
    size = 47 if kind == "M1" else 12
    for block in range(blocks):
        at = 32 + block * size
        late = data[at] if kind == "M1" else int.from_bytes(data[at : at + 2], "big")
        for channel in range(channels):
            place = at + 2 + 9 * channel
            (units,) = struct.unpack_from(">H", data, place)
            r = F(units) * F(0.005)
            if not (F(0.2) if kind == "M1" else F(0.005)) <= r <= F(200):
                continue
            if kind == "M1":
                pitch, yaw, intensity = struct.unpack_from(">HHB", data, place + 2)
                a, b = (math.radians((value - 32768) / 100) for value in (pitch, yaw))
                position = r * F(math.cos(a)) * F(math.cos(b)), r * F(math.cos(a)) * F(math.sin(b)), r * F(math.sin(a))
            else:
                *vector, intensity = struct.unpack_from(">hhhB", data, place + 2)
                position = tuple(F(part) * r / F(32768) for part in vector)
            points.append((*position, intensity, channel, start + late / 1e6))
    return points


def decode(packets, batch=None):
    decoder = RoboSenseSolid().decoder(packets, DecoderOptions())
    frames = []
    for begin in range(0, len(packets), batch or len(packets)):
        part = slice(begin, begin + (batch or len(packets)))
        frames += decoder.add(Packets(packets.times_ns[part], packets.payloads[part]))
    return decoder.facts, [*frames, *decoder.finish()]


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize("batch", [None, 1, 7])
def test_agrees_with_the_reference(kind, batch):
    numbers = [*range(1, 41)] * 3
    packets = make_packets(kind, numbers)
    facts, frames = decode(packets, batch)
    assert facts.model == f"RS-{kind}"
    assert "experimental" in facts.details["decoder"]
    assert (facts.lost_packets, facts.bad_packets) == (0, 0)
    assert [frame.partial for frame in frames] == [False] * 3
    for number, frame in enumerate(frames):
        payloads = packets.payloads[40 * number : 40 * number + 40]
        expected = [point for payload in payloads for point in slow_points(kind, payload)]
        assert len(frame.points) == len(expected)
        for name, column in zip(("x", "y", "z", "intensity", "ring"), zip(*expected, strict=True), strict=False):
            np.testing.assert_allclose(frame.points[name], column, rtol=3e-7, atol=1e-6)
        assert np.abs(frame.points["timestamp"] - [point[-1] for point in expected]).max() < 1e-6


@pytest.mark.parametrize("kind", WRITERS)
def test_partial_frames_and_lost_packets(kind):
    numbers = [*range(20, 41), *range(1, 10), *range(12, 41), 1, 2]
    facts, frames = decode(make_packets(kind, numbers))
    assert [frame.partial for frame in frames] == [True, False, True]
    assert facts.lost_packets == 2


def test_late_packets_are_no_new_frame_and_not_lost():
    numbers = [1, 2, 4, 3, 5, *range(6, 30), 28, *range(30, 41)]
    facts, frames = decode(make_packets("M1", numbers))
    assert len(frames) == 1
    assert facts.lost_packets == 0


def test_a_clock_that_is_not_set_is_shifted():
    packets = make_packets("M1", range(1, 41), behind_ns=START_NS - 10**15)
    facts, (frame,) = decode(packets)
    assert "not synchronised" in facts.details["clock"]
    assert abs(frame.stamp_ns - packets.times_ns[-1]) < 10**6


def test_other_packets_are_counted_or_ignored():
    packets = make_packets("M1", range(1, 41))
    payloads = packets.payloads.copy()
    payloads[5, :4] = 0
    decoder = RoboSenseSolid().decoder(packets, DecoderOptions())
    assert list(decoder.add(Packets(packets.times_ns[:3], np.zeros((3, 256), np.uint8)))) == []
    assert list(decoder.add(Packets(packets.times_ns, payloads))) == []
    assert decoder.facts.bad_packets == 1
    assert len(list(decoder.finish())) == 1


def test_recognition():
    for kind in WRITERS:
        (payload,) = make_packets(kind, [1]).payloads
        assert [name for name, family in PACKET_FAMILIES.items() if family.recognises(payload)] == ["robosense_solid"]
        assert not RoboSenseSolid().recognises(payload[:-1])
    with pytest.raises(InputError, match="RS-M1"):
        RoboSenseSolid().decoder(Packets(np.zeros(1, np.int64), np.zeros((1, 1210), np.uint8)), DecoderOptions())
