"""Samples of frames: their points, and the descriptions of their boxes and clusters."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.frame import Reason
from seaclutter_cli.reporting.objects import deferred_objects, find_objects
from seaclutter_cli.reporting.sample import IS_CLUTTER, IS_TARGET, UNKNOWN, take_sample
from seaclutter_cli.truth import Truth
from tests.evaluation.scenes import boxes, frame_of, lump, result_of

PARAMS = EvaluationParams()


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


@given(st.sets(st.integers(0, 29)), st.sets(st.integers(0, 29)), st.booleans())
def test_deferred_objects_are_those_of_the_whole_frame(removed, others, usable):
    frame = frame_of(lump(20), lump(40), lump(60))
    results = [result_of(frame, removed=sorted(removed)), result_of(frame, removed=sorted(others)) if usable else None]
    for truth in (None, Truth(targets=boxes((20.5, 3.0)))):
        later = deferred_objects(frame, results, truth, PARAMS)
        assert later() == find_objects(frame, results, truth, PARAMS)


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
