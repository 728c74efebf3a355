"""RoboSense decoder, compared with a slow one written only from the packet description."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaclutter_cli.errors import InputError
from seaclutter_cli.sensors.packets import DecoderOptions, Packets
from seaclutter_cli.sensors.robosense.decoder import RoboSense, steps
from seaclutter_cli.sensors.robosense.device import find_device, packet_angles
from seaclutter_cli.sensors.robosense.models import BPEARL_4, MODELS, with_old_firmware
from seaclutter_cli.sensors.robosense.packets import Columns, make_angles, temperature_degc
from tests.pairs import covering
from tests.sensors.robosense.packets import write_data, write_info
from tests.sensors.robosense.reference import Reference

START_NS = 1_760_000_000 * 10**9
NAMES = (
    "RS-LiDAR-32",
    "RS-LiDAR-16",
    "RS-Helios",
    "RS-Helios-16P",
    "RS-Bpearl",
    "RS-Ruby",
    "RS-Ruby-80",
    "RS-Ruby-48",
    "RS-Ruby-Plus-48",
    "RS-Airy",
    "RS-Airy-48",
)
DUAL_MODES = {"RS-Ruby": 3, "RS-Ruby-80": 3, "RS-Ruby-48": 3, "RS-Ruby-Plus-48": 4}


def angles_of(model, seed=3):
    random = np.random.default_rng(seed)
    if model.lasers == 16:
        return make_angles(np.arange(-15, 17, 2) * 100, np.zeros(16, np.int64))
    vertical = random.permutation(np.arange(32) * 125 - 2500)
    if model.name == "RS-Bpearl":
        vertical = random.permutation(np.arange(32) * 281 + 231)
    if model.lasers > 32:
        vertical = random.permutation(np.arange(model.lasers) * 31 - 2500)
    return make_angles(vertical, random.integers(-910, 910, len(vertical)))


def columns_of(model, azimuth, seed=0, period_ns=None, missing=0.3):
    """Return columns of random distances, in packets without gaps."""
    random = np.random.default_rng(seed)
    azimuth = np.asarray(azimuth) % 36000
    distance = random.uniform(0.2, model.range_m[1] * 1.02, (len(azimuth), model.channels))
    distance[random.random(distance.shape) < missing] = 0
    intensity = random.integers(0, 256, distance.shape)
    times = START_NS + np.arange(len(azimuth) // model.blocks) * (period_ns or model.packet_ns)
    return Columns(azimuth, distance, intensity, times)


def decode(payloads, times_ns, info, options=None, batch=None):
    """Return the decoder and its frames."""
    payloads = np.asarray(payloads, np.uint8)
    first, options = payloads[:64], options or DecoderOptions()
    if info is not None and len(info) != payloads.shape[1]:
        options = replace(options, info=info[None])
    elif info is not None:
        first = np.concatenate([info[None], first])
    times = np.concatenate([[0] * (len(first) - len(payloads[:64])), times_ns[:64]]).astype(np.int64)
    decoder = RoboSense().decoder(Packets(times, first), options)
    frames = []
    for begin in range(0, len(payloads), batch or len(payloads)):
        part = slice(begin, begin + (batch or len(payloads)))
        frames += decoder.add(Packets(np.asarray(times_ns[part], np.int64), payloads[part]))
    return decoder, [*frames, *decoder.finish()]


def reference_of(name, angles, payloads, **options):
    reference = Reference(name, angles.vertical, angles.horizontal, **options)
    for payload in payloads:
        reference.add(payload.tobytes())
    reference.finish()
    return reference.frames


def assert_same(frames, expected):
    assert len(frames) == len(expected)
    for frame, (points, end) in zip(frames, expected, strict=True):
        assert len(frame.points) == len(points)
        names = ("x", "y", "z", "intensity", "ring", "timestamp", "return_number")
        for name, column in zip(names, zip(*points, strict=True), strict=True):
            if name == "timestamp":
                assert np.abs(frame.points[name] - column).max() < 5e-7
            elif name in frame.points.dtype.names:
                np.testing.assert_array_equal(frame.points[name], column)
        assert abs(frame.stamp_ns - end * 1e9) < 500


WRAPS = {
    "inside a packet": np.arange(96) * 20 + 35100,
    "at its edge": np.arange(96) * 20 + 36000 - 48 * 20,
    "blind sector": np.r_[np.arange(50) * 20 + 34000, np.arange(46) * 20 + 500],
    "uneven": np.cumsum(np.random.default_rng(1).integers(15, 26, 96)) + 35000,
}


@pytest.mark.parametrize("dual", [False, True])
@pytest.mark.parametrize(("name", "wrap"), covering(NAMES, WRAPS))
def test_agrees_with_the_reference(name, dual, wrap):
    model = MODELS[name]
    azimuth = WRAPS[wrap]
    if dual and model.lasers > 16:
        azimuth = np.repeat(azimuth[::2], 2)
    fov = (500, 35000)
    mode = DUAL_MODES.get(name, 0) if dual else 5 if "Hel" in name else 1
    info = write_info(model, angles_of(model), fov=fov, return_mode=mode)
    columns = columns_of(model, azimuth)
    payloads = write_data(model, columns)
    if name.startswith("RS-Airy"):
        info[289], payloads[:, 17], payloads[:, 32] = 0, 3 * dual, 2 if name == "RS-Airy" else 1
    options = DecoderOptions(model=name) if "Ruby" in name else None
    decoder, frames = decode(payloads, columns.times_ns + 700_000, info, options, batch=3)
    assert_same(frames, reference_of(name, angles_of(model), payloads, dual=dual, fov=fov))
    assert len(frames) == 2
    assert decoder.facts.model == name
    assert ("decoder" in decoder.facts.details) == (name not in NAMES[:3])
    assert ("return_number" in frames[0].points.dtype.names) == dual
    assert decoder.facts.bad_packets == 0


@pytest.mark.parametrize("name", ["RS-Ruby-Plus", "RS-Ruby-Plus-80", "RS-Ruby-Plus-48"])
@pytest.mark.parametrize("dual", [False, True])
def test_versions_with_two_returns_in_several_modes(name, dual):
    model, azimuth = MODELS[name], np.repeat(np.arange(48) * 20, 2)
    columns = columns_of(model, azimuth)
    info = write_info(model, angles_of(model), return_mode=5 if dual else 2)
    decoder, frames = decode(write_data(model, columns), columns.times_ns, info, DecoderOptions(model=name))
    assert decoder.facts.details["return mode"] == ("dual" if dual else "single (mode 2)")
    assert ("return_number" in frames[0].points.dtype.names) == dual
    times = np.unique(np.concatenate([frame.points["timestamp"] for frame in frames]))
    assert times[0] == pytest.approx(START_NS / 1e9, abs=2e-6)


def test_an_upside_down_bpearl_is_mirrored():
    model = MODELS["RS-Bpearl"]
    columns = columns_of(model, np.arange(96) * 20)
    info = write_info(model, angles_of(model), is_reversed=True)
    payloads = write_data(model, columns)
    _, frames = decode(payloads, columns.times_ns, info)
    assert_same(frames, reference_of(model.name, angles_of(model), payloads, reverse=True))


def test_the_fourth_version_of_the_bpearl():
    columns = columns_of(BPEARL_4, np.arange(96) * 20)
    payloads = write_data(BPEARL_4, columns)
    payloads[:, 31:33] = 3, 4
    decoder, frames = decode(payloads, columns.times_ns, write_info(BPEARL_4, angles_of(BPEARL_4)))
    assert decoder.facts.model == "RS-Bpearl"
    assert_same(frames, reference_of("fourth RS-Bpearl", angles_of(BPEARL_4), payloads))


@pytest.mark.parametrize(("mounting", "second_us"), [(0, 5.712), (1, 11.424), (2, 7.616), (0xFF, 7.616)])
def test_the_airy_fires_by_its_mounting(mounting, second_us):
    model = MODELS["RS-Airy"]
    columns = columns_of(model, np.arange(96) * 40)
    columns = replace(columns, distance_m=np.full((96, 96), 20.0))
    info = write_info(model, angles_of(model))
    info[289] = mounting
    _, frames = decode(write_data(model, columns), columns.times_ns, info)
    times = frames[0].points["timestamp"][:16] - START_NS / 1e9
    np.testing.assert_allclose(times, np.repeat([0, second_us * 1e-6], 8), atol=1e-6)


def test_an_airy_with_192_lasers_is_not_supported():
    model = MODELS["RS-Airy"]
    columns = columns_of(model, np.arange(96) * 40)
    payloads = write_data(model, columns)
    payloads[:, 32] = 3
    with pytest.raises(InputError, match="with 192 lasers are not supported; record the"):
        decode(payloads, columns.times_ns, write_info(model, angles_of(model)))


def test_the_80v_fires_in_fours():
    model = MODELS["RS-Ruby-Plus-80"]
    columns = columns_of(model, np.arange(96) * 20)
    columns = replace(columns, distance_m=np.full((96, 80), 20.0))
    payloads = write_data(model, columns)
    payloads[:, 31] = 3
    _, frames = decode(
        payloads, columns.times_ns, write_info(model, angles_of(model)), DecoderOptions(model=model.name)
    )
    times = np.round((frames[0].points["timestamp"][:80] - START_NS / 1e9) * 1e6, 1)
    assert np.bincount(np.unique(times, return_inverse=True)[1]).tolist() == [4] * 20


@pytest.mark.parametrize(
    ("name", "others"), [(name, name.replace("Ruby", "Ruby-Plus")) for name in ("RS-Ruby", "RS-Ruby-80", "RS-Ruby-48")]
)
def test_models_that_packets_do_not_tell_apart(name, others):
    model = MODELS[name]
    columns = columns_of(model, np.arange(96) * 20)
    with pytest.raises(InputError, match=f"{name} and {others} share a packet format: select one with --sensor"):
        decode(write_data(model, columns), columns.times_ns, write_info(model, angles_of(model)))


@pytest.mark.parametrize("batch", [1, 2, 5, 8])
def test_batch_size_does_not_matter(batch):
    model = MODELS["RS-LiDAR-32"]
    columns = columns_of(model, np.arange(96) * 900)
    payloads, info = write_data(model, columns), write_info(model, angles_of(model))
    _, whole = decode(payloads, columns.times_ns, info)
    _, parts = decode(payloads, columns.times_ns, info, batch=batch)
    assert [frame.stamp_ns for frame in whole] == [frame.stamp_ns for frame in parts]
    for one, other in zip(whole, parts, strict=True):
        np.testing.assert_array_equal(one.points, other.points)


@pytest.mark.parametrize(("batch", "per_turn"), [(1, 20), (3, 20), (7, 600)])
def test_a_revolution_is_complete_with_the_first_packet_of_the_next(batch, per_turn):
    """Also if there are more packets than wait for each other, and if invalid blocks hide where it begins."""
    model = MODELS["RS-LiDAR-32"]
    azimuth = np.repeat(np.arange(3 * per_turn) % per_turn * (35000 // per_turn), model.blocks)
    columns = columns_of(model, azimuth, missing=0.99)
    payloads, info = write_data(model, columns), write_info(model, angles_of(model))
    damaged = [number for number in range(len(payloads)) if number % per_turn in (0, 5, 7)]
    payloads[damaged, 42:44] = 0
    decoder = RoboSense().decoder(Packets(columns.times_ns[:2], np.stack([info, payloads[1]])), DecoderOptions())
    ends = []
    for begin in range(0, len(payloads), batch):
        part = slice(begin, begin + batch)
        ends += [begin] * len(list(decoder.add(Packets(columns.times_ns[part], payloads[part]))))
    assert ends == [turn * per_turn + 1 - (turn * per_turn + 1) % batch for turn in (1, 2)]
    assert len(list(decoder.finish())) == 1
    assert decoder.facts.bad_packets == len(damaged)


@pytest.mark.parametrize("name", NAMES[:4])
def test_points_within_half_a_unit_and_a_hundredth_of_a_degree(name):
    model, angles = MODELS[name], angles_of(MODELS[name])
    firings = 32 // model.lasers
    columns = columns_of(model, np.arange(1800) * 20 * firings)
    distance = np.random.default_rng(5).uniform(10, 100, (1800, 32))
    _, frames = decode(
        write_data(model, replace(columns, distance_m=distance)), columns.times_ns, write_info(model, angles)
    )
    points = np.concatenate([frame.points for frame in frames])
    assert len(points) == distance.size
    rotated = columns.azimuth[:, None] + 20 * firings * model.channel_ns(dual=False) / (firings * model.block_ns)
    lens = model.lens_m[0] * np.exp(-1j * np.radians(rotated / 100))
    position = (points["x"] + 1j * points["y"]).reshape(-1, 32) - lens
    z = points["z"].reshape(-1, 32).astype(float) - np.float32(model.lens_m[1])
    assert np.abs(np.hypot(np.abs(position), z) - distance).max() <= model.unit_m / 2 + 2e-5
    side = np.exp(-1j * np.radians((rotated + angles.horizontal) / 100))
    assert np.abs(np.degrees(np.angle(position / side))).max() <= 0.01 + 1e-4, (
        "the lens offset follows the rounded azimuth"
    )
    assert np.abs(np.degrees(np.arctan2(z, np.abs(position))) - angles.vertical / 100).max() <= 0.0001
    expected_ns = np.repeat(columns.times_ns, 12) + np.arange(1800) % 12 * firings * model.block_ns
    times = (expected_ns[:, None] + model.channel_ns(dual=False)).ravel() / 1e9
    assert np.abs(points["timestamp"] - times).max() < 1.5e-6, "packets contain whole microseconds"


def test_temperatures_have_a_sign_and_sixteenths():
    assert temperature_degc(0x18, 0x81, big_endian=False) == -2.1875
    assert temperature_degc(0x18, 0x81, big_endian=True) == 24.5


def test_values_of_the_vendors_own_tests():
    model = MODELS["RS-LiDAR-32"]
    info = write_info(model, angles_of(model))
    info[468:474] = 1, 0x28, 0x29, 0, 0x09, 0x1D
    columns = columns_of(model, np.r_[1, 21, 51, np.full(9, 51)])
    payload = write_data(model, columns)[0]
    payload[38:40] = 0x18, 0x01
    payload[46:49] = 0x03, 0xE8, 7
    decoder, (frame,) = decode(payload[None], columns.times_ns, info)
    first = frame.points[0]
    assert first["z"] == np.float32(5.0) * np.float32(np.sin(np.radians(-10.28)))
    assert first["intensity"] == 7
    assert decoder.facts.details["temperature"] == "2.2 °C at the start"
    assert list(packet_angles(model, info).vertical[:2]) == [-1028, 233]
    device, _ = find_device(model, payload[None], info[None], DecoderOptions(), [])
    step, _ = steps(np.array([[1, 21, 51, *[76] * 9]]), np.zeros((1, 12), bool), replace(device, rotation_hz=12))
    assert list(step[0, :3]) == [20, 30, 25]


def test_lost_packets_are_counted_and_shorten_the_revolution():
    model = MODELS["RS-LiDAR-32"]
    columns = columns_of(model, np.arange(3600) * 20)
    payloads, info = write_data(model, columns), write_info(model, angles_of(model))
    keep = np.ones(len(payloads), bool)
    keep[[20, 21, 22, 160]] = False
    keep[149:152] = False
    decoder, frames = decode(payloads[keep], columns.times_ns[keep], info, batch=7)
    assert decoder.facts.lost_packets == 7
    assert_same(frames, reference_of(model.name, angles_of(model), payloads[keep]))
    assert len(frames) == 2


def test_a_blind_sector_is_not_a_loss():
    model = MODELS["RS-LiDAR-32"]
    azimuth = np.tile(np.arange(900) * 20 + 9000, 4)
    columns = columns_of(model, azimuth)
    gap_ns = round(0.05 * 10**9)
    times = START_NS + np.arange(len(columns.times_ns)) * model.packet_ns
    times += np.arange(len(times)) * 12 // 900 * (gap_ns - model.block_ns)
    info = write_info(model, angles_of(model), fov=(9000, 27000))
    decoder, frames = decode(write_data(model, replace(columns, times_ns=times)), times, info)
    assert decoder.facts.lost_packets == 0
    assert [frame.partial for frame in frames] == [False] * 4


def test_partial_revolutions_are_marked():
    model = MODELS["RS-LiDAR-32"]
    info = write_info(model, angles_of(model))
    columns = columns_of(model, np.arange(4800) * 20 + 18000)
    _, frames = decode(write_data(model, columns), columns.times_ns, info)
    assert [frame.partial for frame in frames] == [True, False, False, True]
    columns = columns_of(model, np.arange(3600) * 20)
    _, frames = decode(write_data(model, columns), columns.times_ns, info)
    assert [frame.partial for frame in frames] == [False, False]


def test_old_firmware_of_32_lasers():
    model, angles = MODELS["RS-LiDAR-32"], angles_of(MODELS["RS-LiDAR-32"])
    old = with_old_firmware(model)
    columns = columns_of(old, np.arange(48) * 18)
    payloads = write_data(old, columns)
    for block in range(0, 12, 2):
        payloads[:, 42 + 100 * block + 4] |= 0x80
    decoder, frames = decode(payloads, columns.times_ns, write_info(model, angles, return_mode=0, is_old=True))
    assert_same(frames, reference_of("old RS-LiDAR-32", angles, payloads))
    assert decoder.facts.details["distance unit"] == "10 mm"
    assert decoder.facts.details["intensity"].startswith("raw")
    assert any("1 cm" in text for text in decoder.facts.warnings)
    assert any("raw" in text for text in decoder.facts.warnings)


def test_an_invalid_block_ends_its_packet():
    model, angles = MODELS["RS-LiDAR-32"], angles_of(MODELS["RS-LiDAR-32"])
    columns = columns_of(model, np.arange(48) * 20)
    payloads = write_data(model, columns)
    payloads[0, 42 + 7 * 100 :: 100] = payloads[2, 42::100] = 0
    decoder, frames = decode(payloads, columns.times_ns, write_info(model, angles))
    assert_same(frames, reference_of(model.name, angles, payloads))
    assert decoder.facts.bad_packets == 1


@pytest.mark.parametrize("name", ["RS-LiDAR-32", "RS-Helios"])
def test_times_of_a_wrong_clock_are_shifted_to_the_recording_time(name):
    model = MODELS[name]
    columns = columns_of(model, np.arange(3600) * 20)
    off = replace(columns, times_ns=columns.times_ns - START_NS + 946_684_800 * 10**9)
    jitter = np.random.default_rng(0).integers(0, 50_000, len(columns.times_ns))
    record_ns = columns.times_ns + model.packet_ns + jitter
    decoder, frames = decode(write_data(model, off), record_ns, write_info(model, angles_of(model)), batch=40)
    assert any("off by more than a day" in text for text in decoder.facts.warnings)
    for number, frame in enumerate(frames):
        end = columns.times_ns[150 * (number + 1) - 1] + 11 * model.block_ns + model.channel_ns(dual=False)[-1]
        assert 0 <= frame.stamp_ns - end <= 60_000
        assert frame.points["timestamp"].max() - frame.points["timestamp"].min() < 0.101
        expected = np.diff(np.unique(frame.points["timestamp"]))
        assert expected.max() < 5 * model.block_ns / 1e9
    assert decoder.facts.lost_packets == 0


def test_single_broken_times_are_tolerated():
    model = MODELS["RS-LiDAR-32"]
    columns = columns_of(model, np.arange(1800) * 20)
    payloads = write_data(model, columns)
    payloads[40, 20:30], payloads[41, 20:30] = 0xFF, 1
    _, frames = decode(payloads, columns.times_ns + model.packet_ns, write_info(model, angles_of(model)))
    times = np.concatenate([frame.points["timestamp"] for frame in frames])
    assert abs(times - START_NS / 1e9).max() < 0.2


class TestCalibration:
    model = MODELS["RS-LiDAR-32"]
    columns = columns_of(model, np.arange(48) * 20)
    payloads = write_data(model, columns)
    angles = angles_of(model)

    def file(self, tmp_path, lasers=32):
        path = tmp_path / "angle.csv"
        rows = zip(self.angles.vertical[:lasers] / 100, self.angles.horizontal / 100, strict=False)
        path.write_text("".join(f"{vertical:.2f},{side:.2f}\n" for vertical, side in rows))
        return path

    def test_missing(self):
        with pytest.raises(InputError, match=r"--sensor.*--calibration"):
            decode(self.payloads, self.columns.times_ns, None)
        with pytest.raises(InputError, match=r"DIFOP.*--calibration"):
            decode(self.payloads, self.columns.times_ns, None, DecoderOptions(model="RS-LiDAR-32"))

    def test_not_programmed(self):
        info = write_info(self.model, None)
        with pytest.raises(InputError, match=r"contains no angles.*--calibration"):
            decode(self.payloads, self.columns.times_ns, info, DecoderOptions(model="RS-LiDAR-32"))

    def test_from_a_file(self, tmp_path):
        options = DecoderOptions(self.file(tmp_path), "RS-LiDAR-32")
        decoder, frames = decode(self.payloads, self.columns.times_ns, None, options)
        assert_same(frames, reference_of(self.model.name, self.angles, self.payloads))
        assert any("DIFOP" in text for text in decoder.facts.warnings)

    def test_two_returns_are_detected_without_device_information(self, tmp_path):
        columns = columns_of(self.model, np.repeat(np.arange(48) * 20, 2))
        payloads = write_data(self.model, columns)
        options = DecoderOptions(self.file(tmp_path), "RS-LiDAR-32")
        _, frames = decode(payloads, columns.times_ns, None, options)
        assert_same(frames, reference_of(self.model.name, self.angles, payloads, dual=True))

    def test_a_file_of_another_model(self, tmp_path):
        options = DecoderOptions(self.file(tmp_path, lasers=16), "RS-LiDAR-32")
        with pytest.raises(InputError, match="got 16"):
            decode(self.payloads, self.columns.times_ns, None, options)

    def test_another_model_is_an_error(self):
        info = write_info(self.model, self.angles)
        with pytest.raises(InputError, match="no angles"):
            decode(self.payloads, self.columns.times_ns, info, DecoderOptions(model="RS-LiDAR-16"))
        with pytest.raises(InputError, match="RS-Helios"):
            decode(self.payloads, self.columns.times_ns, info, DecoderOptions(model="RS-Helios"))


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_random_bytes(data):
    """Random bytes raise no error, and packets that cannot be decoded are counted."""
    name = data.draw(st.sampled_from(NAMES))
    model = MODELS[name]
    columns = columns_of(model, np.arange(96) * 20 + 35000)
    intact = write_data(model, columns)
    intact[:, 32] = name == "RS-Airy-48"
    payloads = intact.copy()
    seed = data.draw(st.integers(0, 2**32))
    random = np.random.default_rng(seed)
    hit = random.random(payloads.shape) < data.draw(st.sampled_from([0.001, 0.02, 1.0]))
    hit[:, :4] &= data.draw(st.booleans())
    payloads[hit] = random.integers(0, 256, hit.sum())
    info = write_info(model, angles_of(model))
    info[40:] = np.where(random.random(1208) < 0.02, random.integers(0, 256, 1208), info[40:])
    info[[8, 9, 32, 33, 34, 35]] = random.integers(0, 256, 6)
    options = DecoderOptions(model=name)
    decoder, _ = decode(intact, columns.times_ns, write_info(model, angles_of(model)), options)
    frames = [*decoder.add(Packets(columns.times_ns, payloads)), *decoder.finish()]
    frames += decoder.add(Packets(columns.times_ns[:2], payloads[:2, : data.draw(st.integers(0, 1247))]))
    assert all(np.isfinite(frame.points["x"]).all() for frame in frames)
    bad = (payloads[:, :4] != intact[:, :4]).any(axis=1).sum()
    assert decoder.facts.bad_packets >= bad
    try:
        _, frames = decode(payloads, columns.times_ns, info, options)
    except InputError:
        return
    assert all(frame.points["ring"].max(initial=0) < model.lasers for frame in frames)
