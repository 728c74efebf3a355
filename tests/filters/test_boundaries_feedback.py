"""Boundary cases of invalid points, corrections and global thresholds; see `test_boundaries`."""

import math

import numpy as np
import pytest

from seaclutter_cli.errors import FieldError
from seaclutter_cli.filters import FILTERS
from tests.filters.frames import make_frame, on_axis, row_and_points
from tests.filters.steps import EXCLUDED, FAR, INVALID, KEPT, LOW, NEAR, OUTLIER, below, reasons

RING_METHODS = ["ring_intensity", "ring_intensity_outlier", "joint"]
INTENSITY_METHODS = [*RING_METHODS, "global_intensity"]


class TestInvalid:
    @pytest.mark.parametrize("name", [*RING_METHODS, "sor", "ror"])
    @pytest.mark.parametrize(
        "point", [(0, 0, 0), (-0.0, 0, -0.0), (math.nan, 1, 1), (20, math.inf, 1), (20, 0, -math.inf)]
    )
    def test_points_without_a_position(self, make, name, point):
        result = make(name).step(make_frame([point] * 3, 100))
        assert list(result.reason) == [INVALID] * 3
        assert result.rings is None or sum(result.rings.points) == 0

    @pytest.mark.parametrize("name", [*RING_METHODS, "sor", "ror"])
    @pytest.mark.parametrize("intensity", [math.nan, math.inf, -math.inf])
    def test_points_without_an_intensity(self, make, name, intensity):
        result = make(name).step(on_axis([20, 21, 5, 80], intensity))
        assert list(result.reason) == [INVALID] * 4

    @pytest.mark.parametrize("name", ["sor", "ror"])
    def test_invalid_points_are_not_neighbors(self, make, name):
        xyz = np.zeros((40, 3))
        xyz[20:, 0] = math.nan
        frame = make_frame(np.concatenate([xyz, [[0.1, 0, 0], [0.2, 0, 0]]]))
        kept = KEPT if name == "sor" else OUTLIER
        assert reasons(make(name), frame) == [INVALID] * 40 + [kept] * 2

    def test_a_tiny_position_is_valid(self, make):
        """The square of the coordinate is 0 in double precision."""
        assert reasons(make("ring_intensity"), make_frame([[1e-200, 0, 0]], 100)) == [NEAR]

    def test_a_huge_position_is_far(self, make):
        """The square of the coordinate is infinite in double precision."""
        assert reasons(make("ring_intensity", far="drop"), make_frame([[1e200, 0, 0]], 100)) == [FAR]

    def test_none_keeps_them(self, make):
        assert (
            reasons(make("none"), make_frame([[0, 0, 0], [math.nan, 0, 0], [1, 1, 1]], [1, 1, math.nan])) == [KEPT] * 3
        )

    @pytest.mark.parametrize("name", INTENSITY_METHODS)
    def test_a_cloud_without_intensity(self, name):
        threshold = {"threshold": 5.0} if name == "global_intensity" else {}
        method = FILTERS[name](FILTERS[name].Params(**threshold))
        with pytest.raises(FieldError, match="intensity"):
            method.step(on_axis([20, 30], None))

    @pytest.mark.parametrize("name", ["sor", "ror", "none"])
    def test_methods_that_need_no_intensity(self, name):
        method = FILTERS[name](FILTERS[name].Params())
        assert reasons(method, on_axis([20.0] * 9, None)) == [KEPT] * 9


