"""Detected targets and false alarms in frames with an obvious result."""

import numpy as np
import pytest

from seaclutter_cli.errors import LabelError
from seaclutter_cli.evaluation import EvaluationParams, matching
from seaclutter_cli.evaluation.scores import score_frame
from seaclutter_cli.truth import CLUTTER, IGNORED, Boxes, Truth
from tests.evaluation.scenes import boxes, frame_of, lump, result_of

PARAMS = EvaluationParams()
NAMES = ("targets", "visible", "detected", "missed", "clusters", "false_alarms")


def alarms_of(frame, truth, removed=(), params=PARAMS):
    (score,) = score_frame(frame, [result_of(frame, removed)], truth, params)
    return tuple(getattr(score.alarms, name) for name in NAMES)


def test_a_target_and_a_wave():
    frame = frame_of(lump(20), lump(40))
    assert alarms_of(frame, Truth(boxes(20.5))) == (1, 1, 1, 0, 2, 1)


def test_a_target_that_the_filter_removed():
    assert alarms_of(frame_of(lump(20), lump(40)), Truth(boxes(20.5)), removed=range(10)) == (1, 1, 0, 1, 1, 1)


def test_a_target_with_too_few_points_left():
    assert alarms_of(frame_of(lump(20)), Truth(boxes(20.5)), removed=range(6)) == (1, 1, 0, 1, 0, 0)
    assert alarms_of(frame_of(lump(20)), Truth(boxes(20.5)), removed=range(5)) == (1, 1, 1, 0, 1, 0)


def test_a_target_and_its_wake_are_one_cluster():
    """The larger part decides: with a wake of more points, the boat is missed and the cluster is a false alarm."""
    boat = lump(20)
    assert alarms_of(frame_of(boat, lump(22, 8)), Truth(boxes(20.5))) == (1, 1, 1, 0, 1, 0)
    assert alarms_of(frame_of(boat, lump(22, 14)), Truth(boxes(20.5))) == (1, 1, 0, 1, 1, 1)


def test_a_cluster_exactly_half_inside_belongs_to_the_target():
    frame = frame_of(lump(20, 6), lump(22.5, 6))
    truth = Truth(boxes((20, 1.5)))  # inflated to 18.75 … 21.25
    assert alarms_of(frame, truth, params=EvaluationParams(cluster_tolerance_m=3)) == (1, 1, 1, 0, 1, 0)
    frame = frame_of(lump(20, 6), lump(22.5, 7))
    assert alarms_of(frame, truth, params=EvaluationParams(cluster_tolerance_m=3)) == (1, 1, 0, 1, 1, 1)


def test_two_targets_in_one_cluster_are_both_detected():
    assert alarms_of(frame_of(lump(20), lump(21.2)), Truth(boxes((20.25, 1), (22, 1)))) == (2, 2, 2, 0, 1, 0)


def test_a_target_in_several_clusters_adds_them_up():
    params = EvaluationParams(min_cluster_points=5, cluster_tolerance_m=0.5)
    frame = frame_of(lump(20, 5), lump(22, 5))
    truth = Truth(boxes((21, 6)))
    assert alarms_of(frame, truth, params=params) == (1, 1, 1, 0, 2, 0)
    assert alarms_of(frame, truth, removed=(0, 5), params=params) == (1, 1, 0, 1, 0, 0)


def test_the_margin_has_an_effect():
    frame = frame_of(lump(20, 10, spread=0.01))
    assert alarms_of(frame, Truth(boxes(21.4)))[2] == 1  # the inflated box begins at 19.9
    assert alarms_of(frame, Truth(boxes(21.4)), params=EvaluationParams(box_margin_m=0))[2:] == (0, 0, 1, 1)


def test_an_invisible_target_is_neither_detected_nor_missed():
    frame = frame_of(lump(20, 4), lump(40))
    assert alarms_of(frame, Truth(boxes(20, 40.5))) == (2, 1, 1, 0, 1, 0)
    assert alarms_of(frame, Truth(boxes(20, 40.5)), params=EvaluationParams(min_visible_points=4))[1:4] == (2, 1, 1)


def test_visibility_depends_on_valid_raw_points():
    points = lump(20, 8)
    points[4:, 2] = np.nan
    assert alarms_of(frame_of(points), Truth(boxes(20.5)))[:2] == (1, 0)
    assert alarms_of(frame_of(lump(20, 8)), Truth(boxes(20.5)), removed=range(8)) == (1, 1, 0, 1, 0, 0)


def test_areas_to_ignore_have_no_false_alarms_and_no_detections():
    frame = frame_of(lump(20), lump(40))
    assert alarms_of(frame, Truth(boxes(), boxes(40.5))) == (0, 0, 0, 0, 2, 1)
    assert alarms_of(frame, Truth(boxes(20.5), boxes(40.5))) == (1, 1, 1, 0, 2, 0)


