"""Selection of frames: worst, best and evenly spaced ones, with bounded effort."""

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from seaclutter_cli.frame import Reason
from seaclutter_cli.reporting.collector import Choice, ScoredFrame, _judged
from tests.evaluation.scenes import told

BADNESS = st.lists(st.sampled_from([0.0, 0.0, 1.0, 2.0, 5.0]), min_size=1, max_size=300)


def choose(badness, frames):
    choice, made = Choice(frames), []
    for row, bad in enumerate(badness):

        def make(row=row):
            made.append(row)
            return f"frame {row}"

        choice.offer(row, badness=bad, merit=None if bad else 1.0, make=make)
    return choice, made


@given(BADNESS, st.integers(1, 20))
def test_selected_frames(badness, frames):
    choice, made = choose(badness, frames)
    chosen = choice.chosen()
    rows = [one.row for one in chosen]
    assert len(set(rows)) == len(rows) <= frames
    assert len(rows) >= min(frames, len(badness)) // 2
    assert all(one.item == f"frame {one.row}" for one in chosen)
    worst = [one for one in chosen if one.why == "worst"]
    assert all(badness[one.row] for one in worst)
    assert [badness[one.row] for one in worst] == sorted((badness[one.row] for one in worst), reverse=True)
    if frames >= 2 and any(badness):
        assert badness[worst[0].row] == max(badness)
    assert len(made) == len(set(made))


@given(BADNESS, st.integers(2, 20))
def test_the_worst_frames_keep_a_distance(badness, frames):
    rows = sorted(one.row for one in choose(badness, frames)[0].chosen() if one.why == "worst")
    assert all(later - row >= 5 for row, later in pairwise(rows))


def test_the_spread_is_even_and_bounded():
    choice, made = choose([0.0] * 10_000, 12)
    rows = [int(item.removeprefix("frame ")) for item in choice.spread()]
    assert {b - a for a, b in pairwise(rows)} == {rows[1]}
    assert len(rows) <= 16
    assert rows[-1] > 9_000
    assert len(made) < 200


def test_falling_badness_creates_little_data():
    _, made = choose([float(row) for row in range(100, 0, -1)], 12)
    assert len(made) < 50


def test_the_worst_of_a_trend_is_chosen():
    for badness in ([float(row) for row in range(2000)], [float(row) for row in range(2000, 0, -1)]):
        choice, _ = choose(badness, 12)
        assert max(badness) in {badness[one.row] for one in choice.chosen()}


def test_unlabelled_frames_are_chosen_by_the_share_of_all_clutter_removed():
    counts = np.zeros(len(Reason))
    counts[[Reason.KEPT, Reason.LOW_INTENSITY, Reason.OUTLIER, Reason.UNCONFIRMED]] = 5, 1, 1, 1
    counts[Reason.NEAR] = 2
    assert _judged(ScoredFrame(None, [told(counts)], None, [None]), labelled=False) == (0.3, -0.3)
