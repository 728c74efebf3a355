import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaclutter_cli.evaluation.confusion import Confusion

PAIRS = st.lists(st.tuples(st.integers(1, 4), st.integers(1, 4)), min_size=1, max_size=60)


@given(pairs=PAIRS)
def test_scores_are_those_of_scikit_learn(pairs):
    metrics = pytest.importorskip("sklearn.metrics")
    truth, found = np.array(pairs).T
    scores = Confusion.of(truth, found, (1, 2, 3, 4))
    labels = sorted({*truth, *found})
    at = [label - 1 for label in labels]
    expected = metrics.precision_recall_fscore_support(truth, found, labels=labels, zero_division=0)
    for ours, theirs in zip((scores.precision, scores.recall, scores.f1), expected, strict=False):
        np.testing.assert_allclose(np.nan_to_num(ours[at]), theirs)
    assert scores.accuracy == pytest.approx(metrics.accuracy_score(truth, found))
    assert scores.macro_f1 == pytest.approx(expected[2].mean())
    if len(labels) > 1:
        assert scores.kappa == pytest.approx(metrics.cohen_kappa_score(truth, found))
