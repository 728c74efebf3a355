"""Scene tracker: the scene follows the documented rule for any sequence of classifications."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaclutter_cli.scenes.model import SceneDecision, SceneTracker
from tests.filters.frames import make_frame

CLASSES = ("open", "confined", "ice")


class ScriptedModel:
    """A classifier that returns given classes, one after the other."""

    classes = CLASSES
    extent_m = 60.0

    def __init__(self, script):
        self.script, self.calls = list(script), 0

    def probabilities(self, image):
        assert image.any()
        out = np.full(3, 0.1, np.float32)
        out[CLASSES.index(self.script[self.calls])] = 0.8
        self.calls += 1
        return out


VISIBLE = make_frame([(5, 5, 0)])
EMPTY = [make_frame([]), make_frame([(0, 0, 0)]), make_frame([(np.nan, 1, 1)]), make_frame([(500, 0, 0)])]


def by_hand(script, hold):
    """Return the scene after each classification, from the documented rule."""
    scenes = script[:1]
    for index in range(1, len(script)):
        last = script[max(0, index - hold + 1) : index + 1]
        scenes.append(script[index] if len(last) == hold and len(set(last)) == 1 else scenes[-1])
    return scenes


@given(st.lists(st.sampled_from(CLASSES), min_size=1, max_size=30), st.integers(1, 4), st.integers(1, 5))
def test_the_rule(script, hold, every):
    tracker = SceneTracker(ScriptedModel(script), every=every, hold=hold)
    decisions = [tracker.scene(VISIBLE) for _ in range(len(script) * every)]
    scenes = by_hand(script, hold)
    assert [decision.name for decision in decisions] == [scene for scene in scenes for _ in range(every)]
    assert [decision.decided for decision in decisions] == ([True] + [False] * (every - 1)) * len(script)
    for decision, predicted in zip(decisions[::every], script, strict=True):
        assert decision.probabilities[decision.name] == pytest.approx(0.8 if decision.name == predicted else 0.1)
        assert decision.probabilities[predicted] == pytest.approx(0.8)


def test_empty_frames_are_not_classified():
    tracker = SceneTracker(ScriptedModel(["confined", "open"]), every=3, hold=1)
    even = pytest.approx(1 / 3)
    for frame in EMPTY:
        assert tracker.scene(frame) == SceneDecision("open", False, dict.fromkeys(CLASSES, even))
    assert tracker.scene(VISIBLE).decided
    decisions = [tracker.scene(frame) for frame in (*EMPTY, VISIBLE)]
    assert [one.name for one in decisions] == ["confined"] * 4 + ["open"]
    assert [one.decided for one in decisions] == [False] * 4 + [True]


def test_reset_forgets_all_state():
    model = ScriptedModel(["confined", "open", "open", "confined"])
    tracker = SceneTracker(model, every=2, hold=2)
    first = [tracker.scene(VISIBLE).name for _ in range(3)]
    tracker.reset()
    assert first == ["confined"] * 3
    assert tracker.scene(VISIBLE).name == "open"
    assert tracker.scene(VISIBLE).decided is False
    assert tracker.scene(VISIBLE).name == "open"  # a single other classification is not enough


def test_the_classifier_runs_only_when_needed():
    model = ScriptedModel(["open"] * 3)
    tracker = SceneTracker(model, every=10, hold=1)
    for _ in range(25):
        tracker.scene(VISIBLE)
    assert model.calls == 3
