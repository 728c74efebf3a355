"""Tests of ``seaclutter calibrate``: written configuration, printed summary, errors."""

import json
import math
import sys
from functools import partial

import numpy as np
import pytest
from PIL import Image

from seaclutter_cli.config import load_config
from tests.commands.test_filter import POINT, write_log
from tests.paths import SAMPLE
from tests.running import execute


def sea(number, *, size=2000, last_m=64, scale=1.0, whole=True):
    """Return clutter without gaps from 5 m to ``last_m``, weaker with range; equal numbers give equal points."""
    rng = np.random.default_rng(number)
    cloud = np.zeros(size, POINT)
    range_m = 5 + (last_m - 5) * np.linspace(0, 1, size) ** 2
    bearing = rng.uniform(-math.pi, math.pi, size)
    cloud["x"], cloud["y"] = range_m * np.cos(bearing), range_m * np.sin(bearing)
    intensity = rng.exponential(400 / range_m)
    cloud["intensity"] = np.floor(intensity) if whole else intensity * scale
    return cloud


invoke = partial(execute, "calibrate")


def data(*arguments):
    result = invoke(*arguments, "--json", code=0)
    return json.loads(result.stdout)


def columns(clouds):
    points = np.concatenate(clouds)
    return np.hypot(points["x"].astype(float), points["y"].astype(float)), points["intensity"]


@pytest.fixture
def log(tmp_path):
    return write_log(tmp_path / "log.mcap", make=sea)


@pytest.fixture
def out(tmp_path):
    return tmp_path / "new.yaml"


def test_the_thresholds_are_quantiles_of_sorted_intensities(log, out):
    invoke(log, "-o", out, code=0)
    config = load_config(out)
    ranges, intensity = columns([sea(number) for number in range(5)])
    assert config.method == "joint"
    assert (config.filter.end_m, len(config.filter.initial_thresholds)) == (70, 4)
    for number, threshold in enumerate(config.filter.initial_thresholds):
        inside = intensity[(ranges >= 10 + 15 * number) & (ranges < 25 + 15 * number)]
        assert np.mean(inside < threshold) >= 0.8
        assert np.mean(inside < threshold - 1) < 0.8
        assert isinstance(threshold, int)


def test_filter_accepts_the_configuration(log, out, tmp_path):
    found = data(log, "-o", out)
    arguments = ["filter", str(log), "-c", str(out), "-o", str(tmp_path / "f.mcap"), "-m", "ring_intensity", "--json"]
    result = execute(*arguments, code=0)
    assert "Warning" not in result.stderr
    rings = json.loads(result.stdout)[0]["topics"]["/points"]["rings"]
    assert [ring["points"] for ring in rings] == [ring["points"] for ring in found["rings"]]
    assert [ring["low_intensity"] for ring in rings] == [ring["below"] for ring in found["rings"]]


def test_the_printed_summary_equals_the_data(log, out, tmp_path):
    printed = invoke(log, "-o", out).stdout
    found = data(log, "-o", tmp_path / "b.yaml")
    for ring in found["rings"]:
        row = next(line for line in printed.splitlines() if f"{ring['start_m']:g} to {ring['end_m']:g} m" in line)
        assert f"{ring['points']:,}" in row
        assert f" {ring['threshold']}  " in row
        assert row.endswith(f"{100 * ring['filter_rate']:.1f} %")
    assert found["last_m"] == pytest.approx(64, abs=1e-4)
    assert (found["start_m"], found["end_m"], found["end_kept"]) == (10, 70, False)
    assert (found["frames"], found["recordings"], found["labelled"]) == (5, ["log"], False)
    assert found["clutter_points"] == sum(ring["points"] for ring in found["rings"]) + found["points_beyond"]
    assert "clutter ends at 70 m" in " ".join(printed.split())
    assert all(len(line) <= 80 for line in printed.splitlines()[1:])


