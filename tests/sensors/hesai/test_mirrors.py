"""Hesai AT128: the decoder, against points computed one by one from the description of packets and angles."""

import numpy as np
import pytest

from seaclutter_cli.errors import InputError
from seaclutter_cli.sensors.hesai.decoder import Hesai
from seaclutter_cli.sensors.hesai.scans import parse_corrections
from seaclutter_cli.sensors.packets import DecoderOptions, Packets
from tests.sensors.hesai.mirrors import DUAL, SINGLE, START_NS, correction_file, make_packets, slow_points

OPTIONS = DecoderOptions(recorded=correction_file())
PER_FIELD = 600
"""Packets of a mirror's field with one return, 1200 blocks of a twentieth of a degree."""


def decode(packets, batch=10_000, options=OPTIONS):
    decoder = Hesai().decoder(packets, options)
    frames = []
    for start in range(0, len(packets), batch):
        part = slice(start, start + batch)
        frames += decoder.add(Packets(packets.times_ns[part], packets.payloads[part]))
    return [*frames, *decoder.finish()], decoder.facts


def part_of(packets, rows):
    return Packets(packets.times_ns[rows], packets.payloads[rows])


@pytest.mark.parametrize("mode", [SINGLE, DUAL])
def test_points_agree_with_the_description(mode):
    """In the middle of a field, and where positions pass 360 degrees and the next field begins."""
    packets = make_packets(2400 if mode == SINGLE else 4800, mode=mode)
    rows = np.r_[5:10, 595:605, 1195:1205, 1790:1810] * (1 if mode == SINGLE else 2)
    packets = part_of(packets, rows)
    frames, facts = decode(packets)
    assert (facts.model, facts.bad_packets) == ("AT128", 0)
    found, expected = np.concatenate([frame.points for frame in frames]), list(slow_points(packets, mode))
    fields = np.repeat(np.arange(len(frames)) % 3, [len(frame.points) for frame in frames])
    assert len(found) == len(expected) > 1000
    number = found["return_number"] if mode == DUAL else np.ones(len(found))
    for point, field, returned, (in_field, channel, x, y, z, intensity, time_ns, nth) in zip(
        found, fields, number, expected, strict=True
    ):
        assert (point["x"], point["y"], point["z"]) == pytest.approx((x, y, z), abs=1e-5)
        assert (field, point["ring"], point["intensity"], returned) == (in_field, channel, intensity, nth)
        assert time_ns is None or point["timestamp"] == pytest.approx(time_ns / 1e9, abs=1e-6)


def test_a_frame_is_the_field_of_a_mirror():
    frames, facts = decode(make_packets(4 * PER_FIELD))
    assert [frame.partial for frame in frames[:4]] == [False] * 4
    assert [len(frame.points) for frame in frames[1:4]] == pytest.approx([1200 * 128 * 2 / 3] * 3, rel=0.01)
    assert [frame.stamp_ns for frame in frames] == sorted(frame.stamp_ns for frame in frames)
    assert frames[0].stamp_ns == pytest.approx(START_NS + PER_FIELD * 83_332_000 / 1000, abs=3e5)
    for frame in frames[:4]:
        azimuths = np.degrees(np.arctan2(frame.points["x"], frame.points["y"]))
        assert (azimuths.min(), azimuths.max()) == pytest.approx((30, 150), abs=6)
    assert facts.details["return mode"] == "last"
    assert facts.details["decoder"].startswith("experimental")
    assert "rotation rate" not in facts.details


def test_fields_that_the_recording_cuts_are_partial():
    frames, _ = decode(make_packets(1000, first=40.0))
    assert [frame.partial for frame in frames] == [True, False, True]


@pytest.mark.parametrize("batch", [1, 7, 100])
def test_batch_size_does_not_matter(batch):
    packets = part_of(make_packets(1300), np.r_[500:700, 1190:1210])
    one, other = decode(packets)[0], decode(packets, batch)[0]
    assert [frame.stamp_ns for frame in one] == [frame.stamp_ns for frame in other]
    for frame, same in zip(one, other, strict=True):
        np.testing.assert_array_equal(frame.points, same.points)


@pytest.mark.parametrize("fields", [1, 2, 3, 4])
def test_missing_fields_do_not_join_frames(fields):
    """After three missing ones, the next field is that of the same mirror."""
    packets = make_packets((fields + 3) * PER_FIELD)
    keep = np.r_[: PER_FIELD + 200, PER_FIELD + 200 + fields * PER_FIELD : len(packets.times_ns)]
    frames, facts = decode(part_of(packets, keep))
    assert len(frames) == 4
    assert facts.lost_packets == fields * PER_FIELD
    assert max(np.ptp(frame.points["timestamp"]) for frame in frames) < 0.051


def test_late_packets_do_not_begin_a_frame():
    packets = make_packets(1400)
    order = np.arange(1400)
    order[[599, 600, 601]] = [600, 599, 601]
    frames, facts = decode(part_of(packets, order))
    assert [len(frame.points) for frame in frames] == pytest.approx([102400, 102400, 34000], rel=0.01)
    assert facts.lost_packets == 0


def test_a_stationary_motor_does_not_fill_the_memory(monkeypatch):
    monkeypatch.setattr("seaclutter_cli.sensors.hesai.decoder._MAX_SLOTS", 10_000)
    packets = make_packets(2)
    frames, _ = decode(part_of(packets, np.zeros(300, np.int64)), batch=10)
    assert len(frames) > 3


@pytest.mark.parametrize(("signature", "numbered"), [(bytes(32), True), (bytes(32), False), (b"", False)])
def test_optional_parts(signature, numbered):
    packets = make_packets(20, signature=signature, numbered=numbered)
    frames, facts = decode(part_of(packets, np.r_[:8, 10:20]))
    assert facts.lost_packets == (2 if numbered else 0)  # time shows none: there are pauses between fields
    assert sum(len(frame.points) for frame in frames) == len(list(slow_points(packets))) * 18 // 20


def test_angles_of_the_unit_are_needed(tmp_path):
    packets = make_packets(3)
    with pytest.raises(InputError, match=r"AT128: the angles of the unit are needed.*\.dat.*--calibration"):
        decode(packets, options=DecoderOptions())
    path = tmp_path / "unit.dat"
    with pytest.raises(InputError, match=r"unit\.dat: No such file"):
        decode(packets, options=DecoderOptions(path))
    path.write_bytes(b"a prefix" + correction_file())
    frames, facts = decode(packets, options=DecoderOptions(path))
    assert facts.details["angles"] == "unit.dat"
    assert facts.warnings == []
    np.testing.assert_array_equal(frames[0].points, decode(packets)[0][0].points)


GOOD = correction_file()


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        (b"", "not a binary angle correction file"),
        (b"Laser id,Elevation,Azimuth\n1,2,3", "not a binary angle correction file"),
        (GOOD[:10], "not a binary angle correction file"),
        (correction_file(version=3), r"version 1\.3 are not supported, only 1\.5"),
        (correction_file(channels=64), "expected angles of 128 channels and at least two mirrors, got 64 channels"),
        (correction_file(mirrors=(0,)), "128 channels and 1 mirror"),
        (GOOD[:-40], "damaged"),
        (GOOD[:500] + bytes((GOOD[500] ^ 1,)) + GOOD[501:], "damaged"),
    ],
)
def test_other_and_damaged_files(data, problem):
    with pytest.raises(InputError, match=f"unit.dat: .*{problem}"):
        parse_corrections(data, "unit.dat", 128)
