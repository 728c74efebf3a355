"""Tests of ``seaclutter evaluate``: rates, tables, several methods and recordings, errors."""

import csv
import json
import re
import sys
from functools import partial
from io import BytesIO

import numpy as np
import pytest

from seaclutter_cli.evaluation.scores import ALARM_COLUMNS, POINT_COLUMNS
from seaclutter_cli.runs.evaluate import evaluate
from seaclutter_cli.runs.methods import is_installed
from tests.logs import PERIOD_NS, START_NS, Entry, Topic, cloud_message, cloud_topic, write_log
from tests.running import execute

POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")])
LABELLED = np.dtype([*POINT.descr, ("label", "<u2")])
BOAT, WAVE, SPRAY = 30, 45, 15
HEAD = "frame,track_id,class,x,y,z,length,width,height,yaw"
BOX = "1,boat,30.5,0,0,3,2,2,0"
FRAMES = 6


def lump(range_m, intensity, label=0):
    points = np.zeros(10, LABELLED)
    points["x"] = range_m + 0.125 * np.arange(10)
    points["intensity"], points["label"] = intensity, label
    return points


def sea(number):
    """Return a frame with spray, a wave in frames 1 and 3, and a boat in all but frame 2, a dim one in frame 4."""
    lumps = [lump(SPRAY, 1)]
    if number in (1, 3):
        lumps.append(lump(WAVE, 100))
    if number != 2:
        lumps.append(lump(BOAT, 1 if number == 4 else 100, 7))
    return np.concatenate(lumps)


def make_log(path, dtype=POINT, make=sea, topics=("/points",)):
    entries = []
    for number in range(FRAMES):
        stamp = START_NS + number * PERIOD_NS
        points = make(number)
        wanted = np.zeros(len(points), dtype)
        for name in wanted.dtype.names:
            wanted[name] = points[name]
        entries += [Entry(topic, stamp, cloud_message("ros2", wanted, stamp)) for topic in topics]
    return write_log(path, [*map(cloud_topic, topics), Topic("/note")], entries)


def make_labels(path, *, frames=range(5)):
    """Label the frames of `sea`: frame 2 as empty, frame 5 not at all."""
    rows = [f"{number},,none,,,,,,," if number == 2 else f"{number},{BOX}" for number in frames]
    path.write_text("\n".join((HEAD, *rows, "")))
    return path


@pytest.fixture
def log(tmp_path):
    return make_log(tmp_path / "log.mcap")


@pytest.fixture
def labels(tmp_path):
    return make_labels(tmp_path / "boxes.csv")


invoke = partial(execute, "evaluate")


def figures(*arguments, status=0):
    result = invoke(*arguments, "--json")
    assert result.exit_code == status, result.output
    return json.loads(result.stdout)


def rows(path):
    with path.open() as stream:
        return list(csv.DictReader(stream))


def test_a_recording_by_hand(log, labels):
    found = figures(log, "--labels", labels, "-m", "ring_intensity")["methods"]["ring_intensity"]
    expected = {
        "frames": 5,
        "unlabelled_frames": 1,
        "N_FP": 2,
        "N_FN": 1,
        "R_FP": 0.4,
        "R_FN": 0.2,
        "targets": 4,
        "not_visible": 0,
        "detected": 3,
        "omitted_alarms": 1,
        "false_alarms": 2,
        "precision": 0.6,
        "recall": 0.75,
        "f1": pytest.approx(2 / 3),
        "false_alarms_per_frame": 0.4,
        "clusters_per_frame": 1,
    }
    assert {name: found[name] for name in expected} == expected
    assert "R_c" not in found
    assert found["filter_ms"]["median"] > 0


def test_the_unfiltered_log(log, labels):
    found = figures(log, "--labels", labels, "-m", "none")["methods"]["none"]
    assert (found["detected"], found["false_alarms"], found["N_FP"], found["N_FN"]) == (4, 7, 5, 0)