class TestCorrection:
    """Corrections from a row of 11 points 1/8 m apart and an outlier 2 m behind them."""

    SEA = on_axis(row_and_points(2), [40] * 11 + [100])
    CALM = on_axis(row_and_points(), 40)

    def test_worked_example(self, make):
        method = make("joint")
        first = method.step(self.SEA)
        assert list(first.reason) == [KEPT] * 11 + [OUTLIER]
        assert list(first.rings.thresholds) == [30, 16, 7, 4]
        assert list(first.rings.corrections) == [0, 0, 0, 0]
        assert list(first.rings.points) == [12, 0, 0, 0]
        assert list(first.rings.outliers) == [1, 0, 0, 0]
        # One outlier of 100 gives 100 / 2, which raises the threshold by 0.4 of the difference between 30 and 50.
        second = method.step(on_axis(row_and_points()[:4], [38, 37, 39, 30]))
        assert list(second.rings.corrections) == pytest.approx([50, 0, 0, 0])
        assert list(second.rings.thresholds) == pytest.approx([38, 16, 7, 4])
        assert list(second.reason) == [KEPT, LOW, KEPT, LOW]
        assert list(second.rings.low_intensity) == [2, 0, 0, 0]

    def test_divides_by_one_more_than_the_outliers(self, make):
        method = make("joint", update_weight=0.2)
        first = method.step(on_axis(row_and_points(1.5, 3), [40] * 11 + [100, 50]))
        assert list(first.reason) == [KEPT] * 11 + [OUTLIER] * 2
        # Two outliers give (100 + 50) / 3, which raises the threshold by 0.8 of the difference between 30 and 50.
        assert list(method.step(self.CALM).rings.thresholds) == pytest.approx([46, 16, 7, 4])

    def test_dark_points_do_not_contribute(self, make):
        method = make("joint")
        method.step(on_axis([*row_and_points(2), 24.5], [40] * 11 + [100, 29]))
        assert list(method.step(self.CALM).rings.corrections) == [50, 0, 0, 0]

    def test_returns_to_zero_without_outliers(self, make):
        method = make("joint")
        method.step(self.SEA)
        assert list(method.step(self.CALM).rings.thresholds) == pytest.approx([38, 16, 7, 4])
        result = method.step(self.CALM)
        assert list(result.rings.thresholds) == [30, 16, 7, 4]
        assert list(result.rings.corrections) == [0, 0, 0, 0]

    @pytest.mark.parametrize(
        "frame",
        [on_axis([]), on_axis([20, 21, 22], 1), on_axis([20, 21], math.nan), on_axis([5, 80])],
        ids=["no points", "all removed", "all invalid", "outside the range rings"],
    )
    def test_returns_to_zero_when_nothing_is_left(self, make, frame):
        method = make("joint")
        method.step(self.SEA)
        assert method.step(frame).rings.thresholds[0] == pytest.approx(38)
        assert list(method.step(self.CALM).rings.thresholds) == [30, 16, 7, 4]

    def test_does_not_add_up(self, make):
        """The correction comes from the last frame only, not from the correction before it."""
        method = make("joint")
        for _ in range(5):
            result = method.step(self.SEA)
        assert list(result.rings.corrections) == [50, 0, 0, 0]
        assert list(result.rings.thresholds) == pytest.approx([38, 16, 7, 4])

    def test_each_range_ring_has_its_own(self, make):
        method = make("joint")
        method.step(on_axis([*row_and_points(2), *row_and_points(2) + 22], [40] * 11 + [100] + [16] * 11 + [20]))
        assert list(method.step(self.CALM).rings.corrections) == [50, 0, 10, 0]

    def test_reset_forgets(self, make):
        method = make("joint")
        method.step(self.SEA)
        method.reset()
        assert list(method.step(self.SEA).rings.corrections) == [0, 0, 0, 0]

    def test_a_weight_of_one_leaves_the_initial_thresholds(self, make):
        still, plain = make("joint", update_weight=1.0), make("ring_intensity_outlier")
        for frame in (self.SEA, self.SEA, self.CALM):
            result, expected = still.step(frame), plain.step(frame)
            assert list(result.reason) == list(expected.reason)
            assert list(result.rings.thresholds) == [30, 16, 7, 4]
            assert list(expected.rings.corrections) == [0, 0, 0, 0]

    def test_without_correction(self, make):
        for name in ("ring_intensity", "ring_intensity_outlier"):
            method = make(name)
            method.step(self.SEA)
            assert list(method.step(self.SEA).rings.thresholds) == [30, 16, 7, 4]

    def test_ring_intensity_finds_no_outliers(self, make):
        result = make("ring_intensity").step(self.SEA)
        assert list(result.reason) == [KEPT] * 12
        assert list(result.rings.outliers) == [0, 0, 0, 0]


