"""Options of the filtered MCAP file."""

import struct

import numpy as np
import pytest

from seaclutter_cli.errors import FieldError, UsageError
from tests.logs import POINT, START_NS, cloud_log, cloud_message, sea_points
from tests.messages.test_diagnostics import decode as decode_diagnostics
from tests.sinks.runs import DIAGNOSTICS, KINDS, contents, decode, filter_log, log_of

NAN = struct.pack("<f", np.nan)


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out.mcap"


def times(entries):
    return [entry[:3] for entry in entries]


@KINDS
def test_keep_raw(tmp_path, out, kind):
    before = contents(cloud_log(tmp_path / "in.mcap", kind=kind))
    filter_log(tmp_path / "in.mcap", tmp_path / "plain.mcap")
    filter_log(tmp_path / "in.mcap", out, keep_raw=True)
    after, plain = contents(out), contents(tmp_path / "plain.mcap")
    assert after.topics["/points"] == before.topics["/points"]
    assert after.topics["/points/filtered"] == plain.topics["/points"]
    described = {topic: rest for topic, *rest in after.channels.values()}
    assert described["/points/filtered"] == described["/points"]


@KINDS
@pytest.mark.parametrize("keep_raw", [False, True])
def test_with_removed(tmp_path, out, kind, keep_raw):
    before = contents(cloud_log(tmp_path / "in.mcap", kind=kind)).topics["/points"]
    boxes = "filter.exclude_boxes=[[-20, 20, 12, 20, -9, 9]]"
    overrides = [boxes, "filter.far=drop"]
    results = filter_log(tmp_path / "in.mcap", out, overrides=overrides, with_removed=True, keep_raw=keep_raw)
    after = contents(out)
    removed = after.topics["/points/removed"]
    assert times(removed) == times(before)
    assert {int(reason) for result in results for reason in result.reason} == set(range(7)), "each reason occurs"
    for old, new, result in zip(before, removed, results, strict=True):
        raw, gone = decode(old.data, kind), decode(new.data, kind)
        assert gone.fields == [*raw.fields, ("reason", raw.point_step, "B", 1)]
        assert (gone.point_step, gone.header, gone.big_endian) == (raw.point_step + 1, raw.header, raw.big_endian)
        pairs = zip(raw.points, result.reason.tolist(), strict=True)
        assert gone.points == [point + bytes((reason,)) for point, reason in pairs if reason]
    described = {topic: rest for topic, *rest in after.channels.values()}
    assert described["/points/removed"] == described["/points"]


def test_removed_points_of_a_big_endian_cloud(tmp_path, out):
    swapped = sea_points(80).astype(POINT.newbyteorder(">"))
    changes = {"is_bigendian": True, "data": swapped.view(np.uint8)}
    log = log_of(tmp_path / "in.mcap", [cloud_message("ros2", sea_points(80), START_NS, **changes)])
    (result,) = filter_log(log, out, with_removed=True)
    removed = decode(contents(out).topics["/points/removed"][0].data)
    assert removed.column("reason") == result.reason[result.reason > 0].tolist()
    assert removed.column("ring") == [k % 32 for k in np.flatnonzero(result.reason)]


def organised(points, height, pad=0, **changes):
    """Return a message with the points in rows, each followed by padding."""
    rows = points.view(np.uint8).reshape(height, -1)
    data = np.pad(rows, ((0, 0), (0, pad)), constant_values=9)
    width = len(points) // height
    values = {"height": height, "width": width, "row_step": data.shape[1], "data": data.reshape(-1), **changes}
    return cloud_message("ros2", points, START_NS, **values)


@pytest.mark.parametrize("pad", [0, 6])
def test_keep_organized(tmp_path, out, pad):
    points = sea_points(120)
    raw = organised(points, 6, pad, is_dense=True)
    (result,) = filter_log(log_of(tmp_path / "in.mcap", [raw]), out, keep_organized=True)
    kept = decode(contents(out).topics["/points"][0].data)
    rows = decode(raw).data
    step = POINT.itemsize
    expected = bytearray(rows)
    for number in np.flatnonzero(result.reason):
        at = number // 20 * (20 * step + pad) + number % 20 * step
        expected[at : at + 12] = NAN * 3
    assert kept.data == expected, "only x, y and z of removed points change"
    assert 0 < result.counts[0] < 120
    assert kept.shape == (6, 20)
    assert kept.header == (*decode(raw).header[:-1], False), "the cloud now contains invalid points"
    assert (kept.fields, kept.point_step) == (decode(raw).fields, step)


