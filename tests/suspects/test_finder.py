"""Suspects among the bodies of the sample, when targets or clutter are removed on purpose."""

from dataclasses import replace

import numpy as np
import pytest

import seaclutter
from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.evaluation.scores import ideal
from seaclutter_cli.frame import FilterResult, Reason
from seaclutter_cli.labels import open_labels
from seaclutter_cli.suspects.finder import LIKELY, SuspectFinder
from seaclutter_cli.truth import IGNORED
from tests.paths import ROOT

FRAMES = 25


@pytest.fixture(scope="module")
def labelled():
    """Return the first frames of the sample, each with its truth."""
    labels = open_labels(ROOT / "samples" / "sea.labels.csv")
    with seaclutter.open_log(ROOT / "samples" / "sea.mcap") as log:
        return [(frame, labels.truth(frame)) for frame, _ in zip(log.frames(), range(FRAMES), strict=False)]


def found(labelled, *changes):
    """Return the suspects, and the finder, if methods change the right result."""
    finder = SuspectFinder(len(changes))
    for frame, truth in labelled:
        finder.add(frame, [change(right(frame, truth), truth) for change in changes])
    return finder.finish(), finder


def right(frame, truth):
    """Return the result of the ideal method, with own ship left out by configuration."""
    result = ideal(frame, truth, EvaluationParams())
    return replace(result, reason=np.where(truth.points == IGNORED, np.uint8(Reason.NEAR), result.reason))


def without(track):
    def change(result, truth):
        reason = result.reason.copy()
        reason[truth.points == track] = Reason.OUTLIER
        return replace(result, reason=reason)

    return change


def box_of(truth, track):
    boxes = truth.targets
    k = boxes.tracks.index(str(track))
    return boxes.centers[k], boxes.sizes[k]


def test_nothing_is_suspected_if_exactly_the_targets_are_kept(labelled):
    suspects, _ = found(labelled, lambda known, _: known)
    assert suspects == {"removed": [], "kept": []}


@pytest.mark.parametrize("track", [1, 2])
def test_a_target_that_is_removed_is_the_only_suspect(labelled, track):
    suspects, _ = found(labelled, without(track))
    (one,) = suspects["removed"]
    center, size = box_of(labelled[one.frame][1], track)
    assert np.hypot(one.x_m - center[0], one.y_m - center[1]) < np.hypot(*size[:2]) / 2 + 1
    assert one.score > LIKELY
    assert one.frames > 0.8 * FRAMES
    assert one.reasons == {"outlier": one.total_points}
    assert one.stamp_ns == labelled[one.frame][0].stamp_ns
    assert replace(one, total_points=10, frames=99).weight < one.weight


def test_points_that_the_configuration_removed_are_no_reason(labelled):
    def partly_near(result, truth):
        reason = result.reason.copy()
        target = np.flatnonzero(truth.points == 2)
        reason[target] = Reason.NEAR
        reason[target[::4]] = Reason.OUTLIER
        return replace(result, reason=reason)

    (one,) = found(labelled, partly_near)[0]["removed"]
    assert one.reasons == {"outlier": one.total_points}


def test_kept_clutter_is_suspected_most_if_it_is_large(labelled):
    suspects, finder = found(labelled, lambda known, _: FilterResult(known.frame, np.zeros_like(known.reason)))
    assert not suspects["removed"]
    weights = [one.weight for one in suspects["kept"]]
    assert len(weights) > 20
    assert weights == sorted(weights, reverse=True)
    frames = [one.frames for one in suspects["kept"] if one.top_m is None]
    assert max(frames) > FRAMES / 2  # what stays in one place is one suspect
    assert finder.tally.doubtful[0] >= sum(frames)


def test_what_comes_at_the_end_is_not_judged(labelled):
    finder = SuspectFinder()
    for frame, truth in labelled[:2]:
        finder.add(frame, [right(frame, truth)])
    assert (finder.finish()["kept"], finder.tally.doubtful.tolist()) == ([], [0])
    assert finder.unjudged > 0


def test_methods_are_compared_on_the_same_bodies(labelled):
    _, finder = found(labelled, lambda known, _: known, without(2))
    tally = finder.tally
    assert tally.lost[0] == 0
    assert 0.8 * FRAMES < tally.lost[1] <= FRAMES < tally.found[0]
    assert (tally.lost + tally.found <= 2 * FRAMES).all(), "own ship, which the configuration removes, counts nowhere"
    assert tally.changes.tolist() == [0, 0]


def test_a_jump_in_time_ends_all_bodies(labelled):
    finder = SuspectFinder()
    change = without(2)
    for k, (frame, truth) in enumerate(labelled):
        later = replace(frame, stamp_ns=frame.stamp_ns + (k >= 12) * 60 * 10**9)
        finder.add(later, [change(right(later, truth), truth)])
    assert [one.last_frame < 12 or one.first_frame >= 12 for one in finder.finish()["removed"]] == [True, True]


def test_frames_that_a_method_cannot_use_and_empty_frames(labelled):
    finder = SuspectFinder()
    frame = labelled[0][0]
    assert len(finder.add(frame, [None])) > 0
    empty = seaclutter.Frame.of_arrays(np.empty((0, 3)), stamp_ns=frame.stamp_ns + 10**8)
    assert len(finder.add(empty, [FilterResult(empty, np.empty(0, np.uint8))])) == 0
    assert finder.finish() == {"removed": [], "kept": []}


@pytest.mark.parametrize("track", [1, 2])
def test_kept_water_beside_a_target_does_not_excuse_its_loss(labelled, track):
    def everything_else(known, truth):
        kept = replace(known, reason=np.where(known.reason == Reason.NEAR, known.reason, Reason.KEPT).astype(np.uint8))
        return without(track)(kept, truth)

    suspects, _ = found(labelled, everything_else)
    (one,) = suspects["removed"]
    assert one.frames > 0.6 * FRAMES


def test_the_order_of_methods_does_not_matter(labelled):
    def excluding(known, truth):
        return replace(known, reason=np.where(truth.points == 2, np.uint8(Reason.EXCLUDED), known.reason))

    tallies = [found(labelled, *each)[1].tally for each in ((excluding, without(1)), (without(1), excluding))]
    for name in ("lost", "found", "changes", "kept_score"):
        one, other = (getattr(tally, name) for tally in tallies)
        assert one.tolist() == other[::-1].tolist()


def test_frames_that_one_method_cannot_use_count_for_no_method(labelled):
    told = []
    for left_out in (slice(0, 0), slice(1, None, 2)):
        finder = SuspectFinder(2)
        for k, (frame, truth) in enumerate(labelled):
            if k not in range(len(labelled))[left_out]:
                result = right(frame, truth)
                finder.indicate(frame, [result, None if k % 2 else without(1)(result, truth)])
        finder.finish()
        sums = finder.tally
        told.append([sums.of_method(m) for m in range(2)])
        assert sums.frames == (FRAMES + 1) // 2
    assert told[0] == told[1]