def test_the_table_of_frames(log, labels, tmp_path):
    out = tmp_path / "frames.csv"
    invoke(log, "--labels", labels, "-m", "ring_intensity", "-m", "none", "-o", out, code=0)
    table = rows(out)
    assert tuple(table[0]) == ("recording", "method", "frame", "stamp_ns", *ALARM_COLUMNS)
    assert [(row["method"], int(row["frame"])) for row in table] == [
        (method, frame) for frame in range(FRAMES) for method in ("ring_intensity", "none", "ideal")
    ]
    second = {"targets": "1", "visible": "1", "detected": "1", "omitted_alarms": "0", "clusters": "2"}
    second |= {"recording": "log", "stamp_ns": str(START_NS + PERIOD_NS), "false_alarms": "1"}
    second |= {"points_in": "30", "points_out": "20"}
    assert {name: table[3][name] for name in second} == second
    assert [table[-1][name] for name in ALARM_COLUMNS] == ["", "", "", "", "2", "", "20", "20"]


def test_point_labels_add_columns(tmp_path):
    log, out = make_log(tmp_path / "log.mcap", LABELLED), tmp_path / "frames.csv"
    found = figures(log, "--labels", log, "-m", "ring_intensity", "-o", out)["methods"]["ring_intensity"]
    assert (found["frames"], found["N_FP"], found["N_FN"]) == (6, 2, 1)
    counts = {"target_points_in": 50, "target_points_out": 40, "clutter_points_in": 80, "clutter_points_out": 20}
    assert {name: found[name] for name in counts} == counts
    assert found["clutter_removal"] == found["point_recall"] == 0.75
    assert found["target_loss"] == 0.2
    assert found["point_precision"] == pytest.approx(60 / 70)
    assert found["R_c"] == pytest.approx(20 / 60)
    table = rows(out)
    assert {name: sum(int(row[name]) for row in table) for name in POINT_COLUMNS} == counts


def test_recordings_with_and_without_point_labels(log, labels, tmp_path):
    inside = make_log(tmp_path / "points.mcap", LABELLED)
    out = tmp_path / "frames.csv"
    invoke(log, inside, "--labels", labels, "--labels", inside, "-m", "none", "-o", out, code=0)
    table = rows(out)
    assert {row["target_points_in"] for row in table if row["recording"] == "log"} == {""}
    assert all(row["target_points_in"] for row in table if row["recording"] == "points")


PAPER = "global_intensity@0.80 global_intensity@0.90 ring_intensity ring_intensity_outlier joint"


@pytest.mark.parametrize(
    ("comparison", "names"),
    [
        ("paper", PAPER),
        ("peers", "joint confirmed sor ror dror adaptive_radius dsor lior lidsor naive patchwork"),
        ("all", f"{PAPER} confirmed sor ror dror adaptive_radius dsor lior lidsor naive patchwork"),
    ],
)
def test_comparisons(log, labels, tmp_path, comparison, names):
    out, summary = tmp_path / "frames.csv", tmp_path / "summary.json"
    result = invoke(
        log, "--labels", labels, "--compare", comparison, "-m", "none", "-o", out, "--summary", summary, code=0
    )
    expected = [*filter(is_installed, names.split()), "none"]
    found = json.loads(summary.read_text())
    assert next(iter(found.items())) == ("schema_version", 1)
    assert list(found["configs"]) == expected
    assert list(found["methods"]) == [*expected, "ideal"]
    assert [row["method"] for row in rows(out)] == [*expected, "ideal"] * FRAMES
    assert all(len(line) <= 80 for line in result.stdout.splitlines())
    assert all(name in result.stdout for name in expected)


def test_peers_that_are_not_installed_are_left_out(log, labels, monkeypatch):
    monkeypatch.setitem(sys.modules, "pypatchworkpp", None)
    result = invoke(log, "--labels", labels, "--compare", "peers", code=0)
    assert "naive" in result.stdout
    assert "patchwork" not in result.stdout
    assert result.stderr.count("not installed: patchwork (pip install 'seaclutter[peers]')") == 1
    result = invoke(log, "--labels", labels, "-m", "patchwork", code=1)
    assert "requires an optional dependency: pip install 'seaclutter[peers]'" in result.stderr


def test_every_recording_starts_without_state(labels, tmp_path):
    logs = [make_log(tmp_path / f"{name}.mcap") for name in "ab"]
    out = tmp_path / "frames.csv"
    result = invoke(*logs, "--labels", labels, "--labels", labels, "--compare", "paper", "-o", out, code=0)
    first, second = ([row | {"recording": ""} for row in rows(out) if row["recording"] == name] for name in "ab")
    assert first == second
    assert "2 recordings; 10 labelled frames, 2 unlabelled\n" in result.stdout