class TestGlobalIntensity:
    @staticmethod
    def first_pass(method, *frames):
        for frame in frames:
            method.observe(frame)
        return method

    @pytest.mark.parametrize("name", FILTERS)
    def test_only_global_intensity_needs_a_first_pass(self, name):
        assert FILTERS[name](FILTERS[name].Params()).needs_first_pass is (name == "global_intensity")

    def test_a_given_threshold_needs_no_first_pass(self):
        method = FILTERS["global_intensity"](FILTERS["global_intensity"].Params(threshold=5.0))
        assert method.needs_first_pass is False
        assert reasons(method, on_axis([10, 20, 60], [below(5), 5, 6])) == [LOW, KEPT, KEPT]

    @pytest.mark.parametrize(
        ("rate", "intensity", "low"),
        [
            (0.8, range(10), 8),
            (0.8, [5] * 8 + [9, 9], 8),
            (0.8, [5] * 7 + [9] * 3, 10),
            (0.8, [5] * 10, 10),
            (0.9, range(10), 9),
            (0.81, range(10), 9),
            (0.55, range(100), 55),
            (0.07, range(100), 7),
            (1.0, range(10), 10),
            (0.8, [value + 0.25 for value in range(10)], 8),
            (0.8, [0.1] * 8 + [0.1001] * 2, 8),
            (0.8, [1e-3] * 7 + [1.0] * 3, 10),
            (0.8, [-3, -2, -1, 0, 1], 4),
            (0.8, [0, 10, 1000, 30000, 65535], 4),
        ],
    )
    def test_smallest_threshold_that_removes_the_share(self, make, rate, intensity, low):
        """This includes 0.55 * 100, which is slightly more than 55 in floating point."""
        frame = on_axis(np.linspace(10, 69, len(intensity)), list(intensity))
        method = self.first_pass(make("global_intensity", filter_rate=rate), frame)
        assert reasons(method, frame) == [LOW] * low + [KEPT] * (len(intensity) - low)

    @pytest.mark.parametrize("scale", [1e-3, 1, 300])
    def test_threshold_of_fractional_intensities_is_accurate_to_an_eight_thousandth(self, scale):
        """The share is reached, and the threshold is at most an eight-thousandth too high."""
        intensity = scale * np.random.default_rng(1).uniform(0.1, 1, 50_000)
        frame = on_axis(np.full(50_000, 20), intensity)
        method = self.first_pass(FILTERS["global_intensity"](FILTERS["global_intensity"].Params()), frame)
        exact = np.sort(intensity)[39_999]
        assert method.step(frame).counts[LOW] >= 40_000
        assert exact < method.step(frame).rings.thresholds[0] <= exact * (1 + 1 / 8000)

    def test_fractions_may_come_late(self, make):
        """Whole intensities counted before them still count."""
        whole, fractional = on_axis([20] * 8, [1, 2, 3, 4, 5, 6, 7, 8]), on_axis([20] * 2, [9.5, 10.5])
        method = self.first_pass(make("global_intensity"), whole, fractional)
        assert reasons(method, whole) == [LOW] * 8
        assert reasons(method, fractional) == [KEPT] * 2

    def test_whole_intensities_have_a_whole_threshold(self, make):
        """For 0 to 9 and a rate of 0.8 it is 8, so 7.5 in a frame outside the first pass is below it."""
        method = self.first_pass(make("global_intensity"), on_axis([20] * 10, range(10)))
        assert reasons(method, on_axis([20, 20, 20], [7.5, below(8), 8])) == [LOW, LOW, KEPT]

    def test_only_points_within_the_range_limits_count(self, make):
        """Points nearer than 10 m, at 70 m and beyond, own structure and invalid points are left out."""
        xyz = [[x, 0, 0] for x in (10, 20, 30, 40, below(70), below(10), 70, 5, 80, 0)] + [
            [20, 5, 0],
            [20, math.nan, 0],
        ]
        intensity = [1, 2, 3, 4, 5] + [200] * 7
        frame = make_frame([*xyz, [20, 0, 0]], [*intensity, math.nan])
        method = make("global_intensity", exclude_boxes=[(19, 21, 4, 6, -1, 1)])
        expected = [LOW] * 4 + [KEPT, NEAR, KEPT, NEAR, KEPT, INVALID, EXCLUDED, INVALID, INVALID]
        assert reasons(self.first_pass(method, frame), frame) == expected

    def test_one_threshold_per_recording(self, make):
        dark, bright = on_axis([20] * 8, 1), on_axis([20] * 2, 50)
        method = self.first_pass(make("global_intensity"), bright, dark)
        assert reasons(method, dark) == [LOW] * 8
        assert reasons(method, bright) == [KEPT] * 2

    def test_reset_forgets(self, make):
        method = self.first_pass(make("global_intensity"), on_axis([20] * 10, 200))
        method.reset()
        self.first_pass(method, on_axis([20] * 10, range(10)))
        assert reasons(method, on_axis([20] * 2, [7, 8])) == [LOW, KEPT]

    @pytest.mark.parametrize("frame", [on_axis([]), on_axis([5, 80]), on_axis([20], math.nan)])
    def test_first_pass_without_points(self, make, frame):
        method = self.first_pass(make("global_intensity"), frame)
        assert LOW not in reasons(method, frame)
