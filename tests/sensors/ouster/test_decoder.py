"""Ouster decoder, compared with a slow one based on struct and math, on real and synthetic packets."""

import json
import math
import struct
from functools import cache
from itertools import pairwise
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaclutter_cli.errors import InputError
from seaclutter_cli.sensors.ouster.decoder import Ouster, _is_damaged
from seaclutter_cli.sensors.ouster.metadata import parse_metadata
from seaclutter_cli.sensors.packets import DecoderOptions, Packets
from tests.pairs import covering
from tests.paths import shared

CAPTURES = {
    "OS-0-128-U1_v2.3.0_1024x10": ("OS-0-128-U1_v2.3.0_1024x10", "OS0-128", [97299]),
    "OS-1-128_v2.3.0_1024x10_lb_n3": ("OS-1-128_v2.3.0_1024x10", "OS1-128", [107647, 107357, 107532]),
    "OS-1-32-G_v2.1.1_1024x10": ("OS-1-32-G_v2.1.1_1024x10", "OS1-32", [27310]),
    "windowed_frame1": ("windowed_frame1_0", "OS0-128", [9246]),
}
START_NS = 1_700_000_000 * 10**9
ROWS, COLUMNS, PER_PACKET = 16, 64, 16
SIZES = {"LEGACY": 12, "RNG19_RFL8_SIG16_NIR16": 12, "RNG19_RFL8_SIG16_NIR16_DUAL": 16, "RNG15_RFL8_NIR8": 4}
ALTITUDES = [15.0 - 2 * row for row in range(ROWS)]
AZIMUTHS = [4.2, 1.4, -1.4, -4.2] * 4
COLUMN_NS = 1_562_500


def capture(name):
    """Return the data packets of a PCAP file of Ethernet frames."""
    data = (shared("ouster") / f"{name}.pcap").read_bytes()
    start, times, payloads = 24, [], []
    while start < len(data):
        seconds, micros, size, _ = struct.unpack_from("<IIII", data, start)
        if size > 100:
            times.append((seconds * 10**6 + micros) * 1000)
            payloads.append(np.frombuffer(data, np.uint8, size - 42, start + 16 + 42))
        start += 16 + size
    return Packets(np.array(times), np.stack(payloads))


def metadata_path(name):
    return shared("ouster") / f"{CAPTURES[name][0]}.json"


def pixel(data, start, profile):
    """Return (range in metres, intensity) of each return of a pixel."""
    if profile == "RNG15_RFL8_NIR8":
        distance, reflectivity, _ = struct.unpack_from("<HBB", data, start)
        return [((distance & 0x7FFF) * 0.008, reflectivity)]
    if profile == "RNG19_RFL8_SIG16_NIR16_DUAL":
        one, two, signal, second = struct.unpack_from("<IIHH", data, start)
        return [((one & 0x7FFFF) / 1000, signal), ((two & 0x7FFFF) / 1000, second)]
    word, _, signal = struct.unpack_from("<IHH", data, start)
    return [((word & (0xFFFFF if profile == "LEGACY" else 0x7FFFF)) / 1000, signal)]


def slow_points(payload, path):
    """Return x, y, z, intensity, ring and return number of the points of a packet, according to Ouster's manual."""
    meta = json.loads(path.read_text())
    beams, lidar = meta.get("beam_intrinsics", meta), meta.get("lidar_intrinsics", meta)
    layout = meta.get("lidar_data_format") or meta["data_format"]
    profile = layout.get("udp_profile_lidar", "LEGACY")
    rows, columns = layout["pixels_per_column"], layout["columns_per_frame"]
    offset = beams["lidar_origin_to_beam_origin_mm"] / 1000
    matrix = np.array(lidar["lidar_to_sensor_transform"], float).reshape(4, 4)
    data, head = payload.tobytes(), 16 if profile == "LEGACY" else 12
    width = head + rows * SIZES[profile] + (4 if profile == "LEGACY" else 0)
    points = []
    for column in range(layout["columns_per_packet"]):
        start = (0 if profile == "LEGACY" else 32) + column * width
        number = struct.unpack_from("<H", data, start + 8)[0]
        status = struct.unpack_from("<I", data, start + width - 4) if head == 16 else (data[start + 10],)
        encoder = 2 * math.pi * (1 - number / columns)
        for row in range(rows if status[0] & 1 else 0):
            altitude = math.radians(beams["beam_altitude_angles"][row])
            angle = encoder - math.radians(beams["beam_azimuth_angles"][row])
            for index, (distance, intensity) in enumerate(pixel(data, start + head + row * SIZES[profile], profile)):
                if distance:
                    length = distance - offset
                    x = length * math.cos(angle) * math.cos(altitude) + offset * math.cos(encoder)
                    y = length * math.sin(angle) * math.cos(altitude) + offset * math.sin(encoder)
                    rotated = matrix[:3, :3] @ (x, y, length * math.sin(altitude)) + matrix[:3, 3] / 1000
                    points.append((*rotated, intensity, row, index + 1))
    return np.array(points)