def test_configuration_reaches_the_methods_that_have_the_key(log, labels, tmp_path):
    config = tmp_path / "c.yaml"
    config.write_text("filter: {method: joint, start_m: 12.5, end_m: 72.5, update_weight: 0.7}\n")
    arguments = (log, "--labels", labels, "-c", config, "--compare", "paper", "-m", "none")
    found = figures(*arguments, "-s", "filter.max_neighbors=9", "-s", "evaluation.min_cluster_points=3")["configs"]
    assert found["joint"]["filter"]["update_weight"] == 0.7
    assert {name for name, made in found.items() if made["filter"].get("max_neighbors") == 9} == {
        "joint",
        "ring_intensity_outlier",
    }
    assert [found[f"global_intensity@0.{rate}0"]["filter"]["filter_rate"] for rate in (8, 9)] == [0.8, 0.9]
    assert all(made["filter"]["start_m"] == 12.5 for name, made in found.items() if name != "none")
    assert all(made["evaluation"]["min_cluster_points"] == 3 for made in found.values())


def test_a_nested_key_reaches_the_method_that_has_it(log, labels):
    arguments = (log, "--labels", labels, "-m", "adaptive_radius", "-m", "none")
    found = figures(*arguments, "-s", "filter.presets.open.min_neighbors=3")["configs"]
    assert found["adaptive_radius"]["filter"]["presets"]["open"] == {"radius_ratio": 0.015, "min_neighbors": 3}


def test_density_based_clusters(log, labels):
    """Lumps are rows of ten points, an eighth of a metre apart: a core point has up to four neighbours in 0.25 m."""
    arguments = (log, "--labels", labels, "-m", "none", "-s", "evaluation.cluster_tolerance_m=0.25")
    for needed, clusters, unclustered in ((5, 2, 0), (6, 0, 20)):
        options = ("--clustering", "dbscan", "-s", f"evaluation.dbscan_min_points={needed}")
        found = figures(*arguments, *options)
        assert found["configs"]["none"]["evaluation"]["clustering"] == "dbscan"
        assert found["methods"]["none"]["clusters_per_frame"] == clusters * 11 / 10
        assert found["methods"]["none"]["unclustered_points_per_frame"] == unclustered * 11 / 10
        assert "noise  unclustered" in invoke(*arguments, *options).stdout
    assert figures(*arguments)["methods"]["none"]["clusters_per_frame"] == 2.2
    assert "unclustered" not in invoke(*arguments).stdout


def test_the_default_method_is_that_of_the_configuration(log, labels, tmp_path):
    assert list(figures(log, "--labels", labels)["methods"]) == ["joint"]
    config = tmp_path / "c.yaml"
    config.write_text("filter: {method: ror}\n")
    assert list(figures(log, "--labels", labels, "-c", config)["methods"]) == ["ror"]


def test_a_part_of_a_recording_does_not_need_all_labels(log, labels):
    found = figures(log, "--labels", labels, "-m", "none", "-n", 2)["methods"]["none"]
    assert (found["frames"], found["unlabelled_frames"]) == (2, 0)
    found = figures(log, "--labels", labels, "-m", "none", "--start", 0.35)["methods"]["none"]
    assert (found["frames"], found["unlabelled_frames"]) == (1, 1)


def test_labels_of_another_recording(log, tmp_path):
    labels = make_labels(tmp_path / "long.csv", frames=range(9))
    out = tmp_path / "frames.csv"
    result = invoke(log, "--labels", labels, "-m", "none", "-o", out, code=1)
    assert "frame" in result.stderr
    assert not out.exists()


