"""Parts of a recording compared with lists of frames; ideal thresholds and best values compared with all others."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaclutter_cli.evaluation.matching import Alarms
from seaclutter_cli.evaluation.scores import FrameScore, Summary
from seaclutter_cli.evaluation.tuning import Parts, best, ideal_threshold
from seaclutter_cli.truth import CLUTTER, IGNORED

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


def summary(frames=10, n_fp=0, n_fn=0, false_alarms=0, omitted=0):
    return Summary(frames=frames, n_fp=n_fp, n_fn=n_fn, false_alarms=false_alarms, visible=omitted)


@pytest.mark.parametrize(
    ("summaries", "chosen"),
    [
        ({}, None),
        ({"a": Summary()}, None),
        ({"a": Summary(), "b": summary(n_fp=10, n_fn=10)}, "b"),
        ({"a": summary(n_fp=3), "b": summary(n_fn=2)}, "b"),
        ({"a": summary(n_fp=1, n_fn=1), "b": summary(n_fn=2)}, "a"),
        ({"a": summary(n_fp=2, false_alarms=5), "b": summary(n_fp=2, false_alarms=4)}, "b"),
        ({"a": summary(n_fp=2, omitted=3), "b": summary(n_fp=2, false_alarms=2)}, "b"),
        ({"a": summary(frames=10, n_fp=2), "b": summary(frames=100, n_fp=3)}, "b"),
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
