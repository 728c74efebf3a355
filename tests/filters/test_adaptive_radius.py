"""Boundary cases of the adaptive radius rule, alone and as a stage of the joint method, and its scenes."""

import math
import tracemalloc
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaclutter_cli.errors import ConfigError
from seaclutter_cli.filters import FILTERS, radius
from seaclutter_cli.filters.radius import (
    PRESETS,
    AdaptiveRadius,
    AdaptiveRadiusParams,
    Preset,
    isolated_by_range,
)
from tests.filters.frames import make_frame, on_axis, sea_frame
from tests.filters.reference_points import isolated_by_count, isolated_by_rank, points_of
from tests.filters.steps import INVALID, KEPT, OUTLIER, reasons

SMALL = 1e-7
TINY = 1e-12
STAGE = {"outlier_stage": "adaptive_radius", "outlier_radius_ratio": 0.02, "outlier_min_neighbors": 1}


def preset(ratio, needed):
    return {"presets": {"open": Preset(radius_ratio=ratio, min_neighbors=needed)}}


class TestRule:
    @pytest.mark.parametrize(
        ("gap", "reason"), [(2 * (1 - SMALL), KEPT), (2, KEPT), (2 * (1 + TINY), KEPT), (2 * (1 + SMALL), OUTLIER)]
    )
    def test_points_at_the_radius_are_neighbors(self, make, gap, reason):
        """Both points have a range above 5 m, so only the gap decides, except for rounding; the range is 3D."""
        low, high = [3, 4, -gap / 2], [3, 4, gap / 2]
        ratio = 2 / math.sqrt(25 + 1)
        if gap == 2 * (1 + SMALL):
            ratio *= 1 - SMALL
        assert reasons(make("adaptive_radius", **preset(ratio, 1)), make_frame([low, high])) == [reason] * 2

    def test_each_point_has_its_own_radius(self, make):
        assert reasons(make("adaptive_radius", **preset(0.5, 1)), on_axis([4, 8])) == [OUTLIER, KEPT]

    @pytest.mark.parametrize(("others", "reason"), [(0, OUTLIER), (2, OUTLIER), (3, KEPT), (4, KEPT)])
    def test_others_count(self, make, others, reason):
        """The point itself does not count, its duplicates do."""
        method = make("adaptive_radius", **preset(0.01, 3))
        assert reasons(method, on_axis([20.0] * (others + 1))) == [reason] * (others + 1)

    def test_invalid_points_are_not_neighbors(self, make):
        frame = make_frame([[0, 0, 0]] * 9 + [[math.nan, 0, 0]] * 9 + [[1, 0, 0]])
        assert reasons(make("adaptive_radius", **preset(5.0, 1)), frame) == [INVALID] * 18 + [OUTLIER]

    def test_no_points(self, make):
        assert reasons(make("adaptive_radius"), on_axis([], [])) == []

    @pytest.mark.parametrize("spacing", [0.15, 0.2])
    @pytest.mark.parametrize("range_m", [5, 20, 80])
    def test_a_wall_is_kept_at_any_range(self, make, range_m, spacing):
        """With beams at even angles, the range has no effect."""
        angles = np.radians(spacing) * np.arange(-10, 11)
        azimuth, elevation = (angle.ravel() for angle in np.meshgrid(angles, angles[8:13]))
        xyz = range_m * np.stack((np.ones(azimuth.size), np.tan(azimuth), np.tan(elevation)), axis=1)
        assert reasons(make("adaptive_radius"), make_frame(xyz)) == [KEPT] * len(xyz)

    def test_defaults(self):
        assert AdaptiveRadiusParams().scene == "open"
        assert vars(PRESETS["open"]) == {"radius_ratio": 0.015, "min_neighbors": 9}
        assert vars(PRESETS["confined"]) == {"radius_ratio": 0.022, "min_neighbors": 10}

    def test_a_large_radius_takes_no_memory(self):
        frame = make_frame(np.random.default_rng(1).normal(0, 30, (57_600, 3)))
        _ = frame.valid
        method = AdaptiveRadius(AdaptiveRadiusParams(**preset(1e6, 5)))
        tracemalloc.start()
        assert method.step(frame).keep.all()
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 60e6


COORDINATES = st.integers(-12, 12).map(lambda quarters: quarters / 4)
POSITIONS = st.lists(st.tuples(COORDINATES, COORDINATES, COORDINATES), max_size=30)


@given(positions=POSITIONS, ratio=st.sampled_from([0.1, 0.25, 0.5, 1.0, 3.0]), needed=st.integers(1, 6))
@settings(max_examples=150, deadline=None)
def test_counting_and_rank_agree(positions, ratio, needed):
    """Quarters of a metre and these ratios give distances equal to the radius."""
    points = [point for point in points_of(make_frame(positions)) if not point.invalid]
    xyz = np.array([point.xyz for point in points]).reshape(-1, 3)
    found = np.flatnonzero(isolated_by_range(xyz, ratio, needed)).tolist()
    assert found == isolated_by_count(points, ratio, needed) == isolated_by_rank(points, ratio, needed)