def test_a_frame_that_no_method_can_use_is_damage(tmp_path, labels):
    entries = []
    for number in range(FRAMES):
        points = sea(number)
        fields = ["x", "y", "z"] if number == 5 else ["x", "y", "z", "intensity"]
        plain = np.zeros(len(points), [(name, "<f4") for name in fields])
        for name in fields:
            plain[name] = points[name]
        stamp = START_NS + number * PERIOD_NS
        entries.append(Entry("/points", stamp, cloud_message("ros2", plain, stamp)))
    log = write_log(tmp_path / "log.mcap", [cloud_topic("/points")], entries)
    found = figures(log, "--labels", labels, "--compare", "paper", "-m", "ror", status=3)
    frames = {name: method["frames"] + method["unlabelled_frames"] for name, method in found["methods"].items()}
    assert frames.pop("ror") == 6
    assert set(frames.values()) == {5}
    assert len(found["recordings"][0]["damage"]) == 1


def test_a_warning_if_no_frame_is_labelled(log, labels):
    result = invoke(log, "--labels", labels, "-m", "none", "--start", 0.45, code=0)
    assert "no frame is labelled" in result.stderr
    assert result.stdout.splitlines()[4].split() == ["none", "0", "0", "0", *"––––"]


def table_of(text, first):
    """Return a printed table as text of its cells by method and head; ``first`` is the head after the methods."""
    lines = next(block.splitlines() for block in text.split("\n\n") if block.split()[:2] == ["method", first])
    heads = re.split("  +", lines[0])
    return {cells[0]: dict(zip(heads, cells, strict=True)) for cells in (re.split("  +", line) for line in lines[1:])}


def test_rates_without_visible_targets_are_unknown(log, tmp_path):
    """Boxes 50 m above the points: nothing can be missed, which is no success."""
    labels = tmp_path / "high.csv"
    labels.write_text("\n".join((HEAD, *(f"{k},1,boat,30.5,0,50,3,2,2,0" for k in range(FRAMES)), "")))
    result = invoke(log, "--labels", labels, "-m", "ring_intensity")
    found = table_of(result.stdout, "frames")["ring_intensity"]
    assert (found["R_FN %"], found["F1"]) == ("–", "–")
    assert "\n6 targets, 0 visible (at least 5 points)\n" in result.stdout
    assert re.search("^– +nothing to count$", result.stdout, re.MULTILINE)
    found = figures(log, "--labels", labels, "-m", "ring_intensity")["methods"]["ring_intensity"]
    assert (found["R_FN"], found["recall"], found["f1"]) == (None, None, None)


def test_the_title_says_what_is_compared(tmp_path):
    log = make_log(tmp_path / "log.mcap", LABELLED)
    title = invoke(log, "--labels", log, "-m", "none").stdout.split("\n\n")[0]
    assert title.splitlines()[1:] == ["5 targets, 5 visible (at least 5 points)", "50 target points, 80 clutter points"]


def best_in(table, head):
    return {name for name, row in table.items() if row[head].startswith("*")}


@pytest.mark.parametrize("options", [[], ["--clustering", "dbscan"]])
def test_every_column_is_explained_and_its_best_marked(tmp_path, options):
    log = make_log(tmp_path / "log.mcap", LABELLED)
    text = invoke(log, "--labels", log, "--compare", "paper", "-m", "none", *options).stdout
    *tables, legend = text.split("\n\n")[1:]
    heads = {head.strip() for one in tables for head in re.split("  +", one.splitlines()[0])}
    assert heads - {"method"} <= {line.split("  ")[0] for line in legend.splitlines()}
    alarms, points = table_of(text, "frames"), table_of(text, "clutter")
    assert all(row["frames"] == "6" for row in alarms.values()), "not a merit"
    assert best_in(alarms, "R_FN %") == {"ring_intensity", "ring_intensity_outlier", "joint"}
    assert best_in(alarms, "F1") == best_in(alarms, "R_FN %")
    assert best_in(alarms, "R_FP %") == {"global_intensity@0.80", "global_intensity@0.90"}
    assert points["none"]["target lost"] == "0.00 %", "no filter, no merit"
    assert "*" not in invoke(log, "--labels", log, "-m", "joint").stdout


def test_a_single_warning_about_thresholds_that_cannot_fit(tmp_path, labels):
    def make(number):
        points = sea(number)
        points["intensity"] /= 100
        return points

    log = make_log(tmp_path / "log.mcap", make=make)
    result = invoke(log, "--labels", labels, "--compare", "paper", code=0)
    assert result.stderr.count("no point can pass") == 1
    assert "Warning" not in invoke(log, "--labels", labels, "--compare", "paper", "-q").stderr


