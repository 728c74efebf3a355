"""Damaged logs: readable parts are filtered, losses are reported."""

import os
import struct
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.records import Footer

from tests.logs import (
    LAYOUTS,
    MAGIC,
    START_NS,
    Topic,
    cloud_log,
    cloud_message,
    cloud_messages,
    join,
    records_of,
    sea_points,
)
from tests.outcome import Outcome, all_broken, chunks, flip, log_of
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


def test_two_flipped_bytes(tmp_path, logs):
    first, second = chunks(logs["zstd"])[1:4:2]
    outcome = Outcome(tmp_path, flip(flip(logs["zstd"], first.end - 1000), second.end - 1000))
    assert outcome.sequences == [0, 2, 4, 5]
    assert [f"byte {chunk.offset}:" in line for chunk, line in zip((first, second), outcome.damage, strict=True)]


@pytest.mark.parametrize("name", LAYOUTS)
def test_cut_anywhere(tmp_path, logs, name):
    data = logs[name]
    ends = [piece.end for piece in records_of(data) if len(piece.content) > 3000]
    for size in [*range(3, len(data), len(data) // 14), len(data) - 1]:
        outcome = Outcome(tmp_path, data[:size])
        frames = sum(end <= size for end in ends)
        if len(ends) == FRAMES:
            # A complete frame in a truncated chunk is filtered.
            assert len(outcome.frames) in (frames, frames + 1)
            assert outcome.sequences == list(range(len(outcome.frames))) if outcome.rows else outcome.code == 1
        assert outcome.code == (3 if outcome.rows else 1)


def reassembled(data, *, change=lambda pieces: pieces, **footer):
    """Return a log with changed records and footer."""
    pieces = change(records_of(data))
    content = pieces.pop().content
    values = dict(
        zip(("summary_start", "summary_offset_start", "summary_crc"), struct.unpack("<QQI", content), strict=True)
    )
    return join(*pieces, Footer(**{**values, **footer}))


def altered(data, op, at, change):
    """Return a log with one changed number in a summary record, and without the checksum of the summary."""

    def apply(pieces):
        number = next(number for number, piece in enumerate(pieces) if piece.op == op)
        content = bytearray(pieces[number].content)
        struct.pack_into("<Q", content, at, struct.unpack_from("<Q", content, at)[0] + change)
        pieces[number] = pieces[number]._replace(content=bytes(content))
        return pieces

    return reassembled(data, change=apply, summary_crc=0)


def before(data, op):
    """Return the part of a log before the first record of a type."""
    return data[: next(piece.offset for piece in records_of(data) if piece.op == op)]


HARMLESS = {
    "no footer": (lambda data: before(data, Opcode.FOOTER), "the recording was not closed"),
    "no summary": (lambda data: before(data, Opcode.STATISTICS), "the recording was not closed"),
    "no end": (lambda data: data[: -len(MAGIC)], "does not end with the MCAP magic bytes"),
    "half an end": (lambda data: data[:-3], "does not end with the MCAP magic bytes"),
    "wrong checksum of the index": (lambda data: flip(data, len(data) - 9), "the index at the end is damaged"),
    "wrong offset of the index": (lambda data: reassembled(data, summary_start=77), "the index at the end is damaged"),
    "wrong times in the index": (
        lambda data: altered(data, Opcode.CHUNK_INDEX, 0, 10**9),
        "does not fit 1 of 7 chunks",
    ),
    "wrong offsets in the index": (lambda data: altered(data, Opcode.CHUNK_INDEX, 16, 7), "does not fit 1 of 7 chunks"),
    "offsets beyond the file": (
        lambda data: altered(data, Opcode.CHUNK_INDEX, 16, 2**62),
        "does not fit 1 of 7 chunks",
    ),
    "too many messages declared": (
        lambda data: altered(data, Opcode.STATISTICS, 0, 5),
        "the file lacks 5 of 23 messages",
    ),
    "too few messages declared": (lambda data: altered(data, Opcode.STATISTICS, 0, -5), "5 messages more than"),
    "zeros after the end": (lambda data: data + bytes(1000), "bytes after the end of the recording"),
    "text after the end": (lambda data: data + b"#!/bin/sh\n" * 9, "bytes after the end of the recording"),
    "another log after the end": (lambda data: data * 2, "bytes after the end of the recording"),
    "garbage in the middle": (
        lambda data: data[: chunks(data)[2].offset] + b"\xb7" * 700 + data[chunks(data)[2].offset :],
        "damaged bytes between records; left out: 700 bytes",
    ),
    "a broken beginning": (lambda data: flip(data, 3), "does not begin with the MCAP magic bytes"),
    "no beginning": (lambda data: data[chunks(data)[0].offset - 5 :], "does not begin with the MCAP magic bytes"),
}


@pytest.mark.parametrize("kind", HARMLESS)
def test_damage_that_costs_no_frame(tmp_path, logs, kind):
    change, message = HARMLESS[kind]
    outcome = Outcome(tmp_path, change(logs["zstd"]))
    assert outcome.code == 3
    assert outcome.sequences == list(range(FRAMES))
    assert message in outcome.stderr
    assert f"Damaged: {outcome.log}: byte " in outcome.stderr


@pytest.mark.parametrize("name", ["zstd", "none", "unchunked"])
def test_a_tail_of_zeros(tmp_path, logs, name):
    end = [piece.end for piece in records_of(logs[name]) if len(piece.content) > 3000][3]
    path = tmp_path / "log.mcap"
    path.write_bytes(logs[name][:end])
    os.truncate(path, 50_000_000)
    began = time.monotonic()
    outcome = Outcome(tmp_path, None)
    assert time.monotonic() - began < 10
    assert outcome.sequences == [0, 1, 2, 3]
    assert f"byte {end}: no readable record follows; left out: {50_000_000 - end:,} bytes" in outcome.stderr


def header_only(data):
    return data[: records_of(data)[0].end]


UNREADABLE = {
    "nothing": (lambda _: b"", "the file is empty"),
    "random bytes": (lambda _: np.random.default_rng(1).bytes(5000), "no readable record in this MCAP file"),
    "zeros": (lambda _: bytes(100_000), "no readable record in this MCAP file"),
    "a beginning": (lambda _: MAGIC, "no readable record in this MCAP file"),
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


@pytest.mark.parametrize("index", [0, 2, FRAMES - 1])
@pytest.mark.parametrize("kind", INVALID)
def test_an_invalid_cloud(tmp_path, kind, index):
    intact = cloud_messages("ros2", FRAMES, 200)
    messages = [*intact[:index], INVALID[kind](), *intact[index + 1 :]]
    if kind == "no fields" and index == 0:
        pytest.skip("the whole log counts as one without coordinates")
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


@pytest.mark.parametrize("method", ["joint", "global_intensity", "sor"])
@pytest.mark.parametrize("name", [b"inten\nity", b"inten\xffity", b"inte\x1b[3my", b"\0\0\0\0\0\0\0\0\0"])
def test_a_frame_whose_intensity_has_an_unprintable_name(tmp_path, method, name):
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


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(list(LAYOUTS)),
    st.lists(
        st.tuples(st.sampled_from("cfid"), st.floats(0, 1), st.binary(min_size=1, max_size=40)), min_size=1, max_size=4
    ),
)
def test_any_damage(tmp_path_factory, logs, name, steps):
    data = logs[name]
    for kind, position, noise in steps:
        at = round(position * len(data))
        if kind == "c":
            data = data[:at]
        elif kind == "f":
            data = data[:at] + noise + data[at + len(noise) :]
        elif kind == "i":
            data = data[:at] + noise + data[at:]
        else:
            data = data[:at] + data[at + len(noise) :]
    outcome = Outcome(tmp_path_factory.mktemp("any"), data)
    if LAYOUTS[name].chunked and LAYOUTS[name].crcs and outcome.code == 0:
        assert outcome.sequences == list(range(FRAMES))


@settings(max_examples=40, deadline=None)
@given(st.binary(max_size=2000), st.sampled_from((b"", MAGIC)))
def test_any_bytes(tmp_path_factory, data, start):
    assert Outcome(tmp_path_factory.mktemp("any"), start + data).code in (1, 3)


@settings(max_examples=80, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 250), st.integers(0, 255)), min_size=1, max_size=4))
def test_any_message(tmp_path_factory, changes):
    """The header of a message in an intact chunk is damaged."""
    folder = tmp_path_factory.mktemp("any")
    intact = cloud_messages("ros2", 3, 20)
    message = bytearray(intact[1])
    for at, value in changes:
        message[at] = value
    outcome = Outcome(folder, log_of(folder / "log.mcap", [intact[0], bytes(message), intact[2]]))
    assert outcome.code in (0, 3)
    assert [frame for frame in outcome.frames if frame != 1] == [0, 2]
