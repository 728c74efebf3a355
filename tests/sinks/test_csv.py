"""CSV table of frames, read with the csv module."""

import csv
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from seaclutter_cli.cloud import from_array
from seaclutter_cli.config import load_config
from seaclutter_cli.filters import FILTERS
from seaclutter_cli.frame import WATER_COLUMNS, FilterResult, Frame, Rings, WaterState
from seaclutter_cli.records import Channel, Message
from seaclutter_cli.sinks.csv import FrameTable
from tests.logs import START_NS, cloud_log
from tests.sinks.runs import FakeSource, filter_log

COLUMNS = [
    "recording,topic,frame,stamp_ns,points_in,invalid,near,low_intensity,outlier,far,excluded,points_out",
    "threshold_1,threshold_2,threshold_3,threshold_4,correction_1,correction_2,correction_3,correction_4",
]
REASONS = ("invalid", "near", "low_intensity", "outlier", "far", "excluded")


def rows_of(path):
    with path.open(newline="", encoding="utf-8", errors="surrogateescape") as file:
        return list(csv.DictReader(file, strict=True))


@contextmanager
def table(path, *columns, **options):
    """Yield a table that is written to a file."""
    with path.open("wb") as file:
        made = FrameTable(file.write, *columns, **options)
        made.write_header()
        yield made


def result_of(index, *, stamp_ns=0, log_time_ns=5, topic="/points", **values):
    cloud = from_array(np.zeros(7, [("x", "f4")]), stamp_ns=stamp_ns)
    frame = Frame.of_message(Message(Channel(1, topic, "cdr", None), log_time_ns, 0, 0, b""), cloud, index)
    return FilterResult(frame, np.array([0, 0, 1, 3, 3, 5, 6], np.uint8), **values)


def test_one_row_per_frame(tmp_path):
    log = cloud_log(tmp_path / "day one.mcap", topics=["/bow", "/stern"])
    with table(tmp_path / "frames.csv", 4) as sink:
        results = filter_log(log, tmp_path / "out.mcap", topics=["/bow", "/stern"], sinks=[sink])
    text = (tmp_path / "frames.csv").read_text()
    assert text.splitlines()[0] == ",".join(COLUMNS)
    assert text.endswith("\n")
    assert "\r" not in text
    rows = rows_of(tmp_path / "frames.csv")
    assert [(row["topic"], row["frame"]) for row in rows] == [(t, str(k)) for k in range(6) for t in ("/bow", "/stern")]
    for row, result in zip(rows, results, strict=True):
        assert row["recording"] == "day one"
        assert int(row["stamp_ns"]) == START_NS + int(row["frame"]) * 100_000_000 - 5_000_000, "the header's stamp"
        assert [int(row[name]) for name in ("points_in", "points_out")] == [300, result.counts[0]]
        assert [int(row[name]) for name in REASONS] == result.counts[1:]
        assert [float(row[f"threshold_{k}"]) for k in range(1, 5)] == result.rings.thresholds.tolist()
        assert [float(row[f"correction_{k}"]) for k in range(1, 5)] == result.rings.corrections.tolist()
    assert any(float(row["correction_1"]) for row in rows)


@pytest.mark.parametrize("method", FILTERS)
def test_every_method_fills_its_columns(tmp_path, method):
    config = load_config(method=method)
    log = cloud_log(tmp_path / "in.mcap", frames=2, points=60)
    columns = {"scenes": config.kind.has_scenes, "water": config.kind.has_water}
    with table(tmp_path / "frames.csv", len(config.ring_edges[1:]), **columns) as sink:
        filter_log(log, tmp_path / "out.mcap", method=method, sinks=[sink])
    for row in rows_of(tmp_path / "frames.csv"):
        assert row.get("scene") == ("open" if method == "adaptive_radius" else None)
        assert None not in row, "not more values than columns"
        assert None not in row.values(), "not fewer values than columns"
        assert ("unconfirmed" in row) == ("water_level_m" in row) == (method == "confirmed")
        removed = [int(row.get(name, 0)) for name in (*REASONS, "unconfirmed", "mirrored")]
        assert sum(removed) + int(row["points_out"]) == int(row["points_in"]) == 60


