"""Labels in the native CSV format."""

import numpy as np
import pytest

from seaclutter_cli.errors import LabelError
from seaclutter_cli.labels import LABELS, open_labels
from seaclutter_cli.labels.boxes import _distinct
from tests.labels.frames import HEADER, PERIOD_NS, START_NS, XYZ, frame, put

HEAD = ",".join(HEADER)
STAMPED = HEAD.replace("frame", "stamp_ns")


def opened(tmp_path, *lines, header=HEAD):
    return open_labels(put(tmp_path / "log.labels.csv", "\n".join([header, *lines, ""])))


def row(key, track="1", kind="ship", box="1,2,3,4,5,6,0.5"):
    return f"{key},{track},{kind},{box}"


def error_of(tmp_path, *lines, header=HEAD):
    with pytest.raises(LabelError) as caught:
        opened(tmp_path, *lines, header=header)
    assert str(caught.value).startswith(f"{tmp_path / 'log.labels.csv'}: ")
    assert str(caught.value).isprintable()
    return str(caught.value).partition(": ")[2]


@pytest.mark.parametrize("bom", ["", "\ufeff"])
@pytest.mark.parametrize("mark", [",", ";", "\t"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_columns_in_any_order_with_additional_ones(tmp_path, bom, mark, end):
    header = "yaw,Note,height,width,length,z,y,x,class,track_id,frame"
    content = f"{bom}{header}{end}0.5, hi ,6,5,4,3,2,1,ship,17,0{end}{end},,,,,,,,,,{end}"
    path = put(tmp_path / "labels.txt", content.replace(",", mark))
    assert LABELS["csv"].find(path)
    targets = open_labels(path).truth(frame()).targets
    assert (targets.tracks, targets.classes) == (("17",), ("ship",))
    assert targets.centers.tolist() == [[1, 2, 3]]
    assert targets.sizes.tolist() == [[4, 5, 6]]
    assert targets.yaws.tolist() == [0.5]


def test_none_ignore_and_unlabelled(tmp_path):
    labels = opened(tmp_path, "0,,none,,,,,,,", row(2, "", "ignore"), row(2, "", "Ignore"), row("3.0"))
    empty, unlabelled, pier, target = (labels.truth(frame(number)) for number in range(4))
    assert (len(empty.targets), len(empty.ignored)) == (0, 0)
    assert list(empty.targets.members(np.zeros((3, 5)), 1)) == []
    assert unlabelled is None
    assert (len(pier.targets), len(pier.ignored)) == (0, 2)
    assert (len(target.targets), len(target.ignored)) == (1, 0)
    labels.finish()


def test_targets_without_a_track_get_different_tracks(tmp_path):
    labels = opened(tmp_path, row(0, "#1"), row(0, ""), row(0, ""))
    tracks = labels.truth(frame()).targets.tracks
    assert tracks[0] == "#1"
    assert len(set(tracks)) == 3


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (row(1, box="1,2,x,4,5,6,0"), "line 3: z 'x' is not a finite number"),
        (row(1, box="1,2,,4,5,6,0"), "line 3: z '' is not a finite number"),
        (row(1, box="1,2,nan,4,5,6,0"), "line 3: z 'nan' is not a finite number"),
        (row(1, box="1,2,1e999,4,5,6,0"), "line 3: z '1e999' is not a finite number"),
        (row(1, box="1,2,1_0,4,5,6,0"), "line 3: z '1_0' is not a finite number"),
        (row(1, box="1,2,3,4,-5,6,0"), "line 3: box size must not be negative, got -5 m"),
        (row(-1), "line 3: frame '-1' is not a whole number from 0"),
        (row("1.5"), "line 3: frame '1.5' is not a whole number from 0"),
        (row(10**19 - 1), f"line 3: frame '{10**19 - 1}' is too large"),
        (row(0), "line 3: track '1' is already in line 2 for the same frame"),
        (row(0) + ",9", "line 3: expected 10 values, got 11"),
        ("1,2", "line 3: expected 10 values, got 2"),
        ('1,"2', "line 3: unexpected end of data"),
        (row(1, kind="a\x1b[1m", box="?,2,3,4,5,6,0"), "line 3: x '?' is not a finite number"),
        ("\x1b[1m", "line 3: expected 10 values, got 1"),
    ],
)
def test_the_message_names_an_invalid_line(tmp_path, line, message):
    assert error_of(tmp_path, row(0), line) == message


def test_invalid_headers(tmp_path):
    assert "line 1: missing column length; required" in error_of(tmp_path, header=HEAD.replace("length,", ""))
    assert "line 1: missing column frame (or stamp_ns);" in error_of(tmp_path, header=HEAD.replace("frame,", ""))
    assert "line 1: duplicate column x" in error_of(tmp_path, header=HEAD + ",x")
    assert "contains no labels" in error_of(tmp_path)


def test_a_file_that_is_not_text(tmp_path):
    path = put(tmp_path / "log.labels.csv", HEAD.encode() + b"\n\xff\xfe\n")
    with pytest.raises(LabelError, match="not valid UTF-8 text"):
        open_labels(path)


def test_finish_names_the_first_frames_that_are_missing_and_how_many(tmp_path):
    labels = opened(tmp_path, *(row(number) for number in (0, 1, 7, 9, 20, 30)))
    labels.truth(frame(0))
    labels.truth(frame(2))  # frame 1 may be lost to damage, which does not make the labels wrong
    with pytest.raises(LabelError) as caught:
        labels.finish()
    assert str(caught.value).endswith("the log lacks 4 of 6 labelled frames (frame 7, 9, 20, …)")