def decode(packets, path, batch=10_000):
    decoder = Ouster().decoder(packets, DecoderOptions(path))
    frames = []
    for start in range(0, len(packets), batch):
        part = slice(start, start + batch)
        frames += decoder.add(Packets(packets.times_ns[part], packets.payloads[part]))
    return [*frames, *decoder.finish()], decoder.facts


def assert_same(one, two):
    assert [(f.stamp_ns, f.partial) for f in one] == [(f.stamp_ns, f.partial) for f in two]
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a.points, b.points)


@pytest.mark.parametrize("name", CAPTURES)
def test_real_captures_contain_complete_revolutions(name):
    packets = capture(name)
    frames, facts = decode(packets, metadata_path(name))
    assert facts.model == CAPTURES[name][1]
    assert [len(frame.points) for frame in frames] == CAPTURES[name][2]
    assert not any(frame.partial for frame in frames)
    assert facts.lost_packets == facts.bad_packets == 0
    assert facts.warnings == []
    for frame in frames:
        assert abs(frame.stamp_ns - packets.times_ns[-1]) < 10**9
        assert (np.diff(frame.points["timestamp"]) >= 0).all()


@pytest.mark.parametrize("name", CAPTURES)
def test_real_points_agree_with_the_manual(name):
    packets = capture(name)
    first = Packets(packets.times_ns[1:2], packets.payloads[1:2])
    frames, _ = decode(first, metadata_path(name))
    points = frames[0].points
    expected = slow_points(first.payloads[0], metadata_path(name))
    assert len(points) == len(expected) > 100
    assert np.abs(np.stack([points[axis] for axis in "xyz"], 1) - expected[:, :3]).max() < 1e-4
    np.testing.assert_array_equal(points["intensity"], expected[:, 3])
    np.testing.assert_array_equal(points["ring"], expected[:, 4])


@pytest.mark.parametrize("name", CAPTURES)
def test_real_packets_are_recognised(name):
    assert all(Ouster().recognises(payload) for payload in capture(name).payloads)


@pytest.mark.parametrize("batch", [1, 7, 64])
def test_batch_size_does_not_matter_for_real_packets(batch):
    name = "OS-1-128_v2.3.0_1024x10_lb_n3"
    packets = capture(name)
    assert_same(decode(packets, metadata_path(name), batch)[0], decode(packets, metadata_path(name))[0])


@pytest.fixture(params=["flat", "nested"])
def write_metadata(request, tmp_path):
    def write(profile="LEGACY", window=(0, COLUMNS - 1), **changes):
        beams = {"beam_altitude_angles": ALTITUDES, "beam_azimuth_angles": AZIMUTHS}
        beams["lidar_origin_to_beam_origin_mm"] = 15.806
        layout = {"columns_per_frame": COLUMNS, "columns_per_packet": PER_PACKET, "pixels_per_column": ROWS}
        layout |= {"column_window": list(window), "udp_profile_lidar": profile}
        lidar = {"lidar_to_sensor_transform": [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 36.18, 0, 0, 0, 1]}
        info = {"prod_line": "OS-1-16", "prod_sn": "122201000998", "build_rev": "v3.0.1", **changes}
        if request.param == "flat":
            data = {**beams, **lidar, **info, "data_format": layout}
        else:
            data = {"beam_intrinsics": beams, "lidar_intrinsics": lidar, "sensor_info": info}
            data["lidar_data_format"] = layout
        path = tmp_path / "metadata.json"
        path.write_text(json.dumps(data))
        return path

    return write


