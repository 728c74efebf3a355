"""``seaclutter labels propose`` and ``labels compare``."""

import csv
import json
import re

import numpy as np
import pytest
from click.testing import CliRunner

import seaclutter
from seaclutter_cli.commands import cli
from seaclutter_cli.labels import open_labels
from seaclutter_cli.runs.label_proposal import FOLDER_FORMS, proposals
from tests.paths import ROOT

SEA = ROOT / "samples" / "sea.mcap"
TRUTH = ROOT / "samples" / "sea.labels.csv"


def run(*words, code=0):
    result = CliRunner().invoke(cli, [str(word) for word in words])
    assert result.exit_code == code, result.output
    return result


@pytest.fixture(scope="module")
def proposed(tmp_path_factory):
    path = tmp_path_factory.mktemp("labels") / "sea.labels.csv"
    run("labels", "propose", SEA, "-n", 30, "-o", path)
    return path


def test_proposals_are_near_the_truth(proposed, tmp_path):
    lines = TRUTH.read_text().splitlines(keepends=True)
    part = tmp_path / "part.csv"
    chosen = [line for line in lines[1:] if int(line.split(",")[0]) < 30 and ",ignore," not in line]  # own ship
    part.write_text("".join([lines[0], *chosen]))
    found = seaclutter.compare_labels(proposed, part)
    assert found.frames == 30
    assert found.recall > 0.9
    assert found.precision > 0.9
    assert found.ids_changed == 0


