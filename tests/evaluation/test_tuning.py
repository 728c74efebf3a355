import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaclutter_cli.evaluation.scores import Summary
from seaclutter_cli.evaluation.tuning import best, ideal_threshold
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
