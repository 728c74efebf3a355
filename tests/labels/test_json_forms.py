"""Labels in the formats of SeePerSea and SUSTechPOINTS."""

import json

import numpy as np
import pytest

from seaclutter_cli.errors import LabelError
from seaclutter_cli.labels import open_labels
from seaclutter_cli.messages import find_codec
from seaclutter_cli.sources.frame_files.folder import FolderSource
from tests.labels.frames import boxes, frame, put, seepersea_json, sustechpoints_json, write

SHIP = boxes(("1", "ship", 10, 20, 1.5, 4, 12, 3, 0.5))


def labelled(path, frames):
    labels = open_labels(path)
    return [number for number in range(frames) if labels.truth(frame(number))]


def test_seepersea_width_is_along_x(tmp_path):
    box = {
        "dimension": {"width": 2.0, "length": 8.0, "height": 1.0},
        "location": {"x": 10.0, "y": 0.0, "z": 0.5},
        "orientation": {"rotationYaw": np.pi / 2},
    }
    content = {"labels": [{"category": "ship", "box3d": box}]}
    put(tmp_path / "annotations/000000.json", json.dumps(content))
    targets = open_labels(tmp_path).truth(frame()).targets
    assert targets.classes == ("ship",)
    xyz = np.array([[6.5, 0, 0.5], [13.5, 0, 0.5], [10, 3.5, 0.5], [10, 0, 1.2]]).T
    assert targets.covers(xyz, 0).tolist() == [True, True, False, False]


@pytest.mark.parametrize("empty", [b"", b" \n", b"\xef\xbb\xbf", b"{}", b"[]", b"null"])
def test_an_empty_seepersea_file_is_an_unlabelled_frame(tmp_path, empty):
    for number in range(4):
        content = json.dumps(seepersea_json(SHIP)) if number == 2 else empty
        put(tmp_path / f"annotations/{number:06d}.json", content)
    assert labelled(tmp_path, 4) == [2]


def test_a_seepersea_test_split(tmp_path):
    for number in range(3):
        put(tmp_path / f"annotations/{number:06d}.json")
    labels = open_labels(tmp_path)
    assert [labels.truth(frame(number)) for number in range(3)] == [None] * 3
    with pytest.raises(LabelError, match="no frame of the log is labelled"):
        labels.finish()


def test_no_boxes_is_not_unlabelled(tmp_path):
    put(tmp_path / "annotations/000000.json", '{"labels": []}')
    assert len(open_labels(tmp_path).truth(frame()).targets) == 0


def test_equal_tracks_of_several_categories(tmp_path):
    two = boxes(*[("1", kind, 10, 20, 1.5, 4, 12, 3, 0.5) for kind in ("ship", "buoy", "other")])
    put(tmp_path / "annotations/000000.json", json.dumps(seepersea_json(two)))
    assert len(set(open_labels(tmp_path).truth(frame()).targets.tracks)) == 3


@pytest.mark.parametrize(
    ("removed", "name"), [("annotations/000002.json", "000002.pcd"), ("point_clouds/000001.pcd", "1")]
)
def test_clouds_and_annotations_that_do_not_match(tmp_path, removed, name):
    path, _ = write("seepersea", tmp_path)
    (path / removed).unlink()
    with pytest.raises(LabelError, match=rf"no .*frame (00000)?{name}.*label files, . frames"):
        open_labels(path)


@pytest.mark.parametrize(
    "names",
    [
        ["frame2", "frame10", "frame1"],
        ["1673400472.5", "1673400472.138016", "1673400473.25"],
        ["000007", "000008", "000010"],
        ["a", "b", "B"],
    ],
)
def test_files_are_in_frame_order(tmp_path, names):
    point = np.zeros(1, "<f4, <f4, <f4, <f4")
    for number, name in enumerate(names):
        point["f0"] = number
        header = (
            "VERSION .7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA binary\n"
        )
        put(tmp_path / f"point_clouds/{name}.pcd", header.encode() + point.tobytes())
        target = boxes((number, "ship", *SHIP.centers[0], 1, 1, 1, 0))
        put(tmp_path / f"annotations/{name}.json", json.dumps(seepersea_json(target)))
    source = FolderSource(tmp_path)
    codec = find_codec(source.channels[0])
    labels = open_labels(tmp_path)
    for index, message in enumerate(source.records()):
        value = codec.decode(message.data).points["x"][0]
        assert labels.truth(frame(index)).targets.tracks == (str(int(value)),)
    assert index == 2


def test_hidden_files_are_left_out(tmp_path):
    path, frames = write("seepersea", tmp_path)
    put(path / "annotations/._000000.json", b"\x00\x05\x16\x07")
    put(path / "annotations/.DS_Store")
    assert open_labels(path).truth(frames[0]) is not None