@cache
def make_packet(profile, frame, first, invalid=(), clock_ns=START_NS):
    """Return one packet of a revolution, in which some pixels have no return."""
    rng = np.random.default_rng(frame * 1000 + first)
    parts = []
    for column in range(first, first + PER_PACKET):
        valid = column not in invalid
        time = clock_ns + (frame * COLUMNS + column) * COLUMN_NS
        pixels = b"".join(make_pixel(profile, rng) for _ in range(ROWS))
        if profile == "LEGACY":
            parts.append(struct.pack("<QHHI", time, column, frame % 65536, 0) + pixels)
            parts.append(struct.pack("<I", 0xFFFFFFFF if valid else 0))
        else:
            parts.append(struct.pack("<QHH", time, column, int(valid)) + pixels)
    if profile == "LEGACY":
        return b"".join(parts)
    serial = (122201000998).to_bytes(5, "little")
    return struct.pack("<HH3s5s20s", 1, frame % 65536, b"abc", serial, b"") + b"".join(parts) + bytes(32)


def make_pixel(profile, rng):
    one, two = (int(value) * int(value > 3000) for value in rng.integers(0, 30000, 2))
    signal = rng.integers(0, 1000, 3).tolist()
    if profile == "RNG15_RFL8_NIR8":
        return struct.pack("<HBB", one | 0x8000, signal[0] % 256, 7)
    if profile == "RNG19_RFL8_SIG16_NIR16_DUAL":
        return struct.pack("<IIHHHH", one | 0xFF080000, two | 0x55000000, signal[0], signal[1], 9, 0)
    spare = 0xFFF00000 if profile == "LEGACY" else 0xFFF80000
    return struct.pack("<IHHHH", one | spare, 255, signal[0], 9, 0)


def make_packets(profile="LEGACY", frames=(0, 1, 2), firsts=range(0, COLUMNS, PER_PACKET), **options):
    made = [(frame, first) for frame in frames for first in firsts]
    payloads = [np.frombuffer(make_packet(profile, *position, **options), np.uint8) for position in made]
    times = [START_NS + (frame * COLUMNS + first + PER_PACKET) * COLUMN_NS + 5000 for frame, first in made]
    return Packets(np.array(times), np.stack(payloads))


def without(packets, *lost):
    keep = np.setdiff1d(np.arange(len(packets)), lost)
    return Packets(packets.times_ns[keep], packets.payloads[keep])


@pytest.mark.parametrize("profile", SIZES)
def test_each_profile_agrees_with_the_manual(profile, write_metadata):
    path = write_metadata(profile)
    packets = make_packets(profile)
    assert Ouster().recognises(packets.payloads[0])
    frames, facts = decode(packets, path)
    assert facts.model == "OS1-16"
    assert [frame.partial for frame in frames] == [False] * 3
    for number, frame in enumerate(frames):
        expected = np.concatenate([slow_points(payload, path) for payload in packets.payloads[4 * number :][:4]])
        found = np.stack([frame.points[axis] for axis in "xyz"], 1)
        assert np.abs(found - expected[:, :3]).max() < 1e-4
        np.testing.assert_array_equal(frame.points["intensity"], expected[:, 3])
        np.testing.assert_array_equal(frame.points["ring"], expected[:, 4])
        if profile.endswith("DUAL"):
            np.testing.assert_array_equal(frame.points["return_number"], expected[:, 5])
        assert frame.stamp_ns == START_NS + (number * COLUMNS + COLUMNS - 1) * COLUMN_NS
    assert ("reflectivity" in facts.details["intensity"]) == (profile == "RNG15_RFL8_NIR8")


def test_lost_packets_are_counted_and_their_revolution_is_not_partial(write_metadata):
    frames, facts = decode(without(make_packets(), 5, 6), write_metadata())
    assert facts.lost_packets == 2
    assert [frame.partial for frame in frames] == [False] * 3


