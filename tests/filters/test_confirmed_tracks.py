"""Tracks of the method ``confirmed`` alone."""

import numpy as np
import pytest

from seaclutter_cli.filters.confirmation import ConfirmedParams
from seaclutter_cli.filters.confirmation.objects import DetectedObject
from seaclutter_cli.filters.confirmation.tracks import Tracker

POSITION = np.array([[20.0, 0.0]])


def seen(tracker, time_s, since_s, evidence=0.6):
    """Return the track of the only object that is in a frame."""
    objects = [DetectedObject(np.arange(3), evidence, POSITION, POSITION[0])]
    (track,) = tracker.step(objects, time_s, since_s)
    return track


def scores(params, step_s, *, forget):
    """Return the score of the only object in each of 12 frames, with or without evidence that is no longer needed."""
    tracker = Tracker(params)
    times_s = (step_s * np.arange(12)).tolist()
    return [tracker.score(seen(tracker, time_s, time_s if forget else -np.inf), time_s) for time_s in times_s]


@pytest.mark.parametrize("look_ahead_s", [0.0, 0.04, 0.5, 2.0])
@pytest.mark.parametrize("step_s", [0.05, 0.1, 0.45, 0.504, 0.9])
def test_forgotten_evidence_is_not_needed(look_ahead_s, step_s):
    params = ConfirmedParams(look_ahead_s=look_ahead_s)
    assert scores(params, step_s, forget=True) == scores(params, step_s, forget=False)


@pytest.mark.parametrize(("gap_s", "counts"), [(1.004, True), (1.2, False)])
def test_the_next_frame_counts_even_a_little_beyond_the_look_ahead(gap_s, counts):
    tracker = Tracker(ConfirmedParams())
    track = seen(tracker, 0.0, 0.0)
    alone = tracker.score(track, 0.0)
    assert seen(tracker, gap_s, 0.0, evidence=2.0) is track
    assert (tracker.score(track, 0.0) > alone) is counts


def turned_by(angle_deg, places):
    angle = np.radians(angle_deg)
    return places @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


BUOYS = np.array([[20.0, 3.0], [-14.0, 22.0], [31.0, -18.0], [-25.0, -9.0], [5.0, -40.0]])


def followed(rate_deg_s, *, step_s=0.1, count=30, start_s=1.0):
    """Return the tracks of buoys in each frame while own ship turns after some time, as the lidar sees them."""
    tracker = Tracker(ConfirmedParams())
    rows = []
    for time_s in (step_s * np.arange(count)).tolist():
        places = turned_by(-rate_deg_s * max(time_s - start_s, 0), BUOYS)
        objects = [DetectedObject(np.arange(3), 0.6, place[None], place) for place in places]
        rows.append(tracker.step(objects, time_s, 0.0))
    return rows


@pytest.mark.parametrize("rate_deg_s", [0.0, 20.0, -20.0, 30.0])
def test_tracks_survive_a_turn_of_own_ship(rate_deg_s):
    first, *others = followed(rate_deg_s)
    for row in others:
        assert [one is other for one, other in zip(row, first, strict=True)] == [True] * len(BUOYS)


def test_what_turns_with_own_ship_does_not_move_over_the_water():
    for track in followed(20.0)[-1]:
        assert np.hypot(*track.velocity) < 2.0


def test_one_object_that_moves_is_no_turn():
    """Four buoys rest."""
    tracker = Tracker(ConfirmedParams())
    for time_s in (0.1 * np.arange(20)).tolist():
        places = BUOYS.copy()
        places[0] = turned_by(10 * time_s, BUOYS[:1])[0]
        objects = [DetectedObject(np.arange(3), 0.6, place[None], place) for place in places]
        tracks = tracker.step(objects, time_s, 0.0)
        for track, place in zip(tracks[1:], BUOYS[1:], strict=True):
            np.testing.assert_allclose(track.center, place, atol=1e-9)


def test_spray_is_no_turn():
    """Three buoys are known for long, six splashes that move all at once hardly."""
    tracker, splashes = Tracker(ConfirmedParams()), turned_by(40, np.concatenate((BUOYS, 0.8 * BUOYS[:1])))
    for number, time_s in enumerate((0.1 * np.arange(45)).tolist()):
        places = BUOYS[:3]
        if number >= 35:
            places = np.concatenate((places, turned_by(5 if number == 44 else 0, splashes)))
        objects = [DetectedObject(np.arange(3), 2.0, place[None], place) for place in places]
        tracker.step(objects, time_s, 0.0)
        assert tracker._yaw_rate == 0


def test_a_turn_ends_though_one_buoy_of_ten_is_left_to_show_it():
    tracker, buoys = Tracker(ConfirmedParams()), np.concatenate((BUOYS, turned_by(50, 1.3 * BUOYS)))
    for number, time_s in enumerate((0.1 * np.arange(24)).tolist()):
        angle = 2.0 * np.clip(number - 9, 0, 10)
        places = turned_by(-angle, buoys if number < 20 else buoys[:1])
        objects = [DetectedObject(np.arange(3), 0.6, place[None], place) for place in places]
        tracker.step(objects, time_s, 0.0)
        assert tracker._yaw_rate == pytest.approx(-np.radians(20.0) if 10 <= number < 20 else 0.0, abs=0.06)


def test_the_best_known_track_continues():
    """A new track that expects more cells of an object does not take over."""
    tracker, old = Tracker(ConfirmedParams()), np.array([[20.0, 0.0], [20.0, 0.6]])
    for time_s in (0.1 * np.arange(10)).tolist():
        known = seen_at(tracker, [old], time_s)[0]
    new = np.array([[20.0, 1.3], [20.0, 1.8], [20.0, 2.3]])
    one, other = seen_at(tracker, [old, new], 1.0)
    assert one is known is not other
    (merged,) = seen_at(tracker, [np.concatenate((old, new))], 1.1)
    assert merged is known


def test_a_fragment_does_not_take_the_track_of_a_wall():
    """It may look more like a target, but is no more than a part of what is expected."""
    tracker, wall = Tracker(ConfirmedParams()), np.stack((np.full(40, 20.0), np.arange(40) / 2), axis=1)
    for time_s in (0.1 * np.arange(10)).tolist():
        (known,) = seen_at(tracker, [wall], time_s)
    fragment, rest = wall[:3], wall[3:]
    objects = [
        DetectedObject(np.arange(3), odds, own, own.mean(axis=0)) for odds, own in ((3.0, fragment), (0.6, rest))
    ]
    one, other = tracker.step(objects, 1.0, 0.0)
    assert other is known is not one


def seen_at(tracker, cells, time_s):
    """Return the tracks of objects of given cells."""
    objects = [DetectedObject(np.arange(3), 0.6, own, own.mean(axis=0)) for own in cells]
    return tracker.step(objects, time_s, 0.0)