def test_a_frame_without_ring_values_has_empty_cells(tmp_path):
    rings = Rings(*(np.array([value, value + 0.5]) for value in (30.0, 0.1, 1, 1, 1)))
    with table(tmp_path / "frames.csv", 2) as sink:
        sink.begin(FakeSource(()), [])
        for index, state in enumerate((None, rings)):
            sink.write(result_of(index, rings=state))
        sink.end()
    lines = (tmp_path / "frames.csv").read_text().splitlines()
    assert lines[1:] == ["log,/points,0,5,7,1,0,2,0,1,1,2,,,,", "log,/points,1,5,7,1,0,2,0,1,1,2,30.0,30.5,0.1,0.6"]


def test_the_scene_is_the_last_column(tmp_path):
    with table(tmp_path / "frames.csv", 1, scenes=True) as sink:
        sink.begin(FakeSource(()), [])
        for index, scene in enumerate(("open", None, 'a "dense", row')):
            sink.write(result_of(index, scene=scene))
        sink.end()
    lines = (tmp_path / "frames.csv").read_text().splitlines()
    assert lines[0] == ",".join((COLUMNS[0], "threshold_1", "correction_1", "scene"))
    assert [line.split(",,,")[1] for line in lines[1:]] == ["open", "", '"a ""dense"", row"']


def test_unconfirmed_points_and_the_water_are_the_last_columns(tmp_path):
    with table(tmp_path / "frames.csv", 0, water=True) as sink:
        sink.begin(FakeSource(()), [])
        sink.write(result_of(0, water=WaterState(-2.51234, 0.5, -1.0, 1 / 3, 0.04567)))
        sink.write(replace(result_of(1), reason=np.array([0, 0, 1, 7, 8, 5, 6], np.uint8)))
        sink.end()
    lines = (tmp_path / "frames.csv").read_text().splitlines()
    assert (
        lines[0] == f"{COLUMNS[0]},unconfirmed,mirrored,water_level_m,roll_deg,pitch_deg,{','.join(WATER_COLUMNS[3:])}"
    )
    assert lines[1:] == [
        "log,/points,0,5,7,1,0,2,0,1,1,2,0,0,-2.5123,0.5,-1.0,0.3333,0.0457",
        "log,/points,1,5,7,1,0,0,0,1,1,2,1,1,,,,,",
    ]


@pytest.mark.parametrize(
    ("stamp_ns", "log_time_ns", "written"), [(7, 5, 7), (0, 5, 5), (-8, 5, -8), (2**31 * 10**9, 5, 2**31 * 10**9)]
)
def test_the_stamp_is_from_the_header_otherwise_the_log_time(tmp_path, stamp_ns, log_time_ns, written):
    with table(tmp_path / "frames.csv", 0) as sink:
        sink.begin(FakeSource(()), [])
        sink.write(result_of(0, stamp_ns=stamp_ns, log_time_ns=log_time_ns))
        sink.end()
    assert rows_of(tmp_path / "frames.csv")[0]["stamp_ns"] == str(written)


def test_names_with_commas_quotes_and_other_bytes(tmp_path):
    names = ['a,"b"', "sjö\nfågel", b"l\xe5g".decode(errors="surrogateescape")]
    with table(tmp_path / "frames.csv", 0) as sink:
        for name in names:
            sink.begin(replace(FakeSource(()), name=name), [])
            sink.write(result_of(0, topic="/a,b"))
            sink.end()
    rows = rows_of(tmp_path / "frames.csv")
    assert [(row["recording"], row["topic"]) for row in rows] == [(name, "/a,b") for name in names]
    assert b"l\xe5g," in (tmp_path / "frames.csv").read_bytes()
