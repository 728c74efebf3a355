"""Times of frames whose stamps do not go on as their log does."""

from dataclasses import replace

import numpy as np
import pytest

from seaclutter_cli.frame import Frame
from seaclutter_cli.records import Channel, Message
from seaclutter_cli.tracking.clock import Clock

CHANNEL = Channel(1, "/points", "cdr", None)


def times(stamps_s, logged_s=None):
    clock, found = Clock(), []
    for stamp_s, log_s in zip(stamps_s, logged_s or stamps_s, strict=True):
        frame = Frame.of_arrays(np.empty((0, 3)), stamp_ns=round(stamp_s * 1e9))
        message = Message(CHANNEL, round(log_s * 1e9), 0, 0, b"")
        found.append(clock.next(replace(frame, message=message) if logged_s else frame))
    return [time_ns / 1e9 for time_ns, _ in found], [k for k, (_, is_apart) in enumerate(found) if is_apart]


@pytest.mark.parametrize(
    "stamps_s",
    [(50, 50.1, 48.2, 48.3), (50, 49.9, 50.2, 50.1), (50, 50, 50, 50)],
    ids=["set back", "not in order", "still"],
)
def test_stamps_that_do_not_go_on_are_replaced_by_times_of_the_log(stamps_s):
    assert times(stamps_s, [7, 7.1, 7.2, 7.3]) == (pytest.approx([50, 50.1, 50.2, 50.3]), [])


def test_frames_far_from_each_other_are_apart():
    assert times([50, 54.9, 60, 50]) == ([50, 54.9, 60, 50], [2, 3])


def test_frames_without_a_log_go_on_in_small_steps():
    assert times([50, 50, 49.5]) == (pytest.approx([50, 50.001, 50.002]), [])
