"""``seaclutter report``: pages of raw logs, filtered logs and unusual logs."""

import json
import re
import shlex
from functools import cache

import numpy as np
import pytest

import seaclutter
from seaclutter_cli.commands import cli
from seaclutter_cli.frame import Reason
from tests.logs import CLOUD_KINDS, PERIOD_NS, START_NS, Entry, Topic, cloud_log, cloud_message, cloud_topic, write_log
from tests.paths import ROOT
from tests.reporting.runs import HOSTILE, LABELLED, data_of, make_labels, make_log, report, unpacked
from tests.running import execute
from tests.sinks.runs import filter_log

SEA = ROOT / "samples" / "sea.mcap"


@pytest.fixture
def log(tmp_path):
    return make_log(tmp_path / "log.mcap")


@pytest.fixture
def labels(tmp_path):
    return make_labels(tmp_path / "boxes.csv")


@pytest.fixture
def page(tmp_path):
    return tmp_path / "report.html"


def bits(data, method=0):
    return unpacked(data["methods"][method]["alarms"], "u1").tolist()


def test_a_small_recording(log, labels, page):
    report(log, "--labels", labels, "-m", "ring_intensity", "-m", "none", "-o", page)
    data = data_of(page)
    assert data["recordings"] == ["log"]
    assert bits(data) == [1, 3, 1, 3, 5, 0]  # labelled 1, false alarm 2, missed target 4
    assert [method["name"] for method in data["methods"]] == ["ring_intensity", "none", "ideal"]
    assert data["methods"][0]["summary"]["N_FP"] == 2
    assert "filter_ms" not in data["methods"][0]["summary"]
    rows = [sample["row"] for sample in data["samples"]]
    assert sorted(rows) == list(range(6))
    assert sorted(rows[:3]) == [1, 3, 4], "frames with errors come first"
    counts = unpacked(data["methods"][0]["counts"], "<f4").reshape(len(Reason), 6)
    assert counts[3].tolist() == [10, 10, 10, 10, 20, 10]


def test_points_of_a_frame(log, labels, page):
    report(log, "--labels", labels, "-m", "ring_intensity", "-o", page, "--pick", 4)
    sample = next(one for one in data_of(page)["samples"] if one["row"] == 4)
    assert sample["why"] == "picked"
    xyz = unpacked(sample["xyz"], "<i2").reshape(-1, 3) * sample["scale"]
    assert np.abs(np.sort(xyz[:, 0]) - np.sort(np.r_[15 + np.arange(10) / 8, 30 + np.arange(10) / 8])).max() < 0.001
    assert set(unpacked(sample["reasons"][0], "u1")) == {3}
    assert sample["boxes"][0]["class"] == "boat"
    assert sample["boxes"][0]["state"] == ["missed"]


def test_a_frame_that_does_not_exist(log, page):
    assert "no log has frame 7, 99;" in report(log, "-o", page, "--pick", 2, "--pick", 99, "--pick", 7).stderr
    assert [one["why"] for one in data_of(page)["samples"] if one["row"] == 2] == ["picked"]


def test_figures_go_into_a_folder(log, page, tmp_path):
    (tmp_path / "file").touch()
    assert "takes a folder" in report(log, "-o", page, "--figures", tmp_path / "file", status=2).stderr


def test_a_filtered_log_is_not_filtered_again(log, labels, page, tmp_path):
    filtered = tmp_path / "run" / "log.mcap"
    filtered.parent.mkdir()
    filter_log(log, filtered, method="ring_intensity", keep_raw=True, with_removed=True)
    report(filtered, "--labels", labels, "-o", page)
    again = data_of(page)
    report(log, "--labels", labels, "-m", "ring_intensity", "-o", page, "--force")
    assert again | {"provenance": None} == data_of(page) | {"provenance": None}


def test_unconfirmed_points_are_read_back(page, tmp_path):
    filtered = tmp_path / "run" / "sea.mcap"
    filtered.parent.mkdir()
    arguments = ["-m", "confirmed", "-n", "20", "--keep-raw", "--with-removed", "-o", filtered]
    execute(*("filter", SEA, *arguments), code=0)
    report(filtered, "-o", page)
    again = data_of(page)
    report(SEA, "-m", "confirmed", "-n", 20, "-o", page, "--force")
    assert again | {"provenance": None} == data_of(page) | {"provenance": None}
    assert again["methods"][0]["totals"][Reason.UNCONFIRMED] > 20
    assert again["methods"][0]["water"] is not None
    assert any(one["kind"] == "unconfirmed" for sample in again["samples"] for one in sample["clusters"][0])


def test_the_water(page):
    report(SEA, "-m", "joint", "-m", "confirmed", "-n", 20, "-o", page)
    joint, confirmed = data_of(page)["methods"]
    assert joint["water"] is None
    expected = [one.water for one in confirmed_results()[:20]]
    for name, attribute in (("water_level_m", "level_m"), ("significant_wave_height_m",) * 2):
        known = [getattr(water, attribute) for water in expected]
        for series in confirmed["water"][name]:  # mean, minimum and maximum of bins of one frame
            np.testing.assert_allclose(unpacked(series, "<f4"), known, rtol=1e-6)


