"""Properties of every label format."""

import numpy as np
import pytest

from seaclutter_cli.errors import LabelError
from seaclutter_cli.labels import LABELS, LabelOptions, open_labels
from tests.labels.frames import BOX_FORMATS, SCENE, WRITERS, assert_same, frame, put, write

FORMS = [name for name in LABELS if name != "autoferry"]
"""Formats of boxes and points; the positions of Autoferry are tested with its detections."""
every_format = pytest.mark.parametrize("name", FORMS)
FILE_FORMATS = [name for name in FORMS if name != "cloud"]


def test_every_format_has_a_writer():
    assert set(WRITERS) == set(FORMS)


@every_format
def test_labels_are_read_as_written(name, tmp_path):
    path, frames = write(name, tmp_path)
    labels = open_labels(path, LabelOptions())
    for labelled, targets in zip(frames, SCENE, strict=True):
        truth = labels.truth(labelled)
        assert len(truth.ignored) == 0
        if name in BOX_FORMATS:
            assert_same(truth.targets, targets)
            assert truth.points is None
            continue
        assert truth.targets is None
        assert truth.points.shape == (labelled.size,)
        assert truth.points.dtype == np.int64
        tracks = [set(truth.points[inside]) for inside in targets.members(labelled.coordinates, 0.01)]
        assert set().union(*tracks) == set(truth.points) - {0}
        assert all(len(numbers) == 1 and not numbers & {0, 65535} for numbers in tracks)
        assert len(set().union(*tracks)) == len(targets)
        assert not truth.points[~targets.covers(labelled.coordinates, 0.01)].any()
    labels.finish()


@every_format
def test_only_one_format_matches_a_path(name, tmp_path):
    path, _ = write(name, tmp_path)
    assert [other for other, known in LABELS.items() if known.find(path) is not None] == [name]


@every_format
def test_a_frame_can_be_requested_again(name, tmp_path):
    path, frames = write(name, tmp_path)
    labels = open_labels(path)
    for item in [*frames, *frames[::-1]]:
        assert labels.truth(item) is not None
        assert labels.truth(item) is not None
    labels.finish()


@pytest.mark.parametrize("name", FILE_FORMATS)
def test_labels_of_missing_frames_are_an_error(name, tmp_path):
    path, frames = write(name, tmp_path)
    labels = open_labels(path)
    labels.truth(frames[0])
    with pytest.raises(LabelError, match=r"the log (lacks|has no frames).*\b1\b"):
        labels.finish()


@pytest.mark.parametrize("name", ["seepersea", "semantickitti"])
def test_a_frame_without_a_label_file_is_an_error_that_names_it(name, tmp_path):
    path, frames = write(name, tmp_path)
    with pytest.raises(LabelError, match="frame 4 of the log, only 4 files"):
        open_labels(path).truth(frame(4, frames[0].cloud.points))


@pytest.mark.parametrize("name", ["seepersea", "sustechpoints", "semantickitti"])
def test_the_label_folder_itself_can_be_opened(name, tmp_path):
    path, frames = write(name, tmp_path)
    folder = {"seepersea": "annotations", "sustechpoints": "label", "semantickitti": "labels"}[name]
    current = path / folder
    for name_of_folder in (folder, "mine"):
        current = current.rename(path / name_of_folder)
        labels = open_labels(current)
        assert all(labels.truth(item) is not None for item in frames)
        labels.finish()


@pytest.mark.parametrize("name", FILE_FORMATS)
def test_damaged_files_of_a_folder_keep_their_numbers(name, tmp_path):
    path, frames = write(name, tmp_path)
    labels = open_labels(path, LabelOptions(by_sequence=True))
    index = 3 if name == "csv" else 2  # numbers of frames, or the order of files
    last = labels.truth(frame(index, frames[3].cloud.points, sequence=3))
    assert len(last.targets) == 1 if name in BOX_FORMATS else last.points.any()
    labels.finish()


def test_a_path_that_does_not_exist(tmp_path):
    with pytest.raises(LabelError, match="no such file"):
        open_labels(tmp_path / "gone")


def test_the_message_for_a_path_without_labels_names_the_formats(tmp_path):
    for path in (tmp_path, put(tmp_path / "frame.pcd", b"VERSION .7\n"), put(tmp_path / "t.csv", "x,y,z\n1,2,3\n")):
        with pytest.raises(LabelError) as caught:
            open_labels(path)
        assert all(known.title in str(caught.value) for known in LABELS.values())
        assert "\n" not in str(caught.value)


def test_a_folder_with_labels_of_two_formats(tmp_path):
    write("seepersea", tmp_path)
    write("sustechpoints", tmp_path)
    with pytest.raises(LabelError, match="several formats"):
        open_labels(tmp_path)
    assert len(open_labels(tmp_path / "label").truth(frame()).targets) == 2


def test_labels_next_to_a_log_take_precedence_over_those_inside_it(tmp_path):
    path, frames = write("seepersea", tmp_path)
    put(tmp_path / "raw.bag", b"#ROSBAG V2.0\n")
    assert open_labels(path).truth(frames[0]).targets is not None