def test_comments_describe_the_origin_of_the_configuration(log, out, tmp_path):
    invoke(log, "-o", out, "--filter-rate", "0.9")
    text = out.read_text(encoding="utf-8")
    head = " ".join(line[2:] for line in text.splitlines() if line.startswith("# "))
    for phrase in (
        "filter rate of 0.9 in log.",
        "5 frames",
        "no labels",
        "Sensor not recognised",
        "field intensity, 0 to",
    ):
        assert phrase in head
    assert "10 to 25 m" in head
    assert str(tmp_path) not in text
    assert all(len(line) <= 100 for line in text.splitlines() if line.startswith("#"))


def test_fractions(tmp_path, out):
    log = write_log(tmp_path / "log.mcap", make=lambda number: sea(number, whole=False, scale=1 / 255))
    found = data(log, "-o", out)
    ranges, intensity = columns([sea(number, whole=False, scale=1 / 255) for number in range(5)])
    for ring in found["rings"]:
        inside = intensity[(ranges >= ring["start_m"]) & (ranges < ring["end_m"])].astype(float)
        assert ring["below"] == np.count_nonzero(inside < ring["threshold"]) == math.ceil(0.8 * len(inside))
    assert list(load_config(out).filter.initial_thresholds) == [ring["threshold"] for ring in found["rings"]]


def test_start_values_come_from_a_configuration_and_the_command_line(log, out, tmp_path):
    start = tmp_path / "start.yaml"
    start.write_text("filter: {ring_width_m: 10, update_weight: 0.3, end_m: 40, initial_thresholds: [1, 1, 1]}\n")
    config = load_config_after(log, out, "-c", start, "-s", "filter.start_m=8", "-s", "evaluation.box_margin_m=1")
    assert (config.filter.start_m, config.filter.ring_width_m, config.filter.update_weight) == (8, 10, 0.3)
    assert (config.filter.end_m, config.evaluation.box_margin_m) == (68, 1)


def load_config_after(log, out, *arguments):
    invoke(log, "-o", out, *arguments, code=0)
    return load_config(out)


@pytest.mark.parametrize("arguments", [("-s", "filter.end_m=50"), ("-c", "start.yaml", "--keep-end")])
def test_a_far_limit_that_is_given(log, out, tmp_path, monkeypatch, arguments):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "start.yaml").write_text("filter: {end_m: 50, initial_thresholds: [1, 1, 1]}\n")
    config = load_config_after(log, out, *arguments)
    assert (config.filter.end_m, len(config.filter.initial_thresholds)) == (50, 3)
    assert "the given far limit of 50 m is kept" in " ".join(out.read_text().replace("#", "").split())


def test_the_method_is_kept(log, out):
    assert load_config_after(log, out, "-m", "ring_intensity").method == "ring_intensity"


def test_rings_with_few_or_no_points(tmp_path, out):
    cloud = np.zeros(500, POINT)
    cloud["x"] = np.where(np.arange(500) < 480, 30, 41)
    cloud["intensity"] = np.arange(500) % 10
    log = write_log(tmp_path / "log.mcap", frames=1, make=lambda _: cloud)
    result = invoke(log, "-o", out, "-s", "filter.end_m=70", code=0)
    table = result.stdout.splitlines()
    for span, threshold, note in (
        ("10 to 25 m", 8, "no points: ring 2"),
        ("25 to 40 m", 8, ""),
        ("40 to 55 m", 8, "few points: ring 2"),
        ("55 to 70 m", 8, "no points: ring 2"),
    ):
        (row,) = (line for line in table if span in line)
        assert (row.split()[5], row.endswith(note)) == (str(threshold), True)
        assert row.strip() in out.read_text()
    assert load_config(out).filter.initial_thresholds == (8, 8, 8, 8)


