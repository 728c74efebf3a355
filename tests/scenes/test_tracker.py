"""The scene is held by the stated rule, whatever the classifier says."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaclutter_cli.scenes.tracker import SceneDecision, SceneTracker
from tests.filters.frames import make_frame

CLASSES = ("open", "confined", "ice")


class Told:
    """A classifier that says what it is told, one look after the other."""

    classes = CLASSES
    extent_m = 60.0

    def __init__(self, said):
        self.said, self.looks = list(said), 0

    def probabilities(self, image):
        assert image.any()
        out = np.full(3, 0.1, np.float32)
        out[CLASSES.index(self.said[self.looks])] = 0.8
        self.looks += 1
        return out


SOMETHING = make_frame([(5, 5, 0)])
NOTHING = [make_frame([]), make_frame([(0, 0, 0)]), make_frame([(np.nan, 1, 1)]), make_frame([(500, 0, 0)])]


def by_hand(said, hold):
    """Return the scene after each look, from the rule as it is stated."""
    scenes = said[:1]
    for look in range(1, len(said)):
        last = said[max(0, look - hold + 1) : look + 1]
        scenes.append(said[look] if len(last) == hold and len(set(last)) == 1 else scenes[-1])
    return scenes


@given(st.lists(st.sampled_from(CLASSES), min_size=1, max_size=30), st.integers(1, 4), st.integers(1, 5))
def test_the_rule(said, hold, every):
    judge = SceneTracker(Told(said), every=every, hold=hold)
    decisions = [judge.scene(SOMETHING) for _ in range(len(said) * every)]
    scenes = by_hand(said, hold)
    assert [decision.name for decision in decisions] == [scene for scene in scenes for _ in range(every)]
    assert [decision.decided for decision in decisions] == ([True] + [False] * (every - 1)) * len(said)
    for decision, heard in zip(decisions[::every], said, strict=True):
        assert decision.probability == pytest.approx(0.8 if decision.name == heard else 0.1)
        assert decision.probabilities[heard] == pytest.approx(0.8)


def test_frames_of_nothing_say_nothing():
    judge = SceneTracker(Told(["confined", "open"]), every=3, hold=1)
    even = pytest.approx(1 / 3)
    for frame in NOTHING:
        assert judge.scene(frame) == SceneDecision("open", even, False, dict.fromkeys(CLASSES, even))
    assert judge.scene(SOMETHING).decided
    said = [judge.scene(frame) for frame in (*NOTHING, SOMETHING)]
    assert [one.name for one in said] == ["confined"] * 4 + ["open"]
    assert [one.decided for one in said] == [False] * 4 + [True]


def test_reset_forgets_all():
    model = Told(["confined", "open", "open", "confined"])
    judge = SceneTracker(model, every=2, hold=2)
    first = [judge.scene(SOMETHING).name for _ in range(3)]
    judge.reset()
    assert first == ["confined"] * 3
    assert judge.scene(SOMETHING).name == "open"
    assert judge.scene(SOMETHING).decided is False
    assert judge.scene(SOMETHING).name == "open"  # one look against it is not enough


def test_the_classifier_is_asked_no_more_than_it_must():
    model = Told(["open"] * 3)
    judge = SceneTracker(model, every=10, hold=1)
    for _ in range(25):
        judge.scene(SOMETHING)
    assert model.looks == 3
