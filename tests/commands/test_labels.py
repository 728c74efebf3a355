"""``seaclutter labels check`` and the same warnings of other commands."""

import csv
import json
import math
import shutil

import pytest

from tests.paths import ROOT
from tests.running import execute as run

SEA = ROOT / "samples" / "sea.mcap"
LABELS = ROOT / "samples" / "sea.labels.csv"
MARINE = (
    *("buoy_speedboat", "calm", "clutter_only", "departure", "harbour", "lock", "moored_rows", "narrow_channel"),
    *("occlusion", "passing_speedboat", "rough", "apple", "poplar", "willow"),
)


def check(log, labels, *arguments):
    return run("labels", "check", log, "--labels", labels, *arguments)


def rewritten(path, change):
    """Write the labels of the sample with changed rows; ``change`` returns a row or several."""
    with LABELS.open() as stream:
        rows = list(csv.DictReader(stream))
    with path.open("w") as stream:
        writer = csv.DictWriter(stream, list(rows[0]))
        writer.writeheader()
        for row in rows:
            made = change(row)
            writer.writerows(made if isinstance(made, list) else [made])
    return path


def test_the_sample_has_no_mistake():
    result = check(SEA, LABELS)
    assert (result.exit_code, result.stderr) == (0, "")
    assert "60 labelled frames, 0 unlabelled\n60 areas to ignore; labels of points in 60 frames\n" in result.stdout
    assert result.stdout.endswith("\nNo mistake found.\n")
    (found,) = json.loads(check(SEA, LABELS, "--json").stdout)["recordings"]
    assert (found["boxes"], found["visible"], found["areas_to_ignore"], found["findings"]) == (120, 120, 60, [])
    assert found["classes"]["speedboat"]["length_m"] == pytest.approx(9, abs=0.3)


@pytest.mark.parametrize("log", ["rs-lidar-32.pcap", "sea.mcap"])
def test_no_warnings_on_samples_with_their_own_labels(log):
    path = SEA.with_name(log)
    labels = path.with_suffix(".labels.csv")
    assert "labels: " not in run("evaluate", path, "--labels", labels, "-m", "none", "-n", 20).stderr
    assert check(path, labels, "-n", 20).exit_code == 0


@pytest.mark.parametrize("scene", MARINE)
def test_simulated_scenes_have_no_mistake(tmp_path, scene):
    run("simulate", scene, "-n", 2, "--seed", 1, "-o", tmp_path / "a.mcap")
    (found,) = json.loads(check(tmp_path / "a.mcap", tmp_path / "a.labels.csv", "--json").stdout)["recordings"]
    assert found["findings"] == []
    assert found["frames"] == 2


MISTAKES = {
    "degrees": (lambda row: row | {"yaw": math.degrees(float(row["yaw"]))}, "they seem to be in degrees"),
    "swapped": (lambda row: row | {"length": row["width"], "width": row["length"]}, "lengths and widths are swapped"),
    "x and y": (lambda row: row | {"x": row["y"], "y": row["x"]}, "x and y are swapped"),
    "high": (lambda row: row | {"z": float(row["z"]) + 50}, "positions are off by about +50 m in z"),
    "twice": (lambda row: [row, row | {"track_id": f"{row['track_id']}b"}], "120 of 240 boxes repeat another one"),
    "ignored": (lambda row: row | {"class": row["class"].replace("ignore", "ignored")}, "rename it"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes_are_found_and_evaluate_warns(tmp_path, name):
    change, expected = MISTAKES[name]
    labels = rewritten(tmp_path / "labels.csv", change)
    result = check(SEA, labels, "-n", 60)
    assert result.exit_code == 1
    listed = " ".join(result.stdout.partition("Probable mistakes:\n* ")[2].split())
    assert expected in listed
    assert all(len(line) <= 80 for line in result.stdout.splitlines()[1:])
    warnings = run("evaluate", SEA, "--labels", labels, "-m", "none").stderr.splitlines()
    assert [line for line in warnings if expected in line and line.startswith("Warning: sea: labels: ")]


def test_ignore_in_any_case_is_an_area(tmp_path):
    labels = rewritten(tmp_path / "labels.csv", lambda row: row | {"class": row["class"].title()})
    result = check(SEA, labels)
    assert "60 areas to ignore" in result.stdout
    assert result.exit_code == 0


def test_a_report_on_a_filtered_log_warns(tmp_path):
    labels = rewritten(tmp_path / "labels.csv", MISTAKES["x and y"][0])
    run("filter", SEA, "-o", tmp_path / "f.mcap", "--keep-raw", "--with-removed", "-n", 12)
    result = run("report", tmp_path / "f.mcap", "--labels", labels, "-n", 12, "-o", tmp_path / "r.html")
    assert "labels: it seems that x and y are swapped" in result.stderr


def test_labels_of_points_are_counted():
    (found,) = json.loads(check(SEA, SEA, "--json", "-n", 5).stdout)["recordings"]
    assert (found["boxes"], found["frames_with_labelled_points"], found["findings"]) == (0, 5, [])


def test_several_recordings(tmp_path):
    bad = rewritten(tmp_path / "labels.csv", MISTAKES["x and y"][0])
    copy = shutil.copy(SEA, tmp_path / "copy.mcap")
    result = check(SEA, LABELS, copy, "--labels", bad, "-n", 12)
    assert result.exit_code == 1
    assert result.stdout.count("No mistake found.") == 1
    assert "1 probable mistake" in result.stderr


@pytest.mark.parametrize(
    ("labels", "status", "message"),
    [("none.csv", 2, "no such file"), ("text.csv", 1, "no labels in a known format")],
)
def test_labels_that_cannot_be_read(tmp_path, labels, status, message):
    (tmp_path / "text.csv").write_text("no labels\n")
    result = check(SEA, tmp_path / labels)
    assert (result.exit_code, result.stdout) == (status, "")
    assert message in result.stderr


def test_folders_in_folders_are_searched_on_request(tmp_path):
    (tmp_path / "logs" / "day").mkdir(parents=True)
    for path in (tmp_path / "logs" / "a.mcap", tmp_path / "logs" / "day" / "b.mcap"):
        shutil.copy(SEA, path)
    labels = ["--labels", LABELS, "--labels", LABELS]
    result = run("labels", "check", tmp_path / "logs", *labels, "--recursive", "-n", 3, "--json")
    assert [one["recording"] for one in json.loads(result.stdout)["recordings"]] == ["a", "b"]
    left_out = run("labels", "check", tmp_path / "logs", "--labels", LABELS, "-n", 3)
    assert "the recordings in day are left out; --recursive includes them" in left_out.stderr