def test_the_plane_of_the_water_in_a_shown_frame(page):
    report(SEA, "-m", "confirmed", "-n", 20, "-o", page, "--pick", 7)
    sample = next(one for one in data_of(page)["samples"] if one["row"] == 7)
    xyz = unpacked(sample["xyz"], "<i2").reshape(-1, 3) * sample["scale"]
    water, low = sample["water"], unpacked(sample["reasons"][0], "u1") == Reason.LOW_INTENSITY
    height = xyz[:, 2] - water["level"] - xyz[:, :2] @ [water["slope_x"], water["slope_y"]]
    assert abs(np.median(height[low])) < 0.1
    state = confirmed_results()[7].water
    assert water["level"] == state.level_m
    assert np.degrees(np.arctan([-water["slope_y"], water["slope_x"]])) == pytest.approx(
        [state.roll_deg, state.pitch_deg]
    )


@cache
def confirmed_results():
    """Return the results of the first 20 frames of the sample, with the frames after them."""
    filtering, results = seaclutter.make_filter("confirmed"), []
    with seaclutter.open_log(SEA) as log:
        for frame in log.frames():
            results += filtering.process(frame)
            if len(results) >= 20:
                return results[:20]
    raise AssertionError("the sample has more frames")


@pytest.mark.parametrize("kind", CLOUD_KINDS)
def test_filtered_logs_of_every_encoding(kind, page, tmp_path):
    log = cloud_log(tmp_path / "raw.mcap", kind=kind, frames=5, points=500)
    results = filter_log(log, tmp_path / "log.mcap", keep_raw=True, with_removed=True)
    report(tmp_path / "log.mcap", "-o", page)
    method = data_of(page)["methods"][0]
    counts = [np.bincount(one.reason, minlength=len(Reason)) for one in results]
    assert method["totals"] == np.sum(counts, axis=0).tolist()
    thresholds = unpacked(method["thresholds"], "<f4").reshape(4, 5).T
    np.testing.assert_allclose(thresholds, [one.rings.thresholds for one in results], rtol=1e-6)


def test_scenes_are_read_back(log, page, tmp_path):
    filter_log(log, tmp_path / "f.mcap", method="adaptive_radius", keep_raw=True, with_removed=True)
    report(tmp_path / "f.mcap", "-o", page)
    scenes = data_of(page)["methods"][0]["scenes"]
    assert {name: unpacked(frames, "u1").tolist() for name, frames in scenes.items()} == {"open": [1] * 6}


@pytest.mark.parametrize(("more", "first"), [([], "joint"), (["-m", "ring_intensity"], "ring_intensity")])
def test_the_first_method(log, labels, page, more, first):
    report(log, "--labels", labels, "--compare", "paper", *more, "-o", page)
    names = [method["name"] for method in data_of(page)["methods"]]
    assert names[0] == first
    assert len(names) == len(set(names)) == 5


def test_a_filtered_log_without_its_raw_clouds_is_an_error(log, page, tmp_path):
    filter_log(log, tmp_path / "f.mcap")
    assert "--keep-raw --with-removed" in report(tmp_path / "f.mcap", "-o", page, status=1).stderr
    assert not page.exists()
    report(tmp_path / "f.mcap", "-m", "none", "-o", page)
    assert [method["name"] for method in data_of(page)["methods"]] == ["none"]


def test_a_raw_log_and_a_filtered_one_do_not_mix(log, page, tmp_path):
    filter_log(log, tmp_path / "f.mcap", keep_raw=True, with_removed=True)
    assert "process each one alone" in report(log, tmp_path / "f.mcap", "-o", page, status=2).stderr
    assert not page.exists()


def test_the_same_input_gives_the_same_page(log, labels, page, tmp_path):
    other = tmp_path / "other.html"
    for path in (page, other):
        report(log, "--labels", labels, "--compare", "all", "-o", path)
    assert page.read_bytes() == other.read_bytes()
    report(log, "--labels", labels, "--compare", "all", "-v", f"--output={page}", "--force")
    assert data_of(page) | {"provenance": None} == data_of(other) | {"provenance": None}


def test_the_page_says_where_it_comes_from(log, labels, page):
    report(log, "--labels", labels, "-m", "none", "-o", page)
    found = data_of(page)["provenance"]
    assert found["version"] == seaclutter.__version__
    assert found["command"] == shlex.join(
        ["seaclutter", "report", str(log), "--labels", str(labels), "-m", "none", "-o", "OUT"]
    )
    assert found["labels"] == [str(labels)]
    (recording,) = found["recordings"]
    assert recording["path"] == str(log)
    assert recording["recorded"] == "2023-11-14 22:13:20 to 22:13:20 UTC"  # START_NS
    assert recording["sensor"] == "not recognised"


def test_the_sensor_of_packets_is_named(page):
    report(SEA.with_name("rs-lidar-32.pcap"), "-n", 2, "-m", "none", "-o", page)
    (recording,) = data_of(page)["provenance"]["recordings"]
    assert recording["sensor"].startswith("RS-LiDAR-32")