def test_evaluate_warns_until_they_are_corrected(proposed, tmp_path):
    warning = "the method judges itself"
    assert warning in run("evaluate", SEA, "-n", 30, "--labels", proposed, "-m", "none").stderr
    with proposed.open(newline="") as file:
        rows = [{**row, "proposed": ""} for row in csv.DictReader(file)]
    with (tmp_path / "sea.labels.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    assert warning not in run("evaluate", SEA, "-n", 30, "--labels", tmp_path / "sea.labels.csv", "-m", "none").stderr
    assert seaclutter.compare_labels(proposed, tmp_path / "sea.labels.csv").changes["unchanged"] == len(rows)


@pytest.mark.parametrize("form", FOLDER_FORMS)
def test_folders_have_clouds_and_the_same_boxes(form, tmp_path):
    run("labels", "propose", SEA, "-n", 5, "-o", tmp_path / "scene", "--to", form)
    run("labels", "propose", SEA, "-n", 5, "-o", tmp_path / "sea.csv")
    same = seaclutter.compare_labels(tmp_path / "sea.csv", tmp_path / "scene")
    assert (same.frames, same.changes["unchanged"]) == (5, same.boxes_after)
    clouds = tmp_path / "scene" / FOLDER_FORMS[form].clouds
    with seaclutter.open_log(clouds) as log:
        frames = list(log.frames())
    assert len(frames) == 5
    labels = open_labels(tmp_path / "scene")
    assert all(labels.truth(frame).proposed for frame in frames)
    assert "exists" in run("labels", "propose", SEA, "-o", tmp_path / "scene", "--to", form, "--force", code=2).stderr


def test_edited_boxes_are_no_longer_proposed(tmp_path):
    run("labels", "propose", SEA, "-n", 4, "-o", tmp_path / "scene", "--to", "sustechpoints")
    path = tmp_path / "scene" / "label" / "000001.json"
    boxes = [{key: value for key, value in box.items() if key != "annotator"} for box in json.loads(path.read_text())]
    path.write_text(json.dumps(boxes))
    labels = open_labels(tmp_path / "scene")
    with seaclutter.open_log(SEA) as log:
        first, second = (labels.truth(frame) for frame, _ in zip(log.frames(), range(2), strict=False))
    assert (first.proposed > 0, second.proposed) == (True, 0)


def test_doubtful_tracks_come_first_short_ones_are_left_out_and_structures_are_ignored():
    size = {"y_m": 0.0, "z_m": 0.0, "length_m": 1.0, "width_m": 1.0, "height_m": 1.0, "yaw_rad": 0.0}
    kinds = {1: "structure", 2: "buoy", 3: "buoy"}
    rows = [
        {
            **size,
            "x_m": 20.0 * track,
            "frame": frame,
            "track_id": track,
            "score": score,
            "state": state,
            "class": kinds[track],
        }
        for track, score, state, frames in (
            (1, 1.0, "confirmed", 4),
            (2, 0.3, "candidate", 3),
            (3, 0.1, "candidate", 2),
        )
        for frame in range(frames)
    ]
    found = proposals(rows)
    assert [one.labelled.track for one in found] == ["2"] * 3 + ["1"] * 4
    assert [one.mark for one in found] == ["doubtful"] * 3 + ["sure"] * 4
    assert [one.labelled.kind for one in found] == ["buoy"] * 3 + ["ignore"] * 4


@pytest.mark.parametrize(
    ("middle", "yaw", "boat", "mark"),
    [
        ((0, 20), 0.0, (0, 10), "sure"),
        ((0, 20), 0.0, (20, 22), "doubtful"),
        ((0, 20), np.pi / 2, (0, 60), "doubtful"),
        ((0, 20), np.pi / 2, (10, 10), "doubtful"),
        ((40, 20), np.pi / 2, (0, 10), "sure"),
    ],
    ids=["behind a boat", "around a boat", "around own ship", "around both", "beside both"],
)
def test_areas_to_ignore_around_what_floats_are_doubtful(middle, yaw, boat, mark):
    size = {"z_m": 0.0, "height_m": 4.0, "score": 1.0, "state": "confirmed"}
    quay = {"track_id": 1, "class": "structure", "length_m": 60.0, "width_m": 8.0, "yaw_rad": yaw}
    other = {"track_id": 2, "class": "vessel", "length_m": 15.0, "width_m": 4.0, "yaw_rad": 0.0}
    objects = (dict(zip(("x_m", "y_m"), at, strict=True)) | size | own for at, own in ((middle, quay), (boat, other)))
    found = proposals({**one, "frame": frame} for one in objects for frame in range(3))
    assert {(one.labelled.kind, one.mark) for one in found} == {("ignore", mark), ("vessel", "sure")}


def test_frames_without_objects_are_labelled_as_empty(tmp_path):
    scene = tmp_path / "empty.mcap"
    seaclutter.simulate("clutter_only", scene, frames=3)
    run("labels", "propose", scene, "-o", tmp_path / "e.csv")
    assert (tmp_path / "e.csv").read_text().splitlines()[1:] == [f"{k},,none,,,,,,,,sure," for k in range(3)]


def test_labels_by_stamps_cannot_be_compared(tmp_path):
    lines = TRUTH.read_text().splitlines()
    path = tmp_path / "stamps.csv"
    path.write_text("\n".join(line.replace("frame", "stamp_ns") for line in lines[:2]))
    assert "by stamps" in run("labels", "compare", path, TRUTH, code=1).stderr


def test_labels_of_points_cannot_be_compared(tmp_path):
    (tmp_path / "000000.label").write_bytes(bytes(8))
    for path in (tmp_path, SEA):
        assert "labels of points" in run("labels", "compare", TRUTH, path, code=1).stderr


def test_comparison_counts_each_change(tmp_path):
    head, *_ = TRUTH.read_text().splitlines()
    for name, rows in {
        "a": ("0,1,boat,0,0,0,4,2,1,0", "0,2,boat,20,0,0,4,2,1,0", "0,3,boat,40,0,0,4,2,1,0", "1,1,boat,0,0,0,4,2,1,0"),
        "b": ("0,1,boat,0,0,0,4,2,1,0", "0,2,buoy,20.5,0,0,4,2,1,0", "0,9,boat,60,0,0,4,2,1,0"),
    }.items():
        (tmp_path / f"{name}.csv").write_text("\n".join((head, *rows)))
    found = seaclutter.compare_labels(tmp_path / "a.csv", tmp_path / "b.csv")
    assert dict(found.changes) == {"unchanged": 1, "moved": 1, "class": 1, "deleted": 1, "added": 1}
    assert (found.only_before, found.good, found.frames) == (1, 2, 1)
    assert "0.89" in found.as_text()  # mean of 1 and 3.5 / 4.5
    back = seaclutter.compare_labels(tmp_path / "b.csv", tmp_path / "a.csv")
    assert (back.only_before, back.only_after, back.frames) == (0, 1, 2)
    assert "1 frame of the labels after had none before; their boxes count as added" in back.as_text()
    assert all(len(line) <= 80 for line in back.as_text().splitlines())


def test_what_is_left_out_of_a_folder_is_said_once(tmp_path):
    for name in "a.mcap", "inner/b.mcap":
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(SEA.read_bytes())
    result = run("labels", "propose", tmp_path, "-n", 3, "-o", tmp_path / "labels" / "")
    assert result.stderr.count("--recursive includes") == 1
    assert all(len(line) <= 80 for line in result.stdout.splitlines())


def as_sustechpoints_reads(path):
    """Return the columns of a binary PCD file after the rules of SUSTechPOINTS: its regular expressions and types."""
    data = path.read_bytes()
    head = re.search(rb"[\r\n]DATA\s(\S*)\s", data)
    assert head[1] == b"binary"
    text = re.sub("#.*", "", data[: head.end()].decode())
    # Anywhere in the header, whatever the case: a field named return_type would be taken for the types.
    fields, sizes, kinds, counts = (
        re.search(f"{key} (.*)", text, re.IGNORECASE)[1].split(" ") for key in ["FIELDS", "SIZE", "TYPE", "COUNT"]
    )
    assert set(counts) == {"1"}
    offsets = np.cumsum([0, *map(int, sizes)])
    layout = dict(zip(fields, zip(kinds, sizes, strict=True), strict=True))
    assert {layout[name] for name in "xyz"} <= {("F", "4"), ("F", "8")}
    assert layout["intensity"] in {("F", "4"), ("U", "1")}
    types = [f"<{kind.lower()}{size}" for kind, size in zip(kinds, sizes, strict=True)]
    whole = np.dtype({"names": fields, "formats": types, "offsets": offsets[:-1], "itemsize": offsets[-1]})
    return np.frombuffer(data[head.end() :], whole, count=int(re.search("POINTS (.*)", text, re.IGNORECASE)[1]))


def test_sustechpoints_opens_the_folder_as_it_lies(tmp_path):
    """Its server lists ``lidar``, and reads and writes ``label/FRAME.json``; its page makes boxes of what it reads."""
    path = tmp_path / "log"
    path.mkdir()
    with seaclutter.open_log(SEA) as log:
        for k, frame in zip(range(6), log.frames(), strict=False):
            columns = dict(zip("xyz", frame.coordinates, strict=True), intensity=frame.intensity.astype(np.uint16))
            np.savez(path / f"{k:03d}.npz", return_type=np.zeros(frame.size, np.uint8), **columns)
    run(
        "labels", "propose", path, "-o", tmp_path / "scene", "--to", "sustechpoints", "-s", "filter.use_intensity=false"
    )
    names = sorted(one.stem for one in (tmp_path / "scene" / "lidar").iterdir())
    assert names == [f"{k:06d}" for k in range(6)]
    assert {one.suffix for one in (tmp_path / "scene" / "lidar").iterdir()} == {".pcd"}
    assert np.allclose(
        as_sustechpoints_reads(tmp_path / "scene" / "lidar" / "000005.pcd")["x"], columns["x"], atol=1e-4
    )
    for name in names:
        file = tmp_path / "scene" / "label" / f"{name}.json"
        boxes = json.loads(file.read_text())
        assert boxes
        for box in boxes:
            assert all(
                isinstance(box["psr"][key][axis], float) for key in ("position", "scale", "rotation") for axis in "xyz"
            )
            assert isinstance(box["obj_id"], str)
            assert isinstance(box["obj_type"], str)
        # A page that is saved writes these keys, and the annotator of boxes that nobody has touched.
        kept = [{key: box[key] for key in ("psr", "obj_type", "obj_id", "annotator")} for box in boxes]
        del kept[0]["annotator"]
        file.write_text(json.dumps(kept, indent=2, sort_keys=True))
    labels = open_labels(tmp_path / "scene")
    with seaclutter.open_log(tmp_path / "scene" / "lidar") as log:
        for frame in log.frames():
            truth = labels.truth(frame)
            assert truth.proposed == len(truth.targets) + len(truth.ignored) - 1


def rates(log, labels, *arguments, code=0):
    """Return the frames, false alarms and missed targets of `joint`."""
    told = json.loads(run("evaluate", log, "--labels", labels, "-m", "joint", "--json", *arguments, code=code).stdout)
    return [told["methods"]["joint"][key] for key in ("frames", "N_FP", "N_FN")]


def test_labels_by_frame_fit_folders_that_are_a_part_or_damaged(proposed, tmp_path):
    run("convert", SEA, "--start", 1, "-n", 12, "-o", tmp_path / "part", "--to", "pcd")
    wanted = rates(SEA, proposed, "--start", 1, "-n", 12)
    assert rates(tmp_path / "part", proposed) == wanted
    run("convert", SEA, "-n", 30, "-o", tmp_path / "whole", "--to", "pcd")
    files = sorted((tmp_path / "whole").glob("*.pcd"))
    for file in files[:10]:
        file.write_bytes(file.read_bytes()[:300])
    assert rates(tmp_path / "whole", proposed, code=3) == rates(SEA, proposed, "--start", 1, "-n", 20)
    with seaclutter.open_log(tmp_path / "whole") as log:
        assert [frame.index for frame in log.frames()] == list(range(10, 30))


def test_a_folder_of_a_part_does_not_label_the_whole_log(tmp_path):
    run("labels", "propose", SEA, "--start", 1, "-n", 5, "-o", tmp_path / "scene", "--to", "sustechpoints")
    assert rates(tmp_path / "scene", tmp_path / "scene")[0] == 5
    refused = run("evaluate", SEA, "--labels", tmp_path / "scene", "-m", "joint", code=1)
    assert "labels of 5 clouds from number 10 on, a part of a log; use their folder as the log" in refused.stderr
