"""Which tracks detections continue."""

import numpy as np
import pytest

from seaclutter_cli.tracking.detections import Detections
from seaclutter_cli.tracking.tracker import Tracker


def pieces(*ends):
    """Return detections of bodies from one x to another, 20 m off."""
    found = [np.arange(start, end, 0.1) for start, end in ends]
    xyz = np.hstack([[np.tile(x, 3), np.repeat((20.0, 20.4, 20.8), len(x)), np.zeros(3 * len(x))] for x in found])
    owner = np.repeat(np.arange(len(found)), [3 * len(x) for x in found])
    return Detections.made(xyz, owner, len(found))


@pytest.mark.parametrize("speed_ms", [-6, 0, 8])
@pytest.mark.parametrize(("end_m", "start_m"), [(4, 4.7), (2, 3.7), (5, 5.7)])
def test_a_boat_in_two_pieces_for_a_moment_keeps_its_track(speed_ms, end_m, start_m):
    """The track of the piece that is new ends."""
    tracker, first = Tracker(), []
    for k in range(60):
        x = speed_ms * k / 10
        ends = [(x, x + end_m), (x + start_m, x + 8)] if 30 <= k < 36 else [(x, x + 8)]
        tracks = tracker.step(pieces(*ends), k / 10)
        first = first or tracks
    assert tracks == first