@pytest.mark.parametrize("profile", ["LEGACY", "RNG15_RFL8_NIR8"])
@pytest.mark.parametrize(("frame_id", "batch"), covering((6, 8, 300, 40_000), (1, 3, 100)))
def test_a_damaged_frame_id_loses_one_packet(write_metadata, profile, frame_id, batch):
    """The revolution goes on after it, whatever the id."""
    packets, path = make_packets(profile, frames=(6, 7, 8)), write_metadata(profile)
    expected, _ = decode(without(packets, 5), path)
    at = 10 if profile == "LEGACY" else 2
    packets.payloads[5, at : at + 2] = np.frombuffer(struct.pack("<H", frame_id), np.uint8)
    frames, facts = decode(packets, path, batch)
    assert_same(frames, expected)
    assert (facts.bad_packets, facts.lost_packets) == (1, 1)


def test_late_packets_are_counted(write_metadata):
    packets = make_packets(frames=(6, 7))
    order = [0, 1, 4, 5, 2, 3, 6, 7]
    frames, facts = decode(Packets(packets.times_ns[order], packets.payloads[order]), write_metadata())
    assert len(frames) == 2
    assert (facts.bad_packets, facts.lost_packets) == (2, 2)


def test_lost_revolutions_are_counted(write_metadata):
    assert decode(make_packets(frames=(65534, 65535, 65538)), write_metadata())[1].lost_packets == 8


def test_incomplete_first_and_last_revolutions_are_partial_without_losses(write_metadata):
    frames, facts = decode(without(make_packets(), 0, 11), write_metadata())
    assert [frame.partial for frame in frames] == [True, False, True]
    assert facts.lost_packets == 0


def test_late_and_duplicate_packets_change_nothing(write_metadata):
    packets, path = make_packets(), write_metadata()
    order = np.array([0, 2, 1, 3, 3, 4, 6, 5, 7, 2, 8, 9, 10, 11])
    mixed = Packets(packets.times_ns[order], packets.payloads[order])
    assert_same(decode(mixed, path)[0], decode(packets, path)[0])


def test_invalid_columns_have_no_points(write_metadata):
    frames, _ = decode(make_packets(frames=[0], invalid=range(10, 20)), write_metadata())
    columns = np.rint((frames[0].points["timestamp"] - START_NS / 1e9) / (COLUMN_NS / 1e9)).astype(int)
    assert sorted(set(columns.tolist())) == [*range(10), *range(20, COLUMNS)]


@pytest.mark.parametrize(("window", "firsts"), [((17, 40), (16, 32)), ((50, 10), (0, 48))])
def test_a_revolution_with_a_window_is_complete(window, firsts, write_metadata):
    frames, facts = decode(make_packets(firsts=firsts), write_metadata(window=window))
    assert [frame.partial for frame in frames] == [False] * 3
    assert facts.lost_packets == 0


def test_a_clock_that_starts_at_power_on_is_corrected(write_metadata):
    frames, facts = decode(make_packets(clock_ns=10**9), write_metadata())
    assert "not synchronised" in facts.details["clock"]
    assert [frame.stamp_ns for frame in frames] == [
        START_NS + (number * COLUMNS + COLUMNS) * COLUMN_NS + 5000 for number in range(3)
    ]
    assert all(np.allclose(np.diff(np.unique(f.points["timestamp"])), COLUMN_NS / 1e9, atol=1e-6) for f in frames)


def test_metadata_of_another_sensor_is_reported(write_metadata):
    packets = make_packets("RNG15_RFL8_NIR8")
    facts = decode(packets, write_metadata("RNG15_RFL8_NIR8", prod_sn="1"))[1]
    assert "122201000998" in facts.warnings[0]
    with pytest.raises(InputError, match="pass the metadata of this sensor"):
        Ouster().decoder(packets, DecoderOptions(write_metadata("LEGACY")))


def test_missing_metadata_is_an_error():
    with pytest.raises(InputError, match=r"--calibration METADATA\.json"):
        Ouster().decoder(make_packets(), DecoderOptions())


def test_an_unknown_profile_is_an_error(write_metadata):
    with pytest.raises(InputError, match=r"FUSA.*supported: LEGACY"):
        Ouster().decoder(make_packets(), DecoderOptions(write_metadata("FUSA_RNG15_RFL8_NIR8_DUAL")))