def test_keep_organized_does_not_affect_unorganised_or_complete_clouds(tmp_path, out):
    messages = [cloud_message("ros2", sea_points(120), START_NS), organised(sea_points(120), 4)]
    log = log_of(tmp_path / "in.mcap", messages)
    results = filter_log(log, out, keep_organized=True)
    assert decode(contents(out).topics["/points"][0].data).shape == (1, results[0].counts[0])
    filter_log(log, tmp_path / "all.mcap", keep_organized=True, method="none")
    assert [entry.data for entry in contents(tmp_path / "all.mcap").topics["/points"]] == messages


def test_keep_organized_with_removed_and_raw(tmp_path, out):
    raw = organised(sea_points(120), 6)
    (result,) = filter_log(
        log_of(tmp_path / "in.mcap", [raw]), out, keep_organized=True, with_removed=True, keep_raw=True
    )
    after = contents(out).topics
    assert after["/points"][0].data == raw
    assert decode(after["/points/filtered"][0].data).shape == (6, 20)
    removed = decode(after["/points/removed"][0].data)
    assert removed.shape == (1, 120 - result.counts[0])
    assert [point[:-1] for point in removed.points] == [decode(raw).points[k] for k in np.flatnonzero(result.reason)]


def test_keep_organized_needs_coordinates_that_can_be_nan(tmp_path, out):
    layout = [("x", "<i4"), ("y", "<i4"), ("z", "<i4"), ("intensity", "<f4")]
    points = np.zeros(40, layout)
    log = log_of(tmp_path / "in.mcap", [organised(points, 2)])
    with pytest.raises(FieldError, match="'x' is not a floating-point number"):
        filter_log(log, out, keep_organized=True)
    assert not out.exists()


@KINDS
def test_diagnostics(tmp_path, out, kind):
    log = cloud_log(tmp_path / "in.mcap", kind=kind)
    results = filter_log(log, out)
    after = contents(out)
    (channel,) = [channel for channel in after.channels.values() if channel[0] == DIAGNOSTICS]
    encoding, schema = {"ros2": "cdr", "ros1": "ros1"}.get(kind, "json"), Described(*channel[2])
    assert channel[1] == encoding
    entries = after.topics[DIAGNOSTICS]
    assert times(entries) == times(contents(log).topics["/points"])
    for index, (entry, result) in enumerate(zip(entries, results, strict=True)):
        message = decode_diagnostics(encoding, schema, entry.data)
        seconds, nanoseconds = divmod(START_NS + index * 100_000_000 - 5_000_000, 10**9)
        assert message["stamp"] == {"sec": seconds, "nsec": nanoseconds}
        assert (message["topic"], message["frame"]) == ("/points", index)
        assert message["points_in"] == len(result.reason) == 300
        names = ("points_out", "invalid", "near", "low_intensity", "outlier", "far", "excluded")
        assert [message[name] for name in names] == result.counts
        assert message["thresholds"] == result.rings.thresholds.tolist()
        assert message["corrections"] == result.rings.corrections.tolist()
        assert message["ring_points"] == result.rings.points.tolist()
        assert sum(message["ring_low_intensity"]) == result.counts[3] > 0
        assert sum(message["ring_outliers"]) == result.counts[4] > 0
    assert any(results[-1].rings.corrections)


class Described:
    def __init__(self, name, encoding, data):
        self.name, self.encoding, self.data = name, encoding, data


@KINDS
def test_no_diagnostics(tmp_path, out, kind):
    filter_log(cloud_log(tmp_path / "in.mcap", kind=kind), tmp_path / "with.mcap")
    filter_log(tmp_path / "in.mcap", out, diagnostics=False)
    without, with_diagnostics = contents(out), contents(tmp_path / "with.mcap")
    assert DIAGNOSTICS not in {topic for topic, *_ in without.channels.values()}
    assert with_diagnostics.topics.pop(DIAGNOSTICS)
    assert without.topics == with_diagnostics.topics


@pytest.mark.parametrize("option", ["keep_raw", "with_removed"])
def test_an_existing_output_topic(tmp_path, out, option):
    taken = {"keep_raw": "/points/filtered", "with_removed": "/points/removed"}[option]
    log = cloud_log(tmp_path / "in.mcap", topics=["/points", taken], frames=2)
    with pytest.raises(UsageError, match=f"topic {taken} already exists in the log"):
        filter_log(log, out, topics=["/points"], **{option: True})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.mcap"]


def test_removed_points_filtered_again_keep_both_reasons(tmp_path, out):
    first = tmp_path / "first.mcap"
    filter_log(cloud_log(tmp_path / "in.mcap", frames=2), first, with_removed=True)
    results = filter_log(first, out, topics=["/points/removed"], method="sor", with_removed=True)
    cloud = decode(contents(out).topics["/points/removed/removed"][0].data)
    assert [name for name, *_ in cloud.fields][-2:] == ["reason", "reason_"]
    assert cloud.column("reason_") == results[0].reason[results[0].reason > 0].tolist()
    assert cloud.point_step == POINT.itemsize + 2
