"""Tracks of the method ``confirmed`` alone."""

import numpy as np
import pytest

from seaclutter_cli.filters.confirmation import ConfirmedParams
from seaclutter_cli.filters.confirmation.objects import DetectedObject
from seaclutter_cli.filters.confirmation.tracks import Tracker

POSITION = np.array([[20.0, 0.0]])


def seen(tracker, time_s, since_s):
    """Return the track of a lone object that is in a frame."""
    objects = [DetectedObject(np.arange(3), 0.6, POSITION, POSITION[0])]
    (track,) = tracker.step(tracker.associate(objects, time_s), time_s, since_s)
    return track


def scores(params, step_s, *, forget):
    """Return the score of a lone object in each of 12 frames, with or without evidence that is no longer needed."""
    tracker = Tracker(params)
    times_s = (step_s * np.arange(12)).tolist()
    return [tracker.score(seen(tracker, time_s, time_s if forget else -np.inf), time_s) for time_s in times_s]


@pytest.mark.parametrize("look_ahead_s", [0.0, 0.04, 0.5, 2.0])
@pytest.mark.parametrize("step_s", [0.05, 0.1, 0.45, 0.504, 0.9])
def test_forgotten_evidence_is_not_needed(look_ahead_s, step_s):
    params = ConfirmedParams(look_ahead_s=look_ahead_s)
    assert scores(params, step_s, forget=True) == scores(params, step_s, forget=False)


@pytest.mark.parametrize(("gap_s", "counts"), [(0.504, True), (0.6, False)])
def test_the_next_frame_counts_even_a_little_beyond_the_look_ahead(gap_s, counts):
    tracker = Tracker(ConfirmedParams())
    track = seen(tracker, 0.0, 0.0)
    alone = tracker.score(track, 0.0)
    assert seen(tracker, gap_s, 0.0) is track
    assert (tracker.score(track, 0.0) > alone) is counts