def test_half_in_a_target_and_half_in_an_area_to_ignore_belongs():
    frame = frame_of(lump(20, 10), lump(21, 10))
    assert alarms_of(frame, Truth(boxes((19.75, 1)), boxes((21.5, 1)))) == (1, 1, 1, 0, 1, 0)


def test_a_target_beyond_the_filters_range_counts_like_any_other():
    assert alarms_of(frame_of(lump(150)), Truth(boxes(150.5))) == (1, 1, 1, 0, 1, 0)


@pytest.mark.parametrize("truth", [Truth(boxes()), Truth(boxes(), points=np.zeros(10, np.int64)), Truth(None)])
def test_a_frame_that_is_labelled_and_empty(truth):
    assert alarms_of(frame_of(lump(20)), truth) == (0, 0, 0, 0, 1, 1)


def test_a_frame_without_points():
    assert alarms_of(frame_of(), Truth(boxes(20))) == (1, 0, 0, 0, 0, 0)
    assert alarms_of(frame_of(), Truth(None, points=np.empty(0, np.int64))) == (0, 0, 0, 0, 0, 0)


def test_a_frame_without_a_label():
    frame = frame_of(lump(20))
    (score,) = score_frame(frame, [result_of(frame, range(3))], None, PARAMS)
    assert (score.alarms, score.points, score.clusters, score.points_in, score.points_out) == (None, None, 1, 10, 7)


class TestWherePointsAreLabelled:
    """The same rules, with the points of a track instead of the points in its box."""

    def points(self, *runs):
        return np.concatenate([np.full(count, value, np.int64) for value, count in runs])

    def test_a_target_and_a_wave(self):
        points = self.points((7, 10), (CLUTTER, 10))
        assert alarms_of(frame_of(lump(20), lump(40)), Truth(None, points=points)) == (1, 1, 1, 0, 2, 1)

    def test_exactly_half(self):
        for clutter, expected in ((5, (1, 1, 1, 0, 1, 0)), (6, (1, 1, 0, 1, 1, 1))):
            frame = frame_of(lump(20, 5 + clutter))
            assert alarms_of(frame, Truth(None, points=self.points((7, 5), (CLUTTER, clutter)))) == expected

    def test_ignored_points_are_an_area_to_ignore(self):
        points = self.points((IGNORED, 10), (7, 4), (8, 6))
        frame = frame_of(lump(20), lump(40, 4), lump(60, 6))
        assert alarms_of(frame, Truth(None, points=points)) == (2, 1, 1, 0, 2, 0)
        assert alarms_of(frame, Truth(None, boxes(60.5), points=np.zeros(20, np.int64))) == (0, 0, 0, 0, 2, 1)

    def test_a_track_of_invalid_points_is_a_target_that_is_not_visible(self):
        wave = lump(20)
        wave[:, 0] = np.nan
        assert alarms_of(frame_of(wave), Truth(None, points=self.points((9, 10)))) == (1, 0, 0, 0, 0, 0)

    def test_with_boxes_only_boxes_decide(self):
        points = self.points((IGNORED, 10), (7, 10))
        truth = Truth(boxes(20.5), Boxes(), points)
        assert alarms_of(frame_of(lump(20), lump(40)), truth) == (1, 1, 1, 0, 2, 1)


def test_methods_of_one_frame_are_scored_as_each_alone():
    frame = frame_of(lump(20), lump(22, 14), lump(60, 6))
    truth = Truth(boxes(20.5), boxes(60))
    results = [result_of(frame, removed) for removed in ((), range(10, 24), range(30), range(0, 30, 2))]
    together = score_frame(frame, [*results, None], truth, PARAMS)
    assert together == [score_frame(frame, [result], truth, PARAMS)[0] for result in results] + [None]


def test_boxes_that_overlap_without_end_are_an_error(monkeypatch):
    monkeypatch.setattr(matching, "MAX_MEMBERS", 25)
    frame = frame_of(lump(20))
    assert alarms_of(frame, Truth(boxes(20.5, 20.6)))[0] == 2
    with pytest.raises(LabelError, match="its 3 labelled boxes overlap too much; together they contain more than 25 p"):
        alarms_of(frame, Truth(boxes(20.5, 20.6, 20.7)))


def test_boxes_without_a_size_overlap_nothing():
    flat = Boxes(("1",), ("buoy",), np.zeros((1, 3)), np.array([[0.0, 0, 1]]), np.zeros(1))
    box = Boxes(("1",), ("buoy",), np.zeros((1, 3)), np.array([[5.0, 2, 1]]), np.zeros(1))
    for pair in ((flat, box), (box, flat), (flat, flat)):
        assert matching.overlaps(*pair).tolist() == [[0]]