def test_a_page_made_with_python_has_no_command(log, page):
    seaclutter.report(log, page)
    assert data_of(page)["provenance"]["command"] is None


def test_hostile_names(page, tmp_path):
    log = make_log(tmp_path / "x.mcap", topics=(f"/{HOSTILE}",))
    text = "frame,track_id,class,x,y,z,length,width,height,yaw\n"
    quoted = HOSTILE.replace('"', '""')
    labels = tmp_path / "l.csv"
    labels.write_text(
        text + "".join(f'{k},"{quoted}","{quoted}",30.5,0,0,3,2,2,0\n' for k in range(6)), encoding="utf-8"
    )
    report(log, "--labels", labels, "-o", page)
    content = page.read_text(encoding="utf-8")
    assert len(re.findall("<script", content)) == 2
    assert "<img" not in content
    assert content.count("</html>") == 1
    assert data_of(page)["samples"][0]["boxes"][0]["class"] == HOSTILE


def test_the_page_names_no_address(log, page):
    report(log, "-o", page)
    found = set(re.findall(r"https?://[^\s\"'<>]*", page.read_text(encoding="utf-8")))
    assert found == {"http://www.w3.org/2000/svg"}  # an XML namespace, which is never loaded


def test_no_labels(log, page):
    report(log, "-o", page)
    data = data_of(page)
    assert not data["labelled"]
    assert bits(data) == [0] * 6
    assert {sample["why"] for sample in data["samples"]} >= {"worst", "best"}


@pytest.mark.parametrize("rings", [5, 50])
def test_many_rings(log, page, rings):
    width = 60 / rings
    thresholds = f"filter.initial_thresholds={[5] * rings}"
    report(log, "-s", f"filter.ring_width_m={width}", "-s", thresholds, "-o", page)
    method = data_of(page)["methods"][0]
    assert len(method["edges"]) == rings + 1
    assert len(unpacked(method["thresholds"], "<f4")) == rings * 6


def test_clouds_without_points(page, tmp_path):
    log = make_log(tmp_path / "log.mcap", make=lambda _: np.zeros(0, LABELLED))
    report(log, "-o", page)
    assert data_of(page)["samples"][0]["shown"] == 0


def test_a_log_without_frames(page, tmp_path):
    log = write_log(tmp_path / "log.mcap", [cloud_topic("/points")], [])
    report(log, "-o", page)
    assert data_of(page)["frames"]["count"] == 0


def test_a_log_without_clouds(page, tmp_path):
    log = write_log(tmp_path / "log.mcap", [Topic("/note")], [])
    assert "no point clouds" in report(log, "-o", page, status=1).stderr
    assert not page.exists()


def test_several_recordings(log, labels, page, tmp_path):
    other = make_log(tmp_path / "other.mcap")
    report(log, other, "--labels", labels, "--labels", labels, "-o", page)
    data = data_of(page)
    assert data["recordings"] == ["log", "other"]
    assert unpacked(data["frames"]["frame"], "<u4").tolist() == [*range(6), *range(6)]
    assert bits(data)[:6] == bits(data)[6:]


def test_large_logs_give_small_pages(page, tmp_path, monkeypatch):
    stamps = [START_NS + k * PERIOD_NS for k in range(610)]
    points = np.zeros(4, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")])
    points["x"] = 20
    few = [Entry("/points", stamp, cloud_message("ros2", points, stamp)) for stamp in stamps]
    many = np.repeat(points, 40_000)
    many["x"] += np.arange(len(many)) / 4000
    big = [Entry("/points", stamp, cloud_message("ros2", many, stamp)) for stamp in stamps[:3]]
    log = write_log(tmp_path / "log.mcap", [cloud_topic("/points")], [*big, *few[3:]])
    report(log, "-o", page, "-m", "none", "-m", "joint", "--pick", 0, "--pick", 1)
    data = data_of(page)
    assert data["frames"]["count"] == 610
    assert len(data["bins"]) <= 600
    assert all(sample["shown"] <= 24_000 for sample in data["samples"])
    assert data["samples"][-1]["size"] in (4, 160_000)
    assert page.stat().st_size < 15e6


def test_the_outcome_as_json(log, page):
    found = json.loads(report(log, "-o", page, "--json").stdout)
    assert found["frames"] == 6
    assert found["files"] == [{"path": str(page), "bytes": page.stat().st_size}]
    assert {one["frame"] for one in found["shown"]} == set(range(6))


def test_figures(log, labels, page, tmp_path):
    report(log, "--labels", labels, "-m", "joint", "-m", "none", "-o", page, "--figures", tmp_path / "figures")
    names = {path.name for path in (tmp_path / "figures").iterdir()}
    assert names == {
        f"{name}.svg" for name in ("intensity", "thresholds", "corrections", "reasons", "alarms", "stages", "methods")
    }


def test_the_help_describes_the_selection_of_frames():
    assert "worst" in cli.get_command(None, "report").help