def test_gaps_between_the_circles_of_beams_are_not_the_end(tmp_path, out):
    cloud = np.zeros(900, POINT)
    cloud["x"], cloud["intensity"] = np.repeat([12, 16, 31], 300), 5
    log = write_log(tmp_path / "log.mcap", make=lambda _: cloud)
    assert data(log, "-o", out)["end_m"] == 40


class TestLabels:
    HEAD = "frame,track_id,class,x,y,z,length,width,height,yaw\n"

    def labels(self, path, rows):
        path.write_text(self.HEAD + "".join(rows))
        return path

    def test_targets_and_areas_are_left_out(self, log, out, tmp_path):
        rows = [f"{n},1,ship,20,0,0,10,8,4,0\n{n},2,ignore,0,40,0,6,6,6,0\n" for n in range(4)]
        found = data(log, "-o", out, "--labels", self.labels(tmp_path / "l.csv", rows))
        clouds = [sea(number) for number in range(4)]
        ranges, _ = columns(clouds)
        points = np.concatenate(clouds)
        ship = (np.abs(points["x"] - 20) <= 5.5) & (np.abs(points["y"]) <= 4.5)
        area = (np.abs(points["x"]) <= 3.5) & (np.abs(points["y"] - 40) <= 3.5)
        assert found["clutter_points"] == np.count_nonzero((ranges >= 10) & ~ship & ~area)
        assert found["labelled_points"] == np.count_nonzero((ranges >= 10) & (ship | area)) > 0
        assert (found["frames"], found["unlabelled_frames"], found["labelled"]) == (4, 1, True)
        assert "4 frames (1 unlabelled frame left out)" in out.read_text().replace("\n# ", " ")

    def test_the_box_margin_comes_from_the_configuration(self, log, tmp_path):
        rows = [f"{n},1,ship,20,0,0,10,8,4,0\n" for n in range(5)]
        labels = self.labels(tmp_path / "l.csv", rows)
        few, many = (
            data(log, "-o", tmp_path / f"{margin}.yaml", "--labels", labels, "-s", f"evaluation.box_margin_m={margin}")
            for margin in (0, 3)
        )
        assert few["labelled_points"] < many["labelled_points"]

    def test_labelled_points_of_the_cloud_itself(self, tmp_path, out):
        def make(number):
            plain = sea(number)
            cloud = np.zeros(len(plain), [*POINT, ("label", "<u2")])
            for name in plain.dtype.names:
                cloud[name] = plain[name]
            cloud["label"][::2], cloud["label"][1::4] = 3, 65535
            return cloud

        log = write_log(tmp_path / "log.mcap", make=make)
        found = data(log, "-o", out, "--labels", log)
        ranges, _ = columns([make(number)[3::4] for number in range(5)])
        assert found["clutter_points"] == np.count_nonzero(ranges >= 10)

    def test_a_folder_of_labels(self, tmp_path, out):
        logs, labels = tmp_path / "logs", tmp_path / "labels"
        logs.mkdir(), labels.mkdir()
        for name, frames in (("a", 2), ("b", 3)):
            write_log(logs / f"{name}.mcap", frames=frames, make=sea)
            self.labels(labels / f"{name}.labels.csv", [f"{n},,none,,,,,,,\n" for n in range(frames)])
        by_folder = data(logs, "-o", out, "--labels", labels)
        each = [item for name in "ab" for item in ("--labels", labels / f"{name}.labels.csv")]
        assert by_folder["rings"] == data(logs, "-o", tmp_path / "each.yaml", *each)["rings"]
        assert by_folder["frames"] == 5

    @pytest.mark.parametrize(
        ("arguments", "status", "message"),
        [
            (("--labels", "none.csv"), 2, "none.csv: no such file or folder of labels"),
            (("--labels", "l.csv", "--labels", "l.csv"), 2, "2 --labels for 1 recording:"),
            (("--labels", "far.csv"), 1, "far.csv"),
            (("--labels", "other.csv"), 1, "other.csv"),
            (("--labels", "l.csv", "--clutter-ids", "sea"), 2, "expected whole numbers separated by commas"),
            (("--labels", "l.csv", "--start", "3"), 1, "2 frames read, none of them labelled"),
        ],
    )
    def test_refused_arguments(self, log, tmp_path, monkeypatch, arguments, status, message):
        monkeypatch.chdir(tmp_path)
        self.labels(tmp_path / "l.csv", ["0,,none,,,,,,,\n"])
        self.labels(tmp_path / "far.csv", ["0,,none,,,,,,,\n", "77,,none,,,,,,,\n"])
        (tmp_path / "other.csv").write_text("time,temperature\n1,2\n")
        result = invoke(log, "-o", "new.yaml", *arguments)
        assert (result.exit_code, message in result.stderr) == (status, True), result.stderr
        assert not (tmp_path / "new.yaml").exists()

    def test_a_folder_that_lacks_labels_of_a_recording(self, tmp_path, out):
        for name in "ab":
            write_log(tmp_path / f"{name}.mcap", make=sea)
        self.labels(tmp_path / "a.labels.csv", [])
        result = invoke(tmp_path / "a.mcap", tmp_path / "b.mcap", "-o", out, "--labels", tmp_path, code=2)
        assert "missing: b.labels.csv" in result.stderr

    def test_recordings_with_the_same_name_cannot_share_a_folder_of_labels(self, tmp_path, out):
        for name in ("x", "y"):
            (tmp_path / name).mkdir()
            write_log(tmp_path / name / "a.mcap", make=sea)
        self.labels(tmp_path / "a.labels.csv", ["0,,none,,,,,,,\n"])
        result = invoke(tmp_path / "x/a.mcap", tmp_path / "y/a.mcap", "-o", out, "--labels", tmp_path, code=2)
        assert "two recordings have the same name" in result.stderr

    def test_one_topic_at_a_time(self, tmp_path, out):
        log = write_log(tmp_path / "log.mcap", ("/port", "/starboard"), make=sea)
        labels = self.labels(tmp_path / "l.csv", ["0,,none,,,,,,,\n"])
        assert data(log, "-o", out, "-t", "/port", "-t", "/starboard")["frames"] == 10
        result = invoke(log, "-o", out, "--force", "-t", "/port", "-t", "/starboard", "--labels", labels, code=2)
        assert "choose from: -t /port -t /starboard" in result.stderr


