"""Sums and rates compared with values computed by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.evaluation.matching import Alarms
from seaclutter_cli.evaluation.scores import (
    FrameScore,
    Parts,
    PointCounts,
    Summary,
    best,
    ideal_threshold,
    score_frame,
)
from seaclutter_cli.truth import CLUTTER, IGNORED, Truth
from tests.evaluation.scenes import frame_of, lump, result_of


def score(alarms=None, points=None):
    return FrameScore(100, 50, 3, 4, alarms, points)


def test_the_rates_of_table_4():
    """In [Li2023], the global threshold has 13 frames with false alarms and 32 with missed targets of 196."""
    summary = Summary()
    for number in range(196):
        alarms = Alarms(targets=3, visible=2, detected=2 - (number >= 164), clusters=3, false_alarms=2 * (number < 13))
        summary.add(score(alarms), 0.001)
    for _ in range(4):
        summary.add(score(), 0.001)
    assert (summary.frames, summary.unlabelled, summary.n_fp, summary.n_fn) == (196, 4, 13, 32)
    assert f"{100 * summary.r_fp:.2f} {100 * summary.r_fn:.2f}" == "6.63 16.33"
    found = summary.as_dict()
    assert found["not_visible"] == 196
    assert (found["detected"], found["omitted_alarms"], found["false_alarms"]) == (360, 32, 26)
    assert found["precision"] == pytest.approx(360 / 386)
    assert found["recall"] == pytest.approx(360 / 392)
    assert found["f1"] == pytest.approx(2 * 360 / (2 * 360 + 26 + 32))
    assert found["false_alarms_per_frame"] == pytest.approx(26 / 196)
    assert found["clusters_per_frame"] == 3
    assert found["unclustered_points_per_frame"] == 4
    assert "R_c" not in found


def test_the_points_of_table_3():
    points = PointCounts(target_in=1147, target_out=898, clutter_in=1478, clutter_out=16)
    assert f"{100 * PointCounts(1147, 1147, 1478, 1478).clutter_share:.2f}" == "56.30"
    assert points.clutter_share == pytest.approx(16 / 914)
    assert points.clutter_removal == pytest.approx(1462 / 1478)
    assert points.target_loss == pytest.approx(249 / 1147)
    assert points.precision == pytest.approx(1462 / (1462 + 249))
    recall = points.clutter_removal
    assert points.f1 == pytest.approx(2 * points.precision * recall / (points.precision + recall))


def test_invalid_and_ignored_points_are_not_counted():
    lumps = lump(20, 20)
    lumps[:2, 1] = np.nan
    frame = frame_of(lumps)
    points = np.array([7, CLUTTER] + [7] * 6 + [CLUTTER] * 6 + [IGNORED] * 6)
    (found,) = score_frame(frame, [result_of(frame, [2, 8, 9, 14])], Truth(None, points=points), EvaluationParams())
    assert found.points == PointCounts(6, 5, 6, 4)
    assert found.cells() == [1, 1, 1, 0, 1, 0, 20, 16, 6, 5, 6, 4]


def test_rates_without_frames_are_none():
    found = Summary().as_dict()
    for name in ("R_FP", "R_FN", "precision", "recall", "f1", "false_alarms_per_frame", "clusters_per_frame"):
        assert found[name] is None
    assert found["filter_ms"] == {"median": None, "p99": None}
    none = PointCounts()
    assert (none.clutter_removal, none.target_loss, none.precision, none.f1, none.clutter_share) == (None,) * 5


def test_rates_without_visible_targets_or_clutter_are_none():
    summary = Summary()
    summary.add(score(Alarms(targets=2, visible=0, detected=0, clusters=3, false_alarms=3)), None)
    assert (summary.r_fp, summary.r_fn, summary.recall, summary.f1) == (1, None, None, None)
    assert PointCounts(target_in=9, target_out=5).f1 is None


def test_recordings_add_up():
    alarms = [Alarms(2, 2, number % 3, 3, number % 2) for number in range(10)]
    points = PointCounts(5, 4, 3, 2)
    whole, first, second = Summary(), Summary(), Summary()
    for number, item in enumerate(alarms):
        for summary in (whole, first if number < 4 else second):
            summary.add(score(item, points if number < 4 else None), 0.001 * number)
    first.update(second)
    assert first.as_dict() == whole.as_dict()
    assert whole.points == PointCounts(20, 16, 12, 8)


def test_cells_without_truth_are_empty():
    assert score().cells() == ["", "", "", "", 3, "", 100, 50, "", "", "", ""]


@pytest.mark.parametrize("size", [1, 2, 99, 100, 101, 1000])
def test_durations_are_exact_to_one_percent(size):
    seconds = np.random.default_rng(size).lognormal(-6, 1, size)
    summary = Summary()
    for value in seconds:
        summary.add(score(), value)
    for share in (0.5, 0.99):
        exact = np.quantile(seconds, share, method="inverted_cdf")
        assert summary.milliseconds(share) == pytest.approx(1000 * exact, rel=0.01)


def test_durations_outside_the_histogram():
    summary = Summary()
    for seconds in (0.0, -1e-9, 1e9):
        summary.add(score(), seconds)
    assert summary.milliseconds(0.01) < 1e-3
    assert summary.milliseconds(0.99) > 1e6


POINTS = st.lists(st.tuples(st.integers(0, 12), st.sampled_from([CLUTTER, 3, 7, IGNORED])), max_size=30)


def sum_of_shares(threshold, clutter, target):
    return np.mean([i < threshold for i in clutter]) + np.mean([i >= threshold for i in target])


@given(POINTS)
def test_the_ideal_threshold_against_all_others(points):
    intensity = np.array([i for i, _ in points], float)
    labels = np.array([label for _, label in points], np.int64)
    clutter = intensity[labels == CLUTTER]
    target = intensity[(labels != CLUTTER) & (labels != IGNORED)]
    found = ideal_threshold(intensity, labels)
    if not len(clutter) or not len(target):
        assert found is None
        return
    every = [sum_of_shares(threshold, clutter, target) for threshold in np.arange(0, 14, 0.5)]
    assert sum_of_shares(found, clutter, target) == pytest.approx(max(every))


def sums_of(frames=10, n_fp=0, n_fn=0, false_alarms=0, omitted=0):
    return Summary(frames=frames, n_fp=n_fp, n_fn=n_fn, false_alarms=false_alarms, visible=omitted)


@pytest.mark.parametrize(
    ("summaries", "chosen"),
    [
        ({}, None),
        ({"a": Summary()}, None),
        ({"a": Summary(), "b": sums_of(n_fp=10, n_fn=10)}, "b"),
        ({"a": sums_of(n_fp=3), "b": sums_of(n_fn=2)}, "b"),
        ({"a": sums_of(n_fp=1, n_fn=1), "b": sums_of(n_fn=2)}, "a"),
        ({"a": sums_of(n_fp=2, false_alarms=5), "b": sums_of(n_fp=2, false_alarms=4)}, "b"),
        ({"a": sums_of(n_fp=2, omitted=3), "b": sums_of(n_fp=2, false_alarms=2)}, "b"),
        ({"a": sums_of(frames=10, n_fp=2), "b": sums_of(frames=100, n_fp=3)}, "b"),
    ],
)
def test_the_best_has_the_fewest_bad_frames_then_the_fewest_alarms(summaries, chosen):
    assert best(summaries) == chosen


def parts_of(frames):
    parts = Parts(2)
    for number in range(frames):
        alarms = Alarms(targets=1, visible=1, detected=1, clusters=1, false_alarms=number)
        parts.add([FrameScore(9, 9, 1, 0, alarms, None), None])
    return parts


@pytest.mark.parametrize("frames", [2, 3, 8, 63, 64, 65, 128, 129, 1000])
@pytest.mark.parametrize("share", [0.1, 0.25, 0.5])
def test_the_end_is_held_out(frames, share):
    (first, _), (last, none) = parts_of(frames).split(share)
    assert first.frames + last.frames == frames
    assert none.frames == 0
    assert first.false_alarms == sum(range(first.frames)), "consecutive frames"
    assert last.frames >= 1 <= first.frames
    assert last.frames / frames == pytest.approx(share, abs=1 / 32 + 1 / frames)


def test_all_or_nothing():
    for share, expected in ((0, (9, 0)), (1, (0, 9))):
        assert tuple(summary.frames for summary, _ in parts_of(9).split(share)) == expected
    assert [summary.frames for summary, _ in parts_of(1).split(0.25)] == [1, 0]
    assert [summary.frames for summary, _ in parts_of(0).split(0.25)] == [0, 0]
