"""Velodyne decoder, on synthetic packets of known geometry, real packets decoded by Nebula, and broken packets."""

import re
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaclutter_cli.errors import InputError, MissingExtraError
from seaclutter_cli.sensors.packets import DecoderOptions, Packets, point_dtype
from seaclutter_cli.sensors.velodyne.decoder import MODELS, PACKET, Velodyne
from tests.paths import shared

vd = pytest.importorskip("velodyne_decoder")

START = 1_700_000_000 * 10**9
SINGLE, LAST, DUAL = 0x37, 0x38, 0x39
VLP16, VLP32C, VLP32AB, HDL32E, ALPHA_PRIME = 0x22, 0x28, 0x23, 0x21, 0xA1
STEP = 40
"""Azimuth step between blocks in 0.01°, of a VLP-16 at 10 Hz."""


def make_packets(count, *, model=VLP16, mode=SINGLE, first=0, step=STEP, period_us=1327.104, clock_s=0.0):
    """Return packets of an evenly rotating sensor inside a wall at 10 m; second returns are at 5 m."""
    packets = np.zeros(count, PACKET)
    pairs = 2 if mode == DUAL else 1
    banks = MODELS[model].banks
    blocks = np.arange(12) // (banks * pairs)
    columns = 12 // (banks * pairs)  # an Alpha Prime with dual returns leaves four blocks empty
    azimuths = first + step * (np.arange(count)[:, None] * columns + blocks)
    packets["blocks"]["azimuth"] = azimuths % 36000
    packets["blocks"]["bank"] = np.array([0xEEFF, 0xDDFF, 0xCCFF, 0xBBFF])[np.arange(12) // pairs % banks]
    channels = np.zeros((count, 12, 32), [("distance", "<u2"), ("intensity", "u1")])
    channels["distance"] = 5000 if model in (VLP16, HDL32E) else 2500
    if mode == DUAL:
        channels["distance"][:, 1::2] //= 2
    channels["intensity"] = np.arange(32)
    packets["blocks"]["channels"] = channels.view("V96")[..., 0]
    times_ns = START + (np.arange(count) * period_us / (3 if banks > 1 and pairs > 1 else pairs) * 1000).astype(int)
    packets["time_us"] = (times_ns // 1000 + int(clock_s * 1e6)) % 3_600_000_000
    packets["mode"], packets["model"] = mode, model
    return Packets(times_ns, packets.view(np.uint8).reshape(count, -1).copy())


def decode(packets, *, size=None, options=None):
    """Return frames and facts of packets that are added in batches."""
    decoder = Velodyne().decoder(packets, options or DecoderOptions())
    size = size or len(packets)
    batches = [take(packets, slice(start, start + size)) for start in range(0, len(packets), size)]
    frames = [frame for batch in batches for frame in decoder.add(batch)] + list(decoder.finish())
    return frames, decoder.facts


def take(packets, chosen):
    return Packets(packets.times_ns[chosen], packets.payloads[chosen])


def azimuth_deg(points):
    return np.degrees(np.arctan2(-points["y"], points["x"])) % 360


def positions(points):
    return np.stack([points[axis].astype(float) for axis in "xyz"], axis=1)


def test_points_have_the_position_ring_time_and_intensity_of_their_firing():
    frames, facts = decode(make_packets(30, first=18000))
    assert [frame.partial for frame in frames] == [True]
    points = frames[0].points
    assert points.dtype == point_dtype()
    assert len(points) == 30 * 12 * 32
    elevation = np.degrees(np.arctan2(points["z"], np.hypot(points["x"], points["y"])))
    assert np.abs(elevation - (2.0 * points["ring"] - 15)).max() < 0.1
    assert np.abs(np.linalg.norm(positions(points), axis=1) - 10).max() < 0.02
    seconds = points["timestamp"] - START / 1e9
    assert np.abs(180 + seconds / 110.592e-6 * STEP / 100 - azimuth_deg(points)).max() < 0.02
    assert (points["intensity"][:32] == np.arange(32)).all()
    assert points["ring"][:4].tolist() == [0, 8, 1, 9]
    assert facts.model == "VLP-16"
    assert facts.details == {"clock": "sensor time, consistent with the recording time", "return mode": "strongest"}
    assert (facts.lost_packets, facts.bad_packets) == (0, 0)


def test_revolutions_are_split_at_azimuth_0_within_packets():
    frames, _ = decode(make_packets(200, first=30000))
    assert [frame.partial for frame in frames] == [True, False, False, True]
    assert [len(frame.points) for frame in frames[1:3]] == [900 * 32] * 2
    assert all(azimuth_deg(frame.points)[0] < 0.05 for frame in frames[1:])
    for frame in frames:
        assert frame.stamp_ns == pytest.approx(frame.points["timestamp"][-1] * 1e9, abs=300)
    stamps = np.concatenate([frame.points["timestamp"] for frame in frames])
    assert (np.diff(stamps) >= 0).all()


@pytest.mark.parametrize("size", [1, 7, 75, 1000])
def test_batch_size_does_not_matter(size):
    packets = make_packets(300, first=1234)
    expected, facts = decode(packets)
    frames, other = decode(packets, size=size)
    assert facts == other
    assert [(frame.stamp_ns, frame.partial) for frame in frames] == [(f.stamp_ns, f.partial) for f in expected]
    assert all((frame.points == other.points).all() for frame, other in zip(frames, expected, strict=True))


@pytest.mark.parametrize(
    ("model", "mode", "period_us", "step", "points"),
    [
        (VLP16, DUAL, 1327.104, 40, 900 * 64),
        (VLP32C, SINGLE, 663.552, 20, 1800 * 32),
        (VLP32C, DUAL, 663.552, 20, 1800 * 64),
        (HDL32E, LAST, 552.96, 20, 1800 * 32),
        (HDL32E, DUAL, 552.96, 20, 1800 * 64),
    ],
)
def test_models_and_returns(model, mode, period_us, step, points):
    frames, facts = decode(make_packets(1000, model=model, mode=mode, period_us=period_us, step=step, first=180))
    assert {len(frame.points) for frame in frames[1:-1]} == {points}
    assert (facts.model, facts.lost_packets, facts.bad_packets) == (MODELS[model].name, 0, 0)
    frame = frames[1].points
    assert frame.dtype == point_dtype(returns=mode == DUAL)
    if mode == DUAL:
        near = np.linalg.norm(positions(frame), axis=1) < 7
        assert (frame["return_number"] == np.where(near, 1, 2)).all()


@pytest.mark.parametrize("mode", [SINGLE, DUAL])
def test_an_alpha_prime_is_split_between_packets(mode):
    packets = make_packets(4000, model=ALPHA_PRIME, mode=mode, period_us=173.4, step=20)
    if mode == DUAL:  # its last four blocks are empty
        packets.payloads[:, 800:1200] = 0
    frames, facts = decode(packets)
    assert (facts.model, facts.lost_packets, facts.bad_packets) == ("Alpha Prime", 0, 0)
    assert len(frames) >= 3
    assert all(abs(len(frame.points) - 1800 * 128 * (2 if mode == DUAL else 1)) <= 3 * 128 for frame in frames[1:-1])
    assert frames[1].points["ring"].max() == 127


def test_a_blind_sector_is_not_a_loss_and_revolutions_are_split_in_it():
    packets = make_packets(600, first=27000)
    ahead = packets.payloads.view(PACKET)["blocks"]["azimuth"][:, 0, 0]
    seen = (ahead >= 27000) | (ahead < 9000)
    frames, facts = decode(take(packets, seen))
    assert facts.lost_packets == 0
    assert facts.details["field of view"].startswith("270° to 9")
    assert [frame.partial for frame in frames] == [False] * len(frames)
    assert all(0.04 < np.ptp(frame.points["timestamp"]) < 0.06 for frame in frames)


def test_a_blind_sector_within_a_packet_is_not_rotation():
    packets = make_packets(300, first=27000)
    rows = packets.payloads.view(PACKET)[:, 0]
    flat = rows["blocks"].reshape(-1)
    flat = flat[(flat["azimuth"] >= 27000 + 6 * STEP) | (flat["azimuth"] < 9000)]
    rows = rows[: len(flat) // 12].copy()
    rows["blocks"] = flat[: len(rows) * 12].reshape(-1, 12)
    frames, _ = decode(Packets(packets.times_ns[: len(rows)], rows.view(np.uint8).reshape(len(rows), -1)))
    for frame in frames[1:-1]:
        degrees = azimuth_deg(frame.points)
        assert ((degrees > 272) | (degrees < 90.5)).all()


def test_lost_packets_are_counted():
    packets = make_packets(300)
    keep = ~np.isin(np.arange(300), [10, 11, 12, 150])
    frames, facts = decode(take(packets, keep), size=20)
    assert facts.lost_packets == 4
    assert sum(len(frame.points) for frame in frames) == 296 * 12 * 32


def test_a_pause_ends_a_revolution():
    packets = make_packets(300, first=100)
    packets.times_ns[100:] += 2 * 10**9
    packets.payloads.view(PACKET)["time_us"][100:] += 2_000_000
    frames, _ = decode(packets)
    assert [frame.partial for frame in frames] == [False, True, True, False, False, True]
    assert all(np.ptp(frame.points["timestamp"]) < 0.11 for frame in frames)


def test_a_sensor_that_does_not_rotate_gives_frames():
    frames, _ = decode(make_packets(2000, step=0))
    assert all(frame.partial for frame in frames)
    assert max(np.ptp(frame.points["timestamp"]) for frame in frames) <= 0.51


@pytest.mark.parametrize("clock_s", [-1700, -5, 300, 1799])
def test_a_clock_that_is_not_set_is_shifted_to_the_recording_time(clock_s):
    frames, facts = decode(make_packets(100, clock_s=clock_s))
    assert facts.details["clock"] == "sensor time, shifted to the recording time"
    assert frames[0].points["timestamp"][0] == pytest.approx(START / 1e9, abs=1e-4)


def test_the_sensor_time_may_be_in_the_next_hour():
    packets = make_packets(100, clock_s=3600 - 1_700_000_000 % 3600)
    packets = Packets(packets.times_ns + (3600 - 1_700_000_000 % 3600) * 10**9 - 10**6, packets.payloads)
    frames, facts = decode(packets)
    assert facts.details["clock"] == "sensor time, consistent with the recording time"
    assert frames[0].points["timestamp"][0] % 3600 < 0.001


def test_invalid_packets_are_counted_and_position_packets_are_not():
    packets = make_packets(100)
    packets.payloads[5, 0] = 0
    packets.payloads[6, 2:4] = 255
    packets.payloads[7, 1204] = 0
    packets.payloads[8, 1205] = VLP32C
    decoder = Velodyne().decoder(packets, DecoderOptions())
    frames = [*decoder.add(packets), *decoder.add(Packets(packets.times_ns[:3], np.zeros((3, 512), np.uint8)))]
    frames += [*decoder.add(Packets(packets.times_ns[:2], np.zeros((2, 99), np.uint8))), *decoder.finish()]
    assert decoder.facts.bad_packets == 6
    assert sum(len(frame.points) for frame in frames) == 96 * 12 * 32


def test_packets_are_recognised():
    good = make_packets(1).payloads[0]
    assert Velodyne().recognises(good)
    for index, value in ((0, 0), (1204, 0x40), (1205, 0x99)):
        bad = good.copy()
        bad[index] = value
        assert not Velodyne().recognises(bad)
    assert not Velodyne().recognises(good[:1200])
    assert not Velodyne().recognises(np.zeros(512, np.uint8))
    with pytest.raises(InputError, match="not from a supported Velodyne sensor"):
        Velodyne().decoder(Packets(np.zeros(1, int), np.zeros((1, 512), np.uint8)), DecoderOptions())


def test_an_ambiguous_model_is_an_error():
    packets = make_packets(10, model=VLP32AB)
    with pytest.raises(InputError, match="--sensor"):
        Velodyne().decoder(packets, DecoderOptions())
    for name in ("VLP-32A", "VLP-32B"):
        assert decode(packets, options=DecoderOptions(model=name))[1].model == name


def test_a_calibration_file(tmp_path):
    packets, path = make_packets(100), tmp_path / "unit.yaml"
    calibration = vd.Calibration.default_calibs[vd.Model.VLP16]
    path.write_text(re.sub(r"rot_correction: 0\b", "rot_correction: 0.1", calibration.to_string()))
    (frame, _), _ = decode(packets, options=DecoderOptions(calibration=path))
    (usual, _), _ = decode(packets)
    shift = (azimuth_deg(usual.points) - azimuth_deg(frame.points) + 180) % 360 - 180
    assert np.abs(shift - np.degrees(0.1)).max() < 0.01
    vd.Calibration.default_calibs[vd.Model.VLP32C].write(str(path))
    with pytest.raises(InputError, match="32 lasers, the VLP-16 has 16"):
        decode(packets, options=DecoderOptions(calibration=path))
    for text in ("", "lasers: 3", ": : :"):
        path.write_text(text)
        with pytest.raises(InputError, match=r"unit\.yaml"):
            decode(packets, options=DecoderOptions(calibration=path))


def test_the_unit_of_distances_is_that_of_the_model(tmp_path):
    """The VLS128.yaml of the ROS drivers states 7 mm, which the drivers ignore; packets have 4 mm."""
    packets, path = make_packets(400, model=ALPHA_PRIME, period_us=173.4, step=20), tmp_path / "VLS128.yaml"
    text = vd.Calibration.default_calibs[vd.Model.VLS128].to_string()
    path.write_text(re.sub("distance_resolution: .*", "distance_resolution: 0.007", text))
    given, usual = decode(packets, options=DecoderOptions(calibration=path))[0], decode(packets)[0]
    np.testing.assert_array_equal(given[0].points, usual[0].points)


def test_a_missing_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "velodyne_decoder", None)
    with pytest.raises(MissingExtraError, match=re.escape("seaclutter[velodyne]")):
        decode(make_packets(10))


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_broken_packets_are_counted_and_raise_no_error(data):
    packets = make_packets(90, model=data.draw(st.sampled_from([VLP16, VLP32C, ALPHA_PRIME])), period_us=1000, first=99)
    flat = packets.payloads.reshape(-1)
    noise = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    for _ in range(data.draw(st.integers(1, 40))):
        start = noise.integers(len(flat))
        flat[start : start + noise.integers(1, 200)] = noise.integers(256)
    packets.times_ns[noise.integers(90)] += noise.integers(-(10**12), 10**12)
    try:
        decoder = Velodyne().decoder(packets, DecoderOptions())
    except InputError:
        return
    frames = [*decoder.add(packets), *decoder.finish()]
    assert 0 <= decoder.facts.bad_packets <= 90
    assert all(np.isfinite(positions(frame.points)).all() for frame in frames)


def nebula(name):
    """Return packets of a real recording, and a frame that Nebula decoded from it, shape (N, 3)."""
    from pypcd4 import PointCloud

    from seaclutter_cli.sources.rosbag2.db3 import Db3Source
    from seaclutter_cli.sources.shared.packet_messages import read_packets

    folder = shared(f"nebula/{name}")
    source = Db3Source(next(folder.glob("*.db3")))
    runs = [run for message in source.records() for run in read_packets(message).packets]
    source.close()
    packets = Packets(*(np.concatenate([getattr(run, key) for run in runs]) for key in ("times_ns", "payloads")))
    return packets, positions(PointCloud.from_path(next(folder.glob("*.pcd"))).pc_data)


def as_nebula(points, model, *, pairs):
    """Return points as Nebula computes them from the manuals, shape (N, 3).

    Nebula ignores the vertical offsets of the lasers, and fires the lasers of a VLP-32C one by one instead of two at a
    time. It does not interpolate the azimuth in the last block of a packet; these points, one in twelve or six, remain
    up to 0.3° apart.
    """
    text = vd.Calibration.default_calibs[model].to_string()
    elevation, offset = (
        np.array(re.findall(rf"{key}: (\S+)", text), float) for key in ("vert_correction", "vert_offset_correction")
    )
    laser = np.argsort(elevation)[points["ring"]]
    rotation = np.radians(0.199 * 2.304 / 55.296) * (laser - laser // 2) * pairs
    angle = np.arctan2(-points["y"], points["x"]) + rotation
    distance = np.hypot(points["x"], points["y"]).astype(float)
    return np.stack([distance * np.cos(angle), -distance * np.sin(angle), points["z"] - offset[laser]], axis=1)


@pytest.mark.parametrize(
    ("name", "model", "number", "apart", "explained"),
    [("vlp16", "VLP16", 3, 0.15, 0.042), ("vlp32", "VLP32C", 0, 0.27, 0.023)],
)
def test_a_real_frame_agrees_with_nebula(name, model, number, apart, explained):
    from scipy.spatial import cKDTree

    packets, expected = nebula(name)
    frames, facts = decode(packets, size=100)
    assert (facts.lost_packets, facts.bad_packets) == (0, 0)
    assert [frame.partial for frame in frames] == [False] * (len(frames) - 1) + [True]
    points = frames[number].points
    assert abs(len(points) - len(expected)) < 50
    distance, _ = cKDTree(positions(points)).query(expected)
    assert np.median(distance) < 0.007
    assert (distance > 0.01).mean() < apart
    moved = as_nebula(points, getattr(vd.Model, model), pairs=name == "vlp32")
    distance, _ = cKDTree(moved).query(expected)
    assert np.median(distance) < 0.001
    assert (distance > 0.01).mean() < explained


def test_a_real_sensor_with_a_blind_sector():
    packets, _ = nebula("vlp32")
    frames, facts = decode(packets)
    assert facts.details["field of view"] == "270° to 91°"
    for frame in frames:
        degrees = azimuth_deg(frame.points)
        assert ((degrees > 265) | (degrees < 96)).all()
        assert (np.diff(frame.points["timestamp"]) >= 0).all()
        assert np.ptp(frame.points["timestamp"]) < 0.0504
