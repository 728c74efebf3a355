"""Scores of scene classifiers, against counts by hand."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from seaclutter_cli.scenes.training import SceneScores

CLASSES = ("open", "confined", "ice")


@given(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 2)), max_size=50))
def test_counts_and_shares(pairs):
    truth, predicted = np.array(pairs, np.int64).reshape(-1, 2).T
    found = SceneScores.count(CLASSES, truth, predicted)
    for kind in range(3):
        truths = [t for t, p in pairs if p == kind]
        predictions = [p for t, p in pairs if t == kind]
        precision = truths.count(kind) / len(truths) if truths else np.nan
        recall = predictions.count(kind) / len(predictions) if predictions else np.nan
        np.testing.assert_allclose((found.precision[kind], found.recall[kind]), (precision, recall))
    correct = sum(t == p for t, p in pairs)
    np.testing.assert_allclose(found.accuracy, correct / len(pairs) if pairs else np.nan)
    assert found.counts.sum() == len(pairs)


def test_as_json():
    found = SceneScores.count(CLASSES, np.array([0, 0, 1]), np.array([0, 1, 1]))
    counts = {"open": 1, "confined": 1, "ice": 0}
    assert found.as_dict()["open"] == {"predicted": counts, "precision": 1.0, "recall": 0.5}
    assert found.as_dict()["ice"]["precision"] is None
    assert found.mean_precision == 0.5