@pytest.mark.parametrize(
    "text",
    [
        *("", "[]", "{", "null", "{}", "[" * 100_000),
        *('{"beam_altitude_angles": [1e999]}', '{"beam_altitude_angles": ["a"]}'),
        '{"beam_altitude_angles": [1], "beam_azimuth_angles": [1, 2], "lidar_mode": "1024x10"}',
        '{"beam_altitude_angles": [1], "beam_azimuth_angles": [1], "lidar_mode": "7x10"}',
        '{"beam_altitude_angles": [1], "beam_azimuth_angles": [1], "data_format": {"columns_per_frame": 1e999}}',
    ],
)
def test_broken_metadata_is_an_error(text, tmp_path):
    path = tmp_path / "broken.json"
    path.write_text(text)
    with pytest.raises(InputError, match="not valid Ouster metadata"):
        parse_metadata(path.read_bytes(), str(path))


def test_metadata_of_the_first_firmware_has_no_data_format(tmp_path):
    path = tmp_path / "old.json"
    beams = {"beam_altitude_angles": [1.0] * 64, "beam_azimuth_angles": [0.0] * 64}
    path.write_text(json.dumps({**beams, "lidar_mode": "2048x10", "prod_line": "OS-1-64"}))
    metadata = parse_metadata(path.read_bytes(), str(path))
    assert (metadata.model, metadata.columns, metadata.profile) == ("OS1-64", 2048, "LEGACY")


@settings(max_examples=50, deadline=None)
@given(st.data())
def test_broken_bytes_raise_no_error_and_batch_size_does_not_matter(data):
    profile = data.draw(st.sampled_from(sorted(SIZES)))
    packets = make_packets(profile)
    payloads = packets.payloads.copy()
    for _ in range(data.draw(st.integers(1, 12))):
        packet = data.draw(st.integers(0, len(payloads) - 1))
        start = data.draw(st.one_of(st.integers(0, 60), st.integers(0, payloads.shape[1] - 1)))
        found = data.draw(st.binary(min_size=1, max_size=12))
        end = min(start + len(found), payloads.shape[1])
        payloads[packet, start:end] = np.frombuffer(found, np.uint8)[: end - start]
    broken = Packets(packets.times_ns, payloads)
    path = broken_metadata(profile)
    frames, facts = decode(broken, path)
    assert_same(frames, decode(broken, path, data.draw(st.integers(1, 5)))[0])
    assert 0 <= facts.bad_packets <= len(payloads)
    for frame in frames:
        assert np.isfinite(frame.points["x"]).all()
        assert abs(frame.stamp_ns - START_NS) < 10**18


@cache
def broken_metadata(profile):
    beams = {"beam_altitude_angles": ALTITUDES, "beam_azimuth_angles": AZIMUTHS}
    layout = {"columns_per_frame": COLUMNS, "columns_per_packet": PER_PACKET, "udp_profile_lidar": profile}
    path = Path(mkdtemp()) / "metadata.json"
    path.write_text(json.dumps({**beams, "data_format": layout}))
    return path


def test_imu_packets_are_not_counted_as_invalid(write_metadata):
    decoder = Ouster().decoder(make_packets(), DecoderOptions(write_metadata()))
    assert list(decoder.add(Packets(np.zeros(3, np.int64), np.zeros((3, 48), np.uint8)))) == []
    assert decoder.facts.bad_packets == 0


def test_revolutions_follow_one_another(write_metadata):
    frames, _ = decode(make_packets(frames=range(5)), write_metadata())
    assert all(one.stamp_ns < two.points["timestamp"][0] * 1e9 + 1000 for one, two in pairwise(frames))


@pytest.mark.parametrize(
    ("before", "place", "after", "expected"),
    [
        (7.3, 8.0, 8.1, False),
        (7.0, 8.0, 9.0, False),
        (7.0, 9.0, 12.0, False),
        (65535.3, 0.0, 0.1, False),
        (6.3, 7.0, 6.1, False),
        (7.1, 300.2, 7.3, True),
        (7.3, 300.0, 8.1, True),
        (7.2, 300.3, 8.0, True),
        (65535.3, 300.0, 0.1, True),
        (8.0, 7.1, 8.2, True),
        (8.0, 9.1, 8.2, True),
        (7.2, 8.0, 7.3, True),
        (7.0, 300.1, 301.2, False),
    ],
)
def test_damaged_frame_ids(before, place, after, expected):
    """A place is a frame id and a number in its revolution of four packets."""
    before, place, after = (int(value) * 4 + round(value % 1 * 10) for value in (before, place, after))
    assert _is_damaged(place, after, before=before, per_revolution=4) == expected
