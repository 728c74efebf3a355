"""What holds for every form of labels."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import HealthCheck, event, given, settings

from seaclutter_cli.errors import LabelError
from seaclutter_cli.labels import LABELS, LabelOptions, open_labels
from tests.labels.frames import BOX_FORMS, SCENE, WRITERS, assert_same, frame, put, write

every_form = pytest.mark.parametrize("name", LABELS)
FILE_FORMS = [name for name in LABELS if name != "cloud"]


def test_every_form_has_a_writer():
    assert set(WRITERS) == set(LABELS)


@every_form
def test_what_is_written_is_read(name, tmp_path):
    path, frames = write(name, tmp_path)
    labels = open_labels(path, LabelOptions())
    for one, targets in zip(frames, SCENE, strict=True):
        truth = labels.truth(one)
        assert len(truth.ignored) == 0
        if name in BOX_FORMS:
            assert_same(truth.targets, targets)
            assert truth.points is None
            continue
        assert truth.targets is None
        assert truth.points.shape == (one.size,)
        assert truth.points.dtype == np.int64
        inside = targets.contains(one.coordinates, 0.01)
        tracks = [set(truth.points[row]) for row in inside]
        assert set().union(*tracks) == set(truth.points) - {0}
        assert all(len(numbers) == 1 and not numbers & {0, 65535} for numbers in tracks)
        assert len(set().union(*tracks)) == len(targets)
        assert not truth.points[~inside.any(axis=0)].any()
    labels.finish()


@every_form
def test_only_one_form_claims_a_path(name, tmp_path):
    path, _ = write(name, tmp_path)
    assert [other for other, form in LABELS.items() if form.matches(path)] == [name]


@every_form
def test_a_frame_can_be_asked_for_again(name, tmp_path):
    path, frames = write(name, tmp_path)
    labels = open_labels(path)
    for one in [*frames, *frames[::-1]]:
        assert labels.truth(one) is not None
        assert labels.truth(one) is not None
    labels.finish()


@pytest.mark.parametrize("name", FILE_FORMS)
def test_labels_of_frames_that_never_came_are_an_error(name, tmp_path):
    path, frames = write(name, tmp_path)
    labels = open_labels(path)
    labels.truth(frames[0])
    with pytest.raises(LabelError, match=r"not in the log.*\b1\b"):
        labels.finish()


@pytest.mark.parametrize("name", ["seepersea", "semantickitti"])
def test_a_frame_more_than_there_are_label_files_is_an_error_that_names_it(name, tmp_path):
    path, frames = write(name, tmp_path)
    with pytest.raises(LabelError, match="frame 4 of the log; there are 4"):
        open_labels(path).truth(frame(4, frames[0].cloud.points))


@pytest.mark.parametrize("name", ["seepersea", "sustechpoints", "semantickitti"])
def test_the_folder_of_labels_itself_will_do(name, tmp_path):
    path, frames = write(name, tmp_path)
    folder = {"seepersea": "annotations", "sustechpoints": "label", "semantickitti": "labels"}[name]
    place = path / folder
    for called in (folder, "mine"):
        place = place.rename(path / called)
        labels = open_labels(place)
        assert all(labels.truth(one) is not None for one in frames)
        labels.finish()


@pytest.mark.parametrize("name", FILE_FORMS)
def test_damaged_files_left_out_of_a_folder_keep_their_numbers(name, tmp_path):
    path, frames = write(name, tmp_path)
    labels = open_labels(path, LabelOptions(by_sequence=True))
    last = labels.truth(frame(2, frames[3].cloud.points, sequence=3))
    assert len(last.targets) == 1 if name in BOX_FORMS else last.points.any()
    labels.finish()


def test_a_path_that_is_not_there(tmp_path):
    with pytest.raises(LabelError, match="no such file"):
        open_labels(tmp_path / "gone")


def test_a_path_without_labels_names_the_forms(tmp_path):
    for path in (tmp_path, put(tmp_path / "frame.pcd", b"VERSION .7\n"), put(tmp_path / "t.csv", "x,y,z\n1,2,3\n")):
        with pytest.raises(LabelError) as caught:
            open_labels(path)
        assert all(form.title in str(caught.value) for form in LABELS.values())
        assert "\n" not in str(caught.value)


def test_a_folder_with_labels_of_two_forms(tmp_path):
    write("seepersea", tmp_path)
    write("sustechpoints", tmp_path)
    with pytest.raises(LabelError, match="several forms"):
        open_labels(tmp_path)
    assert len(open_labels(tmp_path / "label").truth(frame()).targets) == 2


def test_labels_beside_a_log_go_before_those_inside_it(tmp_path):
    path, frames = write("seepersea", tmp_path)
    put(tmp_path / "raw.bag", b"#ROSBAG V2.0\n")
    assert open_labels(path).truth(frames[0]).targets is not None


def damaged(content):
    """Return a strategy of what can become of bytes."""
    place = st.integers(0, len(content))
    pieces = st.binary(max_size=12) | st.sampled_from([b"", b"\n", b'"', b"[", b"{", b",", b"1e999", b"NaN", b"null"])
    return st.one_of(
        st.binary(max_size=200),
        place.map(lambda end: content[:end]),
        st.tuples(place, place, pieces).map(lambda cut: content[: cut[0]] + cut[2] + content[cut[1] :]),
        st.tuples(place, pieces).map(lambda cut: content[: cut[0]] + cut[1] + content[cut[0] + len(cut[1]) :]),
    )


@every_form
@settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(data=st.data())
def test_broken_bytes_are_an_error_of_one_line_that_names_the_file(name, tmp_path, data):
    path, frames = write(name, tmp_path)
    suffixes = {".csv", ".json", ".label", ".mcap"}
    file = min(file for file in tmp_path.rglob("*") if file.suffix in suffixes)
    file.write_bytes(data.draw(damaged(file.read_bytes())))
    try:
        labels = open_labels(path)
        for one in frames:
            labels.truth(one)
        labels.finish()
    except LabelError as error:
        said = str(error)
        event("refused")
    else:
        said = str(path)
    assert str(path) in said
    assert said.isprintable()