@pytest.mark.parametrize(
    ("points", "method", "text"), [(0, "joint", "all clouds are empty"), (None, "confirmed", "no water seen in")]
)
def test_logs_in_which_a_method_sees_nothing_are_said(tmp_path, labels, points, method, text):
    def above(number):
        found = sea(number)[:points]
        found["z"] = np.linspace(1, 3, len(found))
        return found

    log = make_log(tmp_path / "log.mcap", make=above)
    assert text in invoke(log, "--labels", labels, "-m", method).stderr


def test_a_recording_that_fails_at_its_end_leaves_no_rows(log, labels, tmp_path):
    failing, out = make_log(tmp_path / "failing.mcap"), tmp_path / "frames.csv"
    too_long = make_labels(tmp_path / "too_long.csv", frames=range(FRAMES + 1))
    invoke(failing, log, "--labels", too_long, "--labels", labels, "-m", "none", "-o", out, code=1)
    assert {row["recording"] for row in rows(out)} == {"log"}


def test_rows_of_a_single_recording_are_not_in_memory(tmp_path):
    log, labels = make_log(tmp_path / "log.mcap"), tmp_path / "boxes.csv"
    labels.write_text(f"{HEAD}\n0,{BOX}\n")
    (found,) = evaluate(log, labels, frames_file=tmp_path / "frames.csv").outcomes
    assert not isinstance(found.rows.packed, BytesIO)
    assert len((tmp_path / "frames.csv").read_text().splitlines()) == 1 + FRAMES
    assert sorted(path.name for path in tmp_path.iterdir()) == ["boxes.csv", "frames.csv", "log.mcap"]


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (("log.mcap",), 2, "Missing option '--labels'"),
        (("none.mcap", "--labels", "boxes.csv"), 2, "none.mcap: no such file or folder"),
        (("log.mcap", "--labels", "no.csv"), 2, "no.csv"),
        (("log.mcap", "--labels", "boxes.csv", "-m", "magic"), 2, "unknown method 'magic'"),
        (("log.mcap", "--labels", "boxes.csv", "--compare", "magic"), 2, "magic"),
        (("log.mcap", "--labels", "boxes.csv", "-m", "ror", "-s", "filter.end_m=5"), 2, "unknown key"),
        (("log.mcap", "--labels", "boxes.csv", "-m", "ror", "-s", "filter.method=sor"), 2, "name them with --method"),
        (("log.mcap", "--labels", "boxes.csv", "-o", "old.csv"), 2, "old.csv: already exists"),
        (("log.mcap", "--labels", "boxes.csv", "--summary", "old.csv"), 2, "old.csv: already exists"),
        (("log.mcap", "--labels", "boxes.csv", "-o", "log.mcap", "--force"), 2, "is part of the input"),
        (("log.mcap", "--labels", "boxes.csv", "-o", "boxes.csv", "--force"), 2, "is part of the input"),
        (("log.mcap", "--labels", "boxes.csv", "-o", "x.csv", "--summary", "x.csv"), 2, "given for two outputs"),
        (("log.mcap", "--labels", "boxes.csv", "--intensity-field", "power"), 1, "no field 'power'"),
        (("two.mcap", "--labels", "boxes.csv"), 2, "choose from: -t /a -t /b"),
        (("two.mcap", "--labels", "boxes.csv", "-t", "/a", "-t", "/b"), 2, "choose one: -t /a or -t /b"),
        (("plain.mcap", "--labels", "boxes.csv"), 1, "no intensity field"),
    ],
)
def test_refused_arguments(tmp_path, monkeypatch, arguments, status, message):
    monkeypatch.chdir(tmp_path)
    make_log(tmp_path / "log.mcap")
    make_log(tmp_path / "two.mcap", topics=("/a", "/b"))
    make_log(tmp_path / "plain.mcap", dtype=np.dtype(POINT.descr[:3]))
    make_labels(tmp_path / "boxes.csv")
    (tmp_path / "old.csv").write_bytes(b"")
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    result = invoke(*arguments)
    assert (result.exit_code, message in result.stderr) == (status, True), result.stderr
    assert isinstance(result.exception, SystemExit)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before
