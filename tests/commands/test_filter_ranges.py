"""What `filter` says about points nearer and farther than the range rings."""

import json

import numpy as np
import pytest

from tests.commands.test_filter import POINT, write_log
from tests.running import execute


def at(*ranges, each=100):
    """Return a function that makes frames of bright points at these ranges, spread over all bearings."""

    def make(_):
        cloud = np.zeros(each * len(ranges), POINT)
        range_m, bearing = np.repeat(ranges, each), np.linspace(0, 2 * np.pi, each * len(ranges))
        cloud["x"], cloud["y"] = range_m * np.cos(bearing), range_m * np.sin(bearing)
        cloud["intensity"] = np.where(np.arange(len(cloud)) % 2, 200, 1)
        return cloud

    return make


def run(tmp_path, make, *options):
    log = write_log(tmp_path / "log.mcap", make=make)
    arguments = ["filter", str(log), "-o", str(tmp_path / "f.mcap"), "--force", *options]
    return execute(*arguments), json.loads(execute(*arguments, "--json").stdout)


def test_near_points_are_named_by_their_setting(tmp_path):
    result, _ = run(tmp_path, at(3, 4, 20))
    assert "  nearer than 10 m (filter.start_m)    1,000  66.7 %\n" in result.stdout
    text = (
        "of the removed points are nearer than 10 m (filter.start_m); if own ship ends sooner, use filter.start_m: auto"
    )
    assert text in result.stdout


@pytest.mark.parametrize(("ranges", "options"), [((3, 20), ()), ((3, 4, 20), ("-s", "filter.near=keep"))])
def test_the_hint_is_only_for_clouds_of_which_most_is_removed(tmp_path, ranges, options):
    result, _ = run(tmp_path, at(*ranges), *options)
    assert "Most points" not in result.stdout


@pytest.mark.parametrize(
    ("method", "options", "row", "kept"),
    [
        ("joint", (), "500              -         -  100.0 %", 500),
        ("ring_intensity", ("-s", "filter.far=drop"), "500              -         -    0.0 %", 0),
        ("global_intensity", (), "500              -         -  100.0 %", 500),
    ],
)
def test_points_beyond_the_last_range_ring_have_a_row(tmp_path, method, options, row, kept):
    result, data = run(tmp_path, at(20, 30, 100), "-m", method, *options)
    (line,) = (line for line in result.stdout.splitlines() if line.startswith("  70 m on"))
    assert row.split()[0] in line
    topic = data[0]["topics"]["/points"]
    assert topic["beyond"] == {"start_m": 70, "points": 500, "kept": kept}
    counted = topic["beyond"]["points"] + sum(ring["points"] for ring in topic["rings"]) + topic["near"]
    assert counted == topic["points_in"]
    assert ("from 70 m on (filter.end_m)" in result.stdout) == (kept == 0)


def test_confirmed_judges_points_beyond_the_last_range_ring(tmp_path):
    result, data = run(tmp_path, at(20, 30, 100), "-m", "confirmed")
    assert "  70 m on" in result.stdout
    assert 0 <= data[0]["topics"]["/points"]["beyond"]["kept"] <= 500


@pytest.mark.parametrize(
    ("ranges", "options", "texts"),
    [
        ((90, 200), (), ("no point is in range: the nearest is 90 m away, the limit 70 m (filter.end_m)",)),
        ((90_000, 99_000), (), ("the limit 70 m;", "for airborne tiles, see seaclutter classify")),
        ((90_000, 99_000), ("-m", "sor"), ("the limit 10,000 m;", "for airborne tiles, see seaclutter classify")),
        ((2_000, 99_000), (), ("the limit 70 m;", "ranges reach 99000 m: coordinates must be in metres")),
        ((5, 200), (), ()),
        ((60, 200), (), ()),
    ],
)
def test_clouds_out_of_range(tmp_path, ranges, options, texts):
    result, _ = run(tmp_path, at(*ranges), *options)
    assert ("no point is in range" in result.stderr) == bool(texts)
    assert all(text in result.stderr for text in texts)


@pytest.mark.parametrize("ranges", [(0.02, 0.1), (20, 99_000)])
def test_coordinates_in_other_units_and_placeholders_are_said(tmp_path, ranges):
    result, _ = run(tmp_path, at(*ranges))
    text = f"ranges reach {ranges[1]} m: coordinates must be in metres"
    assert text in result.stderr
    assert text in " ".join(execute("info", tmp_path / "log.mcap").stdout.split())
