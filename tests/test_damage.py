"""Damaged logs: readable parts are filtered, losses are reported."""

import struct

import numpy as np
import pytest

from tests.logs import (
    LAYOUTS,
    MAGIC,
    START_NS,
    Topic,
    cloud_log,
    cloud_message,
    cloud_messages,
    records_of,
    sea_points,
)
from tests.outcome import Outcome, all_broken, chunks, flip, log_of
from tests.pairs import covering
from tests.running import execute

FRAMES = 6


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Logs of six frames, each frame in its own chunk, as bytes."""
    path = tmp_path_factory.mktemp("logs") / "log.mcap"
    return {name: cloud_log(path, layout, frames=FRAMES).read_bytes() for name, layout in LAYOUTS.items()}


def test_intact_logs(tmp_path, logs):
    outcomes = {name: Outcome(tmp_path, data) for name, data in logs.items()}
    for outcome in outcomes.values():
        assert outcome.code == 0
        assert outcome.frames == outcome.sequences == list(range(FRAMES))
        assert outcome.rows == outcomes["zstd"].rows
        assert sum(int(row["low_intensity"]) for row in outcome.rows)
        assert sum(int(row["outlier"]) for row in outcome.rows)


@pytest.mark.parametrize("name", ["zstd", "lz4", "none", "no summary"])
def test_a_flipped_byte_in_a_chunk(tmp_path, logs, name):
    chunk = chunks(logs[name])[2]
    outcome = Outcome(tmp_path, flip(logs[name], chunk.end - 1000))
    assert outcome.code == 3
    assert outcome.sequences == [0, 1, 3, 4, 5]
    (line,) = outcome.damage
    assert line.startswith(f"Damaged: {outcome.log}: byte {chunk.offset}: the chunk ")
    assert line.endswith(f"left out: 3 messages, {chunk.end - chunk.offset:,} bytes")


@pytest.mark.parametrize("options", [("--end", 0.2), ("-m", "global_intensity")], ids=["a part", "a first pass"])
def test_damage_is_reported_once_if_a_log_is_read_twice(tmp_path, logs, options):
    chunk = chunks(logs["zstd"])[0]
    outcome = Outcome(tmp_path, flip(logs["zstd"], chunk.end - 1000), *options)
    assert outcome.code == 3
    (line,) = outcome.damage
    assert line.startswith(f"Damaged: {outcome.log}: byte {chunk.offset}: the chunk ")


HARMLESS = {
    "no end": (lambda data: data[: -len(MAGIC)], "does not end with the MCAP magic bytes"),
    "wrong checksum of the index": (lambda data: flip(data, len(data) - 9), "the index at the end is damaged"),
    "garbage in the middle": (
        lambda data: data[: chunks(data)[2].offset] + b"\xb7" * 700 + data[chunks(data)[2].offset :],
        "damaged bytes between records; left out: 700 bytes",
    ),
    "no beginning": (lambda data: data[chunks(data)[0].offset - 5 :], "does not begin with the MCAP magic bytes"),
}
"""What `tests/sources/mcap` has more of."""


@pytest.mark.parametrize("kind", HARMLESS)
def test_damage_that_costs_no_frame(tmp_path, logs, kind):
    change, message = HARMLESS[kind]
    outcome = Outcome(tmp_path, change(logs["zstd"]))
    assert outcome.code == 3
    assert outcome.sequences == list(range(FRAMES))
    assert message in outcome.stderr
    assert f"Damaged: {outcome.log}: byte " in outcome.stderr


def header_only(data):
    return data[: records_of(data)[0].end]


UNREADABLE = {
    "nothing": (lambda _: b"", "the file is empty"),
    "a header": (header_only, "no readable record in this MCAP file"),
    "broken frames": (all_broken, "no frame can be read; "),
    "an end": (lambda data: data[-300:], "no point clouds that can be read"),
}


@pytest.mark.parametrize("kind", UNREADABLE)
def test_logs_in_which_nothing_can_be_read(tmp_path, logs, kind):
    change, message = UNREADABLE[kind]
    outcome = Outcome(tmp_path, change(logs["zstd"]))
    assert outcome.code == 1
    assert message in outcome.stderr
    assert "log" in outcome.stderr
    assert len([line for line in outcome.stderr.splitlines() if line.startswith("Error: ")]) == 1


def wrong_message(**changes):
    return cloud_message("ros2", sea_points(300), START_NS, **changes)


def long_field():
    """Return a message whose last field does not fit into the point."""
    points = sea_points(300)
    return cloud_message("ros2", points, START_NS, point_step=25, row_step=25 * 300)


INVALID = {
    "empty": lambda: b"",
    "not CDR": lambda: b"\x07\x07\x07\x07" * 100,
    "cut in the points": lambda: wrong_message()[:-2000],
    "cut in the header": lambda: wrong_message()[:30],
    "a field beyond the point": long_field,
    "huge width": lambda: wrong_message(width=2**32 - 1),
    "huge height": lambda: wrong_message(height=2**32 - 1),
    "huge width and height": lambda: wrong_message(width=2**32 - 1, height=2**32 - 1, row_step=2**32 - 1),
    "no point step": lambda: wrong_message(point_step=0, row_step=0),
    "huge point step": lambda: wrong_message(point_step=2**32 - 1, row_step=2**32 - 1),
    "no fields": lambda: wrong_message(fields=[]),
    "no data": lambda: wrong_message(data=np.empty(0, np.uint8)),
}


@pytest.mark.parametrize(("kind", "index"), covering(INVALID, (2, 0, FRAMES - 1)))
def test_an_invalid_cloud(tmp_path, kind, index):
    intact = cloud_messages("ros2", FRAMES, 200)
    messages = [*intact[:index], INVALID[kind](), *intact[index + 1 :]]
    outcome = Outcome(tmp_path, log_of(tmp_path / "log.mcap", messages))
    assert outcome.code == 3
    expected = [number for number in range(FRAMES) if number != index]
    assert outcome.frames == outcome.sequences == expected
    assert outcome.points == [200] * (FRAMES - 1)
    (line,) = outcome.damage
    assert f"frame {index} of /points" in line
    assert f"left out: 1 message, {len(messages[index]):,} bytes" in line or not messages[index]


@pytest.mark.parametrize("kind", ["empty", "cut in the points", "huge width"])
def test_only_invalid_clouds(tmp_path, kind):
    outcome = Outcome(tmp_path, log_of(tmp_path / "log.mcap", [INVALID[kind]()] * 3))
    assert outcome.code == 1
    assert "no frame can be read" in outcome.stderr


def test_clouds_that_the_method_cannot_use(tmp_path):
    points = sea_points(50)
    for fields, message in (
        (["x", "y", "z", "ring"], "no intensity field; the cloud has x, y, z, ring"),
        (["x", "y", "intensity"], "no field 'z'"),
    ):
        data = log_of(
            tmp_path / "log.mcap",
            [cloud_message("ros2", np.ascontiguousarray(points[fields].astype(_packed(points, fields))), START_NS)],
        )
        outcome = Outcome(tmp_path, data)
        assert outcome.code == 1
        assert message in outcome.stderr


def _packed(points, fields):
    return np.dtype([(name, points.dtype[name]) for name in fields])


def test_an_intensity_of_several_values(tmp_path):
    points = np.zeros(30, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")])
    message = bytearray(cloud_message("ros2", points, START_NS))
    at = message.index(b"intensity\0")
    struct.pack_into("<I", message, at - at % 4 + 20, 2)  # the count of the field
    outcome = Outcome(tmp_path, log_of(tmp_path / "log.mcap", [bytes(message)]))
    assert outcome.code == 1


@pytest.mark.parametrize(
    ("name", "method"),
    covering(
        (b"inten\nity", b"inten\xffity", b"inte\x1b[3my", b"\0\0\0\0\0\0\0\0\0"), ("joint", "global_intensity", "sor")
    ),
)
def test_a_frame_whose_intensity_has_an_unprintable_name(tmp_path, name, method):
    messages = cloud_messages("ros2", FRAMES, 50)
    messages[3] = messages[3].replace(b"intensity", name)
    outcome = Outcome(tmp_path, log_of(tmp_path / "log.mcap", messages), "-m", method)
    assert outcome.frames == [number for number in range(FRAMES) if number != 3 or method == "sor"]
    assert all(line.isprintable() for line in outcome.damage)
    result = execute("info", outcome.log)
    assert result.exit_code in (0, 3)
    assert all(line.isprintable() for line in result.stdout.splitlines())


def test_a_log_without_clouds(tmp_path):
    outcome = Outcome(tmp_path, log_of(tmp_path / "log.mcap", [b"x"], topic=Topic("/notes")))
    assert outcome.code == 1
    assert "no point clouds that can be read; the log has /notes (test/msg/Note, cdr)" in outcome.stderr


def test_info_reports_damage(tmp_path, logs):
    path = tmp_path / "log.mcap"
    path.write_bytes(flip(logs["zstd"], chunks(logs["zstd"])[2].end - 1000))
    result = execute("info", path, code=3)
    assert f"Damaged: {path}: byte " in result.stderr
    path.write_bytes(b"no log")
    result = execute("info", path)
    assert (result.exit_code, result.stdout.strip()) == (1, "")