def test_labels_of_another_log(tmp_path):
    labels = opened(tmp_path, row(500))
    assert labels.truth(frame(0)) is None
    with pytest.raises(LabelError, match=r"1 of 1 .*\(frame 500\); check that the labels belong to this log"):
        labels.finish()


def test_point_labels_of_the_cloud_are_included(tmp_path):
    points = np.zeros(4, [*XYZ, ("label", "<u2")])
    points["label"] = 0, 1, 1, 65535
    labels = opened(tmp_path, row(0))
    assert labels.truth(frame(0, points)).points.tolist() == [0, 1, 1, 65535]
    points = points.astype([*XYZ, ("label", "<f4")])
    points["label"] = 0.5
    assert labels.truth(frame(0, points)).points is None


def test_a_field_of_other_classes_is_no_truth(tmp_path):
    """Classifiers also write a field ``label``."""
    points = np.zeros(4, [*XYZ, ("label", "<u2")])
    labels = opened(tmp_path, row(0, "1"), row(1, "1"))
    for index, (classes, is_truth) in enumerate((((0, 1, 1, 65535), True), ((7, 1, 1, 7), False))):
        points["label"] = classes
        assert (labels.truth(frame(index, points)).points is not None) == is_truth


def stamped(tmp_path, *stamps):
    return opened(tmp_path, *(row(stamp) for stamp in stamps), header=STAMPED)


def test_frame_takes_precedence_over_stamps(tmp_path):
    labels = opened(tmp_path, f"5,{row(1)}", header=f"stamp_ns,{HEAD}")
    assert labels.truth(frame(0)) is None
    assert labels.truth(frame(1)) is not None
    labels.finish()


def test_stamps_of_frames(tmp_path):
    labels = stamped(tmp_path, *(START_NS + number * PERIOD_NS for number in (0, 3, 4)))
    found = [labels.truth(frame(number)) is not None for number in range(6)]
    assert found == [True, False, False, True, True, False]
    labels.finish()


@pytest.mark.parametrize("offset_ns", [-49_000_000, 49_000_000])
def test_a_stamp_between_frames_belongs_to_the_nearest_one(tmp_path, offset_ns):
    labels = stamped(tmp_path, START_NS + 3 * PERIOD_NS + offset_ns)
    assert [number for number in range(6) if labels.truth(frame(number))] == [3]
    labels.finish()


def test_a_stamp_in_a_gap_belongs_to_no_frame(tmp_path):
    lost = START_NS + 4 * PERIOD_NS
    labels = stamped(tmp_path, START_NS, lost)
    assert [number for number in (0, 1, 2, 7, 8) if labels.truth(frame(number))] == [0]
    with pytest.raises(LabelError, match=rf"the log lacks 1 of 2 labelled frames \(stamp {lost}\)"):
        labels.finish()


def test_the_message_names_a_stamp_that_matches_two_frames(tmp_path):
    stamp = START_NS + 2 * PERIOD_NS + 30_000_000
    labels = stamped(tmp_path, stamp)
    assert [labels.truth(frame(number)) is not None for number in range(3)] == [False, False, True]
    with pytest.raises(LabelError, match=f"stamp {stamp} match both frame 2 and frame 3"):
        labels.truth(frame(3, stamp_ns=stamp + 1_000_000))


def test_uneven_frames_that_are_labelled_exactly(tmp_path):
    stamps = [START_NS + number * PERIOD_NS + number % 2 * 40_000_000 for number in range(20)]
    labels = stamped(tmp_path, *stamps[1::2])
    found = [labels.truth(frame(number, stamp_ns=stamp)) is not None for number, stamp in enumerate(stamps)]
    assert found == [number % 2 == 1 for number in range(20)]
    labels.finish()


def test_the_tolerance_of_the_first_frame_is_25_ms(tmp_path):
    assert stamped(tmp_path, START_NS + 25_000_000).truth(frame(0)) is not None
    assert stamped(tmp_path, START_NS + 25_000_001).truth(frame(0)) is None


def test_a_frame_has_a_limited_number_of_labels(tmp_path):
    rows = [row(0, str(number)) for number in range(10_001)]
    assert len(opened(tmp_path, *rows[:-1]).truth(frame()).targets) == 10_000
    assert error_of(tmp_path, *rows) == "line 10002: more than 10,000 labels for the same frame"
    opened(tmp_path, *rows[:-1], row(1))


def test_targets_without_a_track_are_named_in_linear_time():
    class Track(str):
        __slots__ = ()
        compared = 0

        def __eq__(self, other):
            Track.compared += 1
            return str.__eq__(self, other)

        __hash__ = str.__hash__

    given = [Track("") for _ in range(1000)] + [Track(f"t{number}") for number in range(1000)]
    assert len(set(_distinct(given))) == 2000
    assert Track.compared < 20_000


@pytest.mark.parametrize(
    ("lines", "header", "problem"),
    [
        (["1," * 100_000], HEAD, "line 2: more than 65,536 characters"),
        ([row(0), row(1, "t" * 70_000)], HEAD, "line 3: more than 65,536 characters"),
        ([row(0)], HEAD + ",c" * 40_000, "line 1: more than 65,536 characters"),
        ([row(0), '1,"a', *["b"] * 200], HEAD, "line 3: unexpected end of data"),
    ],
)
def test_lines_and_rows_of_limited_size(tmp_path, lines, header, problem):
    assert error_of(tmp_path, *lines, header=header) == problem
