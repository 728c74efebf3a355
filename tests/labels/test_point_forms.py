"""Labels of points in the SemanticKITTI format and in a field of the cloud."""

import numpy as np
import pytest

from seaclutter_cli.errors import LabelError
from seaclutter_cli.labels import LabelOptions, open_labels
from seaclutter_cli.labels.point_labels import point_truth
from seaclutter_cli.sources.frame_files.arrays import read_bin
from seaclutter_cli.sources.frame_files.folder import FolderSource
from tests.labels.frames import XYZ, frame, put, write
from tests.paths import shared

WADS = "wads-36"


def test_wads():
    """Labels are the same from the folder of the data set and from its folder of labels."""
    folder = shared(WADS)
    labels, same = open_labels(folder), open_labels(folder / "labels")
    files = sorted((folder / "velodyne").iterdir())
    assert len(FolderSource(folder).counts) == 1
    for index, file in enumerate(files):
        labelled = frame(index, read_bin(file).points)
        truth = labels.truth(labelled)
        other = same.truth(labelled)
        assert other.targets is None
        np.testing.assert_array_equal(other.points, truth.points)
        raw = np.fromfile(folder / "labels" / f"{file.stem}.label", "<u4") & 0xFFFF
        assert truth.targets is None
        np.testing.assert_array_equal(truth.points == 0, raw == 110)
        np.testing.assert_array_equal(truth.points == 65535, (raw == 0) | (raw == 99))
        assert 5_000 < (truth.points == 0).sum() < 20_000
        assert (truth.points > 65535).sum() == len(raw) - np.isin(raw, (0, 99, 110)).sum()
    labels.finish()
    same.finish()


def test_wads_of_another_frame():
    folder = shared(WADS)
    second = sorted((folder / "velodyne").iterdir())[1]
    with pytest.raises(LabelError, match=r"042223\.label: frame 0: [\d,]+ labels for [\d,]+ points"):
        open_labels(folder).truth(frame(0, read_bin(second).points))


def test_classes_can_be_configured():
    raw = np.array([0, 9, 10, 110], np.uint32)
    options = LabelOptions(clutter_ids=(9, 0), ignore_ids=(0, 10))
    assert point_truth(raw, options).tolist() == [0, 0, 65535, 65536 + 110]
    assert point_truth(raw[:0], options).tolist() == []


def test_objects_are_distinct_from_clutter_ignored_and_each_other():
    raw = np.array([[kind + (instance << 16) for kind in (0, 1, 65535)] for instance in (0, 1, 65535)], np.uint32)
    tracks = point_truth(raw.ravel(), LabelOptions(clutter_ids=(), ignore_ids=()))
    assert len(set(tracks.tolist()) - {0, 65535}) == 9


def test_label_files_of_the_wrong_size(tmp_path):
    path, frames = write("semantickitti", tmp_path)
    put(path / "labels/000001.label", b"12345")
    put(path / "labels/000002.label", b"1234")
    labels = open_labels(path)
    assert labels.truth(frames[0]) is not None
    with pytest.raises(LabelError, match=r"000001\.label: frame 1: size must be a multiple of 4 bytes, got 5"):
        labels.truth(frames[1])
    with pytest.raises(LabelError, match=rf"000002\.label: frame 2: 1 label for {frames[2].size:,} points"):
        labels.truth(frames[2])


@pytest.mark.parametrize("code", ["<u1", "<i2", ">u2", "<i4", "<u4", "<f4", "<f8"])
def test_a_field_of_whole_numbers(tmp_path, code):
    points = np.zeros(3, [*XYZ, ("label", code)])
    points["label"] = 0, 7, 120
    labels = open_labels(put(tmp_path / "log.mcap", b"\x89MCAP0\r\n"))
    truth = labels.truth(frame(0, points))
    assert truth.targets is None
    assert truth.points.tolist() == [0, 7, 120]
    assert truth.points.dtype == np.int64
    labels.finish()


@pytest.mark.parametrize(
    ("fields", "value"),
    [([], None), ([("label", "<f4")], np.nan), ([("label", "<f4")], 0.5), ([("label", "<i2")], -1),
     ([("label", "<u2", (2,))], 1), ([("Label", "<u2")], 1), ([("label", "<f8")], 1e300)],
)  # fmt: skip
def test_a_cloud_without_labels(tmp_path, fields, value):
    points = np.zeros(3, XYZ + fields)
    for field in fields:
        points[field[0]] = value
    with pytest.raises(LabelError, match=r"log.bag: frame 4 of /points: no field 'label' .* has x, y, z") as caught:
        open_labels(put(tmp_path / "log.bag", b"")).truth(frame(4, points))
    assert "\n" not in str(caught.value)


def test_an_empty_cloud_has_empty_labels(tmp_path):
    labels = open_labels(put(tmp_path / "a_0.db3", b"SQLite format 3\0").parent)
    assert labels.truth(frame(0, np.zeros(0, [*XYZ, ("label", "<u2")]))).points.shape == (0,)
