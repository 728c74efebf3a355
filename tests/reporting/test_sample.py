"""Samples of frames: their points, and the descriptions of their boxes and clusters."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.frame import Reason, Rings, WaterState
from seaclutter_cli.reporting.sample import IS_CLUTTER, IS_TARGET, UNKNOWN, find_boxes, take_sample
from seaclutter_cli.truth import Truth
from tests.evaluation.scenes import boxes, frame_of, lump, result_of

PARAMS = EvaluationParams()
RINGS = Rings(*np.zeros((2, 1)), *np.zeros((3, 1), np.int64))


def confirmed_of(frame, unconfirmed, rings=RINGS):
    """Return a result with unconfirmed points, of a method with thresholds."""
    reason = np.zeros(frame.size, np.uint8)
    reason[list(unconfirmed)] = Reason.UNCONFIRMED
    return replace(result_of(frame), reason=reason, rings=rings)


def test_detected_missed_and_hidden_targets():
    frame = frame_of(lump(20), lump(40), lump(60), lump(80, count=3))
    truth = Truth(targets=boxes((20.5, 3.0), (40.5, 3.0), (80.5, 3.0)))
    keeps, loses = result_of(frame), result_of(frame, removed=range(10, 20))
    sample = take_sample(frame, [keeps, loses], truth, PARAMS, 1000)
    assert [box["state"] for box in sample.boxes] == [["detected", "detected"], ["detected", "missed"], "hidden"]
    assert [[one["kind"] for one in own] for own in sample.clusters] == [
        ["target", "target", "false"],
        ["target", "false"],
    ]
    assert sample.clusters[0][0]["points"] == 10
    assert sample.clusters[0][2]["low"][0] == 60
    assert set(sample.truth[:20]) == {IS_TARGET}
    assert set(sample.truth[20:30]) == {IS_CLUTTER}


def test_without_labels():
    frame = frame_of(lump(20), lump(60))
    sample = take_sample(frame, [result_of(frame), None], None, PARAMS, 1000)
    assert set(sample.truth) == {UNKNOWN}
    assert [one["kind"] for one in sample.clusters[0]] == ["unknown", "unknown"]
    assert sample.clusters[1] == []
    assert set(sample.reasons[1]) == {Reason.INVALID}
    assert sample.boxes == []


@pytest.mark.parametrize("clustering", ["euclidean", "dbscan"])
def test_clusters_of_unconfirmed_points(clustering):
    frame = frame_of(lump(20), lump(40), lump(40.5, y=1.0), lump(60, count=4))
    params = EvaluationParams(clustering=clustering)
    truth = Truth(targets=boxes((20.5, 3.0), (40.5, 3.0)))
    _, clusters = find_boxes(frame, [confirmed_of(frame, range(20, 34)), result_of(frame)], truth, params)
    assert [(one["kind"], one["points"]) for one in clusters[0]] == [
        ("target", 10),
        ("target", 10),
        ("unconfirmed", 10),
    ], "four points are no cluster; confirmed and unconfirmed points do not join"
    assert clusters[0][2]["low"] == [40.5, 1.0, 0.0]
    assert [one["points"] for one in clusters[1]] == [10, 20]


def test_without_thresholds_unconfirmed_points_may_be_water():
    frame = frame_of(lump(20), lump(40))
    _, clusters = find_boxes(frame, [confirmed_of(frame, range(10), rings=None)], None, PARAMS)
    assert [one["kind"] for one in clusters[0]] == ["unknown"]


def test_unconfirmed_objects_take_priority():
    frame = frame_of(lump(20, count=10), lump(40, count=10), lump(60, count=1000, spread=0.01))
    reason = np.repeat([Reason.KEPT, Reason.UNCONFIRMED, Reason.LOW_INTENSITY], [10, 10, 1000]).astype(np.uint8)
    sample = take_sample(frame, [replace(confirmed_of(frame, ()), reason=reason)], None, PARAMS, 100)
    assert np.bincount(sample.reasons[0])[[0, 7]].tolist() == [10, 10]


def test_the_water_is_that_of_the_first_method_that_knows_it():
    frame = frame_of(lump(20))
    first, second = WaterState(-2.0, 0.0, 0.0, 0.5, 0.1), WaterState(-3.0, 0.0, 0.0, 0.5, 0.1)
    results = [None, result_of(frame), *(replace(result_of(frame), water=water) for water in (first, second))]
    assert take_sample(frame, results, None, PARAMS, 100).water == first
    assert take_sample(frame, results[:2], None, PARAMS, 100).water is None


@given(st.integers(0, 60), st.integers(0, 400), st.integers(1, 200))
def test_kept_points_take_priority(kept, removed, limit):
    frame = frame_of(lump(20, count=kept), lump(30, count=removed, spread=0.01))
    result = result_of(frame, removed=range(kept, kept + removed))
    sample = take_sample(frame, [result], None, PARAMS, limit)
    shown = int(np.count_nonzero(sample.reasons[0] == Reason.KEPT))
    assert len(sample.xyz) == min(limit, kept + removed)
    assert shown >= min(kept, int(0.75 * limit))
    if len(sample.xyz):
        assert np.isclose(
            sample.weight.sum(),
            sum(n for n, there in ((kept, shown), (removed, len(sample.xyz) - shown)) if there),
            rtol=1e-4,
        )
    assert (sample.size, sample.valid) == (kept + removed, kept + removed)


def test_thinning_leaves_no_beam_out():
    frame = frame_of(lump(20, count=3200, spread=0.01))
    sample = take_sample(frame, [result_of(frame, removed=range(3200))], None, PARAMS, 400)
    index = np.round((sample.xyz[:, 0] - 20) * 100).astype(int)
    assert set(index % 32) == set(range(32))
    assert np.abs(np.histogram(index, 10, (0, 3200))[0] - 40).max() <= 4