@given(positions=POSITIONS, ratio=st.floats(0.01, 2), needed=st.integers(1, 6))
@settings(max_examples=80, deadline=None)
def test_a_larger_radius_and_fewer_neighbors_keep_more(positions, ratio, needed):
    xyz = np.array(positions, float).reshape(-1, 3)
    removed = isolated_by_range(xyz, ratio, needed)
    assert not (isolated_by_range(xyz, 1.5 * ratio, needed) & ~removed).any()
    assert not (removed & ~isolated_by_range(xyz, ratio, needed + 1)).any()


@dataclass(frozen=True)
class Decision:
    name: str
    probability: float = 0.9
    decided: bool = True


class SceneSequence:
    """Scene source that returns names one after the other, from the beginning after a reset."""

    def __init__(self, *names):
        self.names = names
        self.reset()

    def scene(self, frame):
        self.count += 1
        return Decision(self.names[self.count - 1])

    def reset(self):
        self.count = 0


class TestScenes:
    FRAME = on_axis([10, 10.2, 40, 40.9])

    def made(self, *names, **params):
        params = AdaptiveRadiusParams(scene="auto", **params)
        return AdaptiveRadius(params, SceneSequence(*names))

    def test_the_scene_selects_the_preset(self):
        coarse = {"a": Preset(radius_ratio=0.025, min_neighbors=1), "b": Preset(radius_ratio=0.01, min_neighbors=1)}
        method = self.made("a", "b", "a", presets=coarse)
        results = [method.step(self.FRAME) for _ in range(3)]
        assert [result.scene for result in results] == ["a", "b", "a"]
        assert [result.keep.tolist() for result in results] == [[True] * 4, [False] * 4, [True] * 4]

    def test_reset_reaches_the_source(self):
        method = self.made("open", "confined")
        before = [method.step(self.FRAME).scene for _ in range(2)]
        method.reset()
        assert [method.step(self.FRAME).scene for _ in range(2)] == before == ["open", "confined"]

    def test_a_scene_without_a_preset(self):
        with pytest.raises(ConfigError, match=r"scene 'lock' of the classifier \S+; presets: open, confined"):
            self.made("lock").step(self.FRAME)

    def test_a_configured_scene_is_returned_too(self):
        method = AdaptiveRadius(AdaptiveRadiusParams(scene="confined"))
        assert method.step(self.FRAME).scene == "confined"

    def test_other_methods_return_no_scene(self):
        assert FILTERS["ror"](FILTERS["ror"].Params()).step(self.FRAME).scene is None

    def test_auto_makes_the_classifier_with_its_keys(self, monkeypatch):
        requested = []

        def make_scene_tracker(params):
            requested.append(params)
            return SceneSequence("confined")

        monkeypatch.setattr(radius, "make_scene_tracker", make_scene_tracker)
        params = AdaptiveRadiusParams(scene="auto", scene_every=3)
        assert AdaptiveRadius(params).step(self.FRAME).scene == "confined"
        assert [one.scene_every for one in requested] == [3]
        AdaptiveRadius(AdaptiveRadiusParams(scene="open"))
        assert len(requested) == 1, "a configured scene needs no classifier"


class TestStageOfJoint:
    @pytest.mark.parametrize("name", ["joint", "ring_intensity_outlier"])
    def test_neighbors_may_be_in_the_next_range_ring(self, make, name):
        frame = on_axis([24.9, 25.1, 45.0, 54.8, 55.2])
        assert reasons(make(name, **STAGE), frame) == [KEPT, KEPT, OUTLIER, KEPT, KEPT]

    @pytest.mark.parametrize("name", ["joint", "ring_intensity_outlier"])
    def test_weak_and_far_points_are_not_neighbors(self, make, name):
        assert reasons(make(name, **STAGE), on_axis([20, 20.1, 69.9, 70], [99, 1, 99, 99]))[::2] == [OUTLIER] * 2

    def test_the_correction_comes_from_its_outliers(self):
        method = FILTERS["joint"](FILTERS["joint"].Params(**STAGE))
        frame = on_axis([20, 30, 30.1, 45], [90, 50, 60, 70])
        method.step(frame)
        assert method.step(frame).rings.corrections.tolist() == [45, 0, 35, 0]

    def test_no_points(self, make):
        assert reasons(make("joint", **STAGE), on_axis([], [])) == []

    def test_its_outliers_are_those_of_the_filter_alone(self):
        """This holds if all points are in range rings and pass the thresholds."""
        frame = sea_frame(3)
        everything = {"start_m": 0.0, "end_m": 1e6, "ring_width_m": 1e6, "initial_thresholds": (0.0,)}
        stage = {f"outlier_{name}": value for name, value in vars(PRESETS["open"]).items()}
        joint = FILTERS["ring_intensity_outlier"].Params(**everything, outlier_stage="adaptive_radius", **stage)
        alone = AdaptiveRadius(AdaptiveRadiusParams()).step(frame).reason
        np.testing.assert_array_equal(FILTERS["ring_intensity_outlier"](joint).step(frame).reason, alone)

    def test_keys_are_completed_or_rejected(self):
        params = FILTERS["joint"].Params
        made = params(outlier_stage="adaptive_radius", outlier_min_neighbors=9)
        assert (made.outlier_radius_ratio, made.outlier_min_neighbors) == (0.025, 9)
        with pytest.raises(ValueError, match="outlier_min_neighbors: valid only with outlier_stage adaptive_radius"):
            params(outlier_min_neighbors=3)
