"""Parts of a recording compared with lists of frames."""

import pytest

from seaclutter_cli.evaluation.matching import Alarms
from seaclutter_cli.evaluation.scores import FrameScore
from seaclutter_cli.evaluation.tuning import Parts


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