@pytest.mark.parametrize(("names", "frames"), [("0 1 2", [0, 1, 2]), ("2 5", [2, 5]), ("0 4", [0, 4]), ("0003", [0])])
def test_sustechpoints_numbers_without_clouds(tmp_path, names, frames):
    for name in names.split():
        put(tmp_path / f"label/{name}.json", json.dumps(sustechpoints_json(SHIP)))
    assert labelled(tmp_path, frames[-1] + 1) == frames


@pytest.mark.parametrize("names", ["x1 x2 x10", "7 8 9", "1 01 2"])
def test_sustechpoints_files_by_order_cover_all_frames(tmp_path, names):
    for name in names.split():
        put(tmp_path / f"label/{name}.json", json.dumps(sustechpoints_json(SHIP)))
    assert labelled(tmp_path, 3) == [0, 1, 2]
    with pytest.raises(LabelError, match="no label file for frame 3 of the log, only 3 files"):
        open_labels(tmp_path).truth(frame(3))


def test_sustechpoints_with_clouds_may_label_some_of_them(tmp_path):
    path, _ = write("sustechpoints", tmp_path)
    for number in (0, 2):
        (path / f"label/{number:06d}.json").unlink()
    put(path / "desc.json", "{}")
    assert labelled(path, 4) == [1, 3]
    (path / "lidar/000003.pcd").unlink()
    with pytest.raises(LabelError, match="no frame 000003 in"):
        open_labels(path)


def test_sustechpoints_as_published(tmp_path):
    content = (
        '[{"psr": {"position": {"x": 4.1, "y": -49.7, "z": 1.8}, "scale": {"x": 4.5, "y": 1.7, "z": 1.6}, "rotation": '
        '{"x": -0.05, "y": 0.003, "z": 1.45}}, "obj_type": "Car", "obj_id": "", "annotator": "a"}, '
        '{"psr": {"position": {"x": 1, "y": 2, "z": 3}, "scale": {"x": 4, "y": 5, "z": 6}, "rotation": '
        '{"x": 0, "y": 0, "z": 0}}, "obj_type": "ignore", "obj_id": 5}]'
    )
    put(tmp_path / "label/000950.json", content)
    truth = open_labels(tmp_path).truth(frame())
    assert truth.targets.tracks == ("#0",)
    assert truth.targets.sizes.tolist() == [[4.5, 1.7, 1.6]]
    assert truth.targets.yaws.tolist() == [1.45]
    assert (truth.ignored.tracks, truth.ignored.classes) == (("5",), ("ignore",))


NEGATIVE = boxes(("1", "ship", 0, 0, 0, 1, -2, 1, 0))
BROKEN = {
    "[": "line 1, column 2: not valid JSON (Expecting value)",
    "[" * 100_000: "more than 50 levels",
    "[" + "9" * 5000 + "]": "a number of more than 100 characters",
    "3": "not a list of boxes",
    "[3]": "object 0: missing key 'psr'",
    '[{"psr": []}]': "object 0: missing key 'position'",
    '[{"psr": {"position": {"x": 1, "y": 2, "z": NaN}}}]': "object 0: 'z' is not a finite number",
    '[{"psr": {"position": {"x": 1, "y": 2, "z": 1e999}}}]': "object 0: 'z' is not a finite number",
    '[{"psr": {"position": {"x": 1, "y": 2, "z": "3"}}}]': "object 0: 'z' is not a finite number",
    '[{"psr": {"position": {"x": 1, "y": true}}}]': "object 0: 'y' is not a finite number",
    json.dumps(sustechpoints_json(NEGATIVE)): "object 0: box size must not be negative, got -2 m",
}


@pytest.mark.parametrize("content", BROKEN, ids=lambda content: content[:30])
def test_broken_json(tmp_path, content):
    file = put(tmp_path / "label/000000.json", content)
    with pytest.raises(LabelError) as caught:
        open_labels(tmp_path).truth(frame())
    assert str(caught.value) == f"{file}: frame 0: {BROKEN[content]}"


@pytest.mark.parametrize(
    ("content", "message"), [('{"a": 1}', "missing key 'labels'"), ('{"labels": 1}', "is not a list")]
)
def test_broken_seepersea(tmp_path, content, message):
    put(tmp_path / "annotations/000000.json", content)
    with pytest.raises(LabelError, match=message):
        open_labels(tmp_path).truth(frame())


def test_a_file_removed_before_its_frame(tmp_path):
    path, frames = write("seepersea", tmp_path)
    labels = open_labels(path)
    (path / "annotations/000001.json").unlink()
    with pytest.raises(LabelError, match=r"000001\.json: No such file"):
        labels.truth(frames[1])


def test_sustechpoints_lists_of_objects_as_older_versions_write_them(tmp_path):
    found = []
    for name, content in (("new", sustechpoints_json(SHIP)), ("old", {"objs": sustechpoints_json(SHIP)})):
        put(tmp_path / name / "label/000000.json", json.dumps(content))
        found.append(open_labels(tmp_path / name).truth(frame()).targets)
    assert found[0].tracks == found[1].tracks == ("1",)
    np.testing.assert_array_equal(found[0].centers, found[1].centers)