@pytest.mark.parametrize("suffix", [".png", ".svg", ".PNG"])
def test_the_plot(log, out, tmp_path, suffix):
    plot = tmp_path / f"sub/plot{suffix}"
    invoke(log, "-o", out, "--plot", plot, code=0)
    if suffix == ".svg":
        assert b"<svg" in plot.read_bytes()
    else:
        with Image.open(plot) as image:
            image.load()
            assert image.width == 1050
            assert "Software" not in image.info


def test_the_sample(out):
    found = data(SAMPLE, "-o", out, "-c", "snow")
    assert (found["frames"], found["start_m"]) == (3, 0)
    own = [ring for number, ring in enumerate(found["rings"], 1) if ring["source_rings"] == [number, number]]
    assert [ring["saturated"] for ring in own] == [ring["filter_rate"] < 0.8 for ring in own]
    assert {ring["threshold"] for ring in own if ring["saturated"]} == {255}


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (("none.mcap", "-o", "x.yaml"), 2, "none.mcap: no such file or folder"),
        (("log.mcap",), 2, "Missing option '-o'"),
        (("log.mcap", "-o", "old.yaml"), 2, "old.yaml: already exists; use --force to replace it"),
        (("log.mcap", "-o", "log.mcap", "--force"), 2, "is part of the input"),
        (("log.mcap", "-o", "."), 2, "is a folder"),
        (("log.mcap", "-o", "x.yaml", "--plot", "old.png"), 2, "old.png: already exists"),
        (("log.mcap", "-o", "x.yaml", "--plot", "x.jpg"), 2, "x.jpg: figure files must end in .png or .svg"),
        (("log.mcap", "-o", "x.svg", "--plot", "x.svg"), 2, "given for two outputs"),
        (("log.mcap", "-o", "x.yaml", "--filter-rate", "0"), 2, "--filter-rate"),
        (("log.mcap", "-o", "x.yaml", "--filter-rate", "1.1"), 2, "--filter-rate"),
        (("log.mcap", "-o", "x.yaml", "-m", "sor"), 2, "method sor has no thresholds to calibrate; choose -m joint"),
        (("log.mcap", "-o", "x.yaml", "-s", "filter.ring_width_m=0"), 2, "must be a number greater than 0"),
        (("log.mcap", "-o", "x.yaml", "-s", "filter.end_m=5"), 2, "end_m (5) must be greater"),
        (("log.mcap", "-o", "x.yaml", "-s", "filter.start_m=far"), 2, "filter.start_m"),
        (
            ("log.mcap", "-o", "x.yaml", "-s", "filter.start_m=65", "-s", "filter.end_m=70"),
            1,
            "no clutter point between",
        ),
        (("log.mcap", "-o", "x.yaml", "-s", "filter.start_m=69"), 1, "no clutter point from 69 m on"),
        (("log.mcap", "-o", "x.yaml", "-s", "filter.ring_width_m=0.2"), 2, "gives 300 range rings; the maximum is 250"),
        (("frameless.mcap", "-o", "x.yaml"), 1, "no clutter point from 10 m on"),
        (("plain.mcap", "-o", "x.yaml"), 1, "no intensity field; the cloud has x, y, z"),
        (("dark.mcap", "-o", "x.yaml"), 1, "the intensities are always 0, so they give no thresholds"),
        (("cloudless.mcap", "-o", "x.yaml"), 1, "no point clouds that can be read"),
        (("log.mcap", "broken.mcap", "-o", "x.yaml"), 1, "broken.mcap"),
    ],
)
def test_refused_arguments(tmp_path, monkeypatch, arguments, status, message):
    monkeypatch.chdir(tmp_path)
    write_log(tmp_path / "log.mcap", make=sea)
    write_log(tmp_path / "frameless.mcap", frames=0)
    write_log(tmp_path / "plain.mcap", make=lambda number: sea(number)[["x", "y", "z"]])
    write_log(tmp_path / "dark.mcap", make=dark)
    write_log(tmp_path / "cloudless.mcap", topics=())
    for name in ("broken.mcap", "old.yaml", "old.png"):
        (tmp_path / name).write_bytes(b"")
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    result = invoke(*arguments)
    assert (result.exit_code, message in result.stderr) == (status, True), result.stderr
    assert isinstance(result.exception, SystemExit)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before


def dark(number):
    cloud = sea(number)
    cloud["intensity"] = 0
    return cloud


def test_matplotlib_is_an_extra(log, out, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    result = invoke(log, "-o", out, "--plot", tmp_path / "x.png", code=1)
    assert "pip install 'seaclutter[plot]'" in result.stderr
    assert not out.exists()
    invoke(log, "-o", out, code=0)


def test_frames_that_lack_a_field_are_damage(tmp_path, out):
    log = write_log(tmp_path / "log.mcap", make=lambda n: sea(n)[["x", "y", "z"]] if n == 2 else sea(n))
    result = invoke(log, "-o", out, "--json", code=3)
    found = json.loads(result.stdout)
    assert (found["frames"], len(found["damage"])) == (4, 1)


def test_names_of_files_cannot_break_the_configuration(tmp_path, out):
    log = write_log(tmp_path / "log\nfilter: {}.mcap", make=sea)
    invoke(log, "-o", out, code=0)
    assert load_config(out).filter.end_m == 70
