"""Calibration compared with its definition on sorted clutter points."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from seaclutter_cli.calibration import Calibration, ClutterSelector, FarLimit, few_points
from seaclutter_cli.errors import FieldError, InputError
from seaclutter_cli.filters import histogram as module
from seaclutter_cli.filters.histogram import IntensityHistogram
from seaclutter_cli.filters.joint import JointParams
from seaclutter_cli.truth import CLUTTER, IGNORED, Boxes, Truth
from tests.filters.frames import make_frame, on_axis

RATES = st.sampled_from([0.01, 0.5, 0.55, 0.8, 0.9, 0.99, 1.0])
WHOLE = st.one_of(st.integers(0, 9), st.integers(0, 255), st.integers(-300, 70_000))
FRACTIONS = st.one_of(
    st.sampled_from([0.0, 0.1, 0.25, 1.0]),
    st.floats(0, 1, width=32),
    st.floats(-5, 5, width=32),
    st.floats(allow_nan=False, allow_infinity=False, width=32),
    st.floats(0, 1e300),
)


def batches(values):
    return st.lists(st.lists(values, max_size=40).map(lambda some: np.array(some, float)), min_size=1, max_size=8)


def last_below(values, rate):
    """Return the largest value to remove."""
    values = np.sort(values)
    return values[math.ceil(Fraction(str(rate)) * len(values)) - 1]


def added(kind, recordings):
    """Return the sum of what the parts of each recording give."""
    total = kind()
    for parts in recordings:
        total += fill(kind, parts)
    return total


def nbytes(histogram):
    arrays = (histogram._values, histogram._counts, *histogram._pending, *histogram._levels)
    return sum(array.nbytes for array in arrays)


def fill(kind, parts):
    counted = kind()
    for part in parts:
        counted.add(part)
    return counted


def params(**given):
    rings = math.ceil((given.get("end_m", 70) - given.get("start_m", 10)) / given.get("ring_width_m", 15) - 1e-9)
    return JointParams(**{"initial_thresholds": (0,) * rings, **given})


def calibrate(ranges, intensity, *, parts=1, filter_rate=0.8, keep_end=False, **given):
    calibration = Calibration(params(**given), filter_rate=filter_rate, keep_end=keep_end)
    calibration.see(np.array([np.inf]))  # the lidar is not saturated
    for some in np.array_split(np.arange(len(ranges)), parts):
        calibration.add(np.asarray(ranges, float)[some], np.asarray(intensity, float)[some])
    return calibration.thresholds()


class TestHistogram:
    @given(batches(WHOLE), RATES)
    def test_whole_numbers_have_the_smallest_whole_threshold(self, parts, rate):
        values = np.concatenate(parts)
        assume(len(values))
        threshold = fill(IntensityHistogram, parts).threshold(rate)
        assert threshold == last_below(values, rate) + 1
        assert np.mean(values < threshold) >= rate
        assert np.mean(values < threshold - 1) < rate

    @given(batches(FRACTIONS), RATES)
    def test_few_fractional_values_are_exact(self, parts, rate):
        values = np.concatenate(parts)
        assume(len(values) and (values != np.floor(values)).any())
        threshold = fill(IntensityHistogram, parts).threshold(rate)
        assert threshold == math.nextafter(last_below(values, rate), math.inf)
        assert np.mean(values < threshold) >= rate

    @pytest.mark.parametrize(
        "draw",
        [
            lambda rng, size, _: rng.random(size),
            lambda rng, size, _: rng.pareto(0.5, size).astype("f4"),
            lambda rng, size, _: -rng.lognormal(0, 3, size),
            lambda rng, size, at: at + rng.random(size),  # each frame brighter than the last
            lambda rng, size, at: rng.random(size) / (1 + at),
            lambda rng, size, at: np.where(rng.random(size) < 0.9, 0.125, rng.random(size)),
            lambda rng, size, at: rng.random(size) if at == 0 else 0.5 + 1e-4 * rng.random(size),
            lambda rng, size, at: np.sort(np.concatenate([rng.integers(0, 60_000, size), rng.random(size)]))[:size],
        ],
    )
    def test_many_values_within_a_thousandth_of_rank_in_bounded_memory(self, draw):
        rng = np.random.default_rng(4)
        parts = [draw(rng, 50_000, at) for at in range(40)]
        histogram = fill(IntensityHistogram, parts)
        values = np.sort(np.concatenate(parts))
        assert histogram.rank_error <= 0.0005 * len(values)
        assert histogram.distribution()[1].sum() == len(values)
        for rate in (0.1, 0.5, 0.8, 0.9, 0.99):
            threshold = histogram.threshold(rate)
            last = math.nextafter(threshold, -math.inf)
            assert np.searchsorted(values, last, side="left") / len(values) <= rate + 0.001
            assert np.searchsorted(values, last, side="right") / len(values) >= rate - 0.001
        assert nbytes(histogram) < 5_000_000

    def test_memory_does_not_grow_with_the_log(self):
        rng = np.random.default_rng(0)
        sketch = IntensityHistogram()
        sizes = []
        for _ in range(120):
            sketch.add(rng.random(60_000))
            sizes.append(nbytes(sketch))
        assert max(sizes[60:]) <= max(sizes[:60]) + 8 * 2 * module._LEVEL

    @given(st.lists(batches(st.one_of(WHOLE, FRACTIONS)), min_size=1, max_size=4))
    def test_sums_of_recordings_are_exact(self, recordings):
        whole = fill(IntensityHistogram, [part for parts in recordings for part in parts])
        summed = added(IntensityHistogram, recordings)
        np.testing.assert_array_equal(summed.distribution(), whole.distribution())
        assert summed.all_whole == whole.all_whole
        assert summed.rank_error == 0

    @given(
        st.lists(batches(FRACTIONS), min_size=1, max_size=5), st.integers(2, 7), st.integers(2, 40), st.integers(1, 40)
    )
    def test_errors_of_sketches_add_up(self, recordings, level, distinct, pending):
        """Every list of values exceeds the patched limits."""
        with pytest.MonkeyPatch.context() as patch:
            for name, value in (("_LEVEL", level), ("_DISTINCT", distinct), ("_PENDING", pending)):
                patch.setattr(module, name, value)
            sketch, again = (added(IntensityHistogram, recordings) for _ in range(2))
            values, counts = sketch.distribution()
            np.testing.assert_array_equal(again.distribution(), (values, counts))
        seen = np.sort(np.concatenate([part for parts in recordings for part in parts]))
        assert counts.sum() == len(seen)
        ranks = np.searchsorted(values, seen, side="right")
        estimated = np.append(0, np.cumsum(counts))[ranks]
        assert (np.abs(estimated - np.searchsorted(seen, seen, side="right")) <= sketch.rank_error).all()

    def test_forty_recordings_stay_within_a_thousandth_of_rank(self):
        rng = np.random.default_rng(5)
        recordings = [[rng.random(40_000) for _ in range(5)] for _ in range(40)]
        histogram = added(IntensityHistogram, recordings)
        assert 0 < histogram.rank_error < 0.001 * 8_000_000
        assert nbytes(histogram) < 5e6

    @pytest.mark.parametrize(
        ("values", "rate", "threshold"),
        [(range(100), 0.55, 55), (range(100), 0.07, 7), ([-1, -1, -1, 3], 0.7, 0), ([65535, 65536, 10**9], 0.5, 65537)],
    )
    def test_limits(self, values, rate, threshold):
        assert fill(IntensityHistogram, [np.array(list(values), float)]).threshold(rate) == threshold

    def test_nothing_counted(self):
        histogram = fill(IntensityHistogram, [np.zeros(0)])
        assert histogram.threshold(0.8) == 0
        assert histogram.all_whole

    def test_a_rate_of_zero_removes_nothing(self):
        assert fill(IntensityHistogram, [np.array([3.0, 5])]).threshold(0) == 3


class TestFarLimit:
    @staticmethod
    def by_sorting(ranges):
        """Return the first sorted range past which all differences are greater than a metre."""
        ranges = sorted(ranges)
        first = len(ranges) - 1
        while first and ranges[first] - ranges[first - 1] > 1:
            first -= 1
        return ranges[first]

    @staticmethod
    def found(ranges, parts=1):
        limit = FarLimit()
        for part in np.array_split(np.array(ranges, float), parts):
            limit.add(part)
        return limit.last_m

    @given(
        st.lists(
            st.one_of(st.floats(0, 60), st.integers(0, 200).map(float), st.sampled_from([10.5, 11.5, 12.5, 13.75])),
            min_size=1,
        ),
        st.integers(1, 5),
    )
    def test_as_by_sorting(self, ranges, parts):
        assert self.found(ranges, parts) == self.by_sorting(ranges)

    def test_impossible_ranges_are_left_out(self):
        assert self.found([12, 12.5, 10_000, 10_000, 1e300]) == 12.5
        assert self.found([]) is None

    @pytest.mark.parametrize(
        ("last_m", "end_m"), [(61.65, 70), (10.0, 25), (24.99, 25), (25.0, 25), (25.01, 40), (70.0, 70)]
    )
    def test_rounded_up_to_whole_rings(self, last_m, end_m):
        ranges = np.append(np.arange(10, last_m, 0.5), last_m)
        found = calibrate(ranges, np.ones(len(ranges)))
        assert (found.last_m, found.end_m, len(found.rings)) == (last_m, end_m, (end_m - 10) / 15)

    def test_rings_of_a_tenth_of_a_metre(self):
        found = calibrate(np.arange(10, 11.2, 0.01), np.ones(120), ring_width_m=0.1, end_m=11)
        assert found.end_m == 11.2
        assert len(JointParams(ring_width_m=0.1, end_m=11.2, initial_thresholds=found.initial_thresholds).edges) == 13

    def test_rounding_errors_add_no_ring(self):
        assert (10.3 - 10) / 0.1 > 3
        assert calibrate([10.0, 10.3], [1, 2], ring_width_m=0.1, end_m=11).end_m == 10.3

    def test_clutter_beyond_the_last_possible_ring(self):
        with pytest.raises(InputError, match=r"clutter reaches 59\.50 m, but 250 range rings"):
            calibrate(np.arange(10, 60, 0.5), np.ones(100), ring_width_m=0.1, end_m=20)

    def test_one_wide_ring(self):
        found = calibrate([12, 13, 500, 20_000], [1, 2, 3, 4], ring_width_m=1e6, end_m=70)
        assert (found.end_m, found.last_m) == (1_000_010, 13)


class TestCalibration:
    @settings(deadline=None, max_examples=60)
    @given(st.integers(0, 10**6), st.integers(1, 7), RATES, st.sampled_from(["whole", "unit", "tail", "equal"]))
    def test_as_by_sorting(self, seed, parts, rate, kind):
        rng = np.random.default_rng(seed)
        size = int(rng.integers(1, 2000))
        ranges = 10 + 30 * rng.weibull(1.2, size)
        intensity = {
            "whole": lambda: np.floor(rng.exponential(600 / ranges)),
            "unit": lambda: rng.random(size).astype("f4").astype(float),
            "tail": lambda: rng.pareto(0.7, size) - 0.2,
            "equal": lambda: rng.choice([0.25, 0.5, 7], size),
        }[kind]()
        found = calibrate(ranges, intensity, parts=parts, filter_rate=rate)
        assert found.last_m == TestFarLimit.by_sorting(ranges)
        assert found.beyond == np.count_nonzero(ranges >= found.end_m)
        whole = (intensity == np.floor(intensity)).all()
        for number, ring in enumerate(found.rings):
            inside = np.sort(intensity[(ranges >= 10 + 15 * number) & (ranges < 25 + 15 * number)])
            assert ring.points == len(inside)
            assert ring.few == (len(inside) < few_points(rate))
            assert ring.below == np.count_nonzero(inside < ring.threshold)
            first, last_ring = ring.source
            assert ring.few or first == last_ring == number + 1
            used = np.sort(intensity[(ranges >= 15 * first - 5) & (ranges < 15 * last_ring + 10)])
            last = last_below(used, rate)
            above = used[used > last].min(initial=math.inf)
            assert last < ring.threshold <= (last + 1 if whole else above)
            assert ring.few or ring.filter_rate >= rate

    def test_thresholds_of_fractions_are_short(self):
        ranges = np.full(1000, 20.0)
        found = calibrate(ranges, np.linspace(0, 1, 1000).astype("f4"))
        assert found.initial_thresholds == (0.8,)
        assert [type(value) for value in calibrate(ranges, np.arange(1000)).initial_thresholds] == [int]

    def test_rings_without_points_use_the_threshold_of_another(self):
        ranges = np.repeat([26.0, 27, 30, 56, 57, 75], 100)
        intensity = np.repeat([9, 9, 9, 4, 4, 2], 100)
        found = calibrate(ranges, intensity, keep_end=True, end_m=90)
        assert found.initial_thresholds == (10, 10, 10, 5, 3, 3)
        assert [ring.source for ring in found.rings] == [(2, 2), (2, 2), (2, 2), (4, 4), (5, 5), (5, 5)]
        assert [ring.points for ring in found.rings] == [0, 300, 0, 200, 100, 0]
        assert found.rings[0].filter_rate is None

    def test_neighbours_with_few_points_are_pooled(self):
        points = {12.0: 300, 26.0: 60, 41.0: 60, 56.0: 12, 71.0: 500, 86.0: 30}
        ranges = np.repeat(list(points), list(points.values()))
        rng = np.random.default_rng(1)
        intensity = np.floor(rng.exponential(300 / ranges))
        found = calibrate(ranges, intensity)
        assert [ring.source for ring in found.rings] == [(1, 1), (2, 3), (2, 3), (2, 3), (5, 5), (5, 5)]
        together = np.sort(intensity[300:420])
        assert found.rings[1].threshold == found.rings[3].threshold == together[95] + 1  # 80 % of 120 are 96
        assert [ring.few for ring in found.rings] == [False, True, True, True, False, True]

    @pytest.mark.parametrize(
        ("rate", "threshold", "saturated"), [(0.8, 255, True), (0.7, 10, False), (1.0, 256, False)]
    )
    def test_saturation(self, rate, threshold, saturated):
        calibration = Calibration(JointParams(), filter_rate=rate)
        calibration.add(np.linspace(10, 20, 1000), np.repeat([9.0, 255.0], [750, 250]))
        (ring,) = calibration.thresholds().rings
        assert (ring.threshold, ring.saturated) == (threshold, saturated)
        assert ring.below == (1000 if rate == 1 else 750)

    def test_equal_clutter_below_brighter_points_is_not_saturated(self):
        """Snow returns nothing but 0; a threshold of 1 removes it and leaves the street."""
        calibration = Calibration(JointParams(), filter_rate=0.8)
        calibration.see(np.array([0.0, 40.0]))
        calibration.add(np.linspace(10, 20, 1000), np.zeros(1000))
        (ring,) = calibration.thresholds().rings
        assert (ring.threshold, ring.saturated, ring.below) == (1, False, 1000)

    def test_another_rate_without_another_pass(self):
        calibration = Calibration(JointParams(), filter_rate=0.8)
        calibration.add(np.linspace(10, 20, 1000), np.arange(1000.0))
        assert calibration.thresholds().initial_thresholds == (800,)
        calibration.filter_rate = 0.5
        assert calibration.thresholds().initial_thresholds == (500,)

    @pytest.mark.parametrize(("max_left", "below"), [(None, 800), (100, 800), (10, 900), (4, 960), (0.1, 980)])
    def test_dense_clutter_gets_a_higher_rate(self, max_left, below):
        """At most ``max_left`` points are left in each of ten frames, but at least 20 in all determine a threshold."""
        calibration = Calibration(JointParams(), filter_rate=0.8, max_left=max_left)
        for _ in range(10):
            calibration.see(np.array([np.inf]))
        ranges = np.append(np.linspace(10, 20, 1000), np.linspace(25, 39, 100))
        calibration.add(ranges, np.append(np.arange(1000.0), np.arange(100.0)))
        near, far = calibration.thresholds().rings
        assert near.below == below
        assert far.below == 80

    def test_a_ring_of_whole_numbers_in_a_log_of_fractions(self):
        found = calibrate(
            np.repeat([20.0, 20.5, 21.4, 22, 22.9, 23.8, 24.7, 25.5], 100), np.repeat([0, 0.5, 0], [100, 600, 100])
        )
        assert found.initial_thresholds[1] < 0.01

    def test_the_last_ring_is_cut_at_a_given_end(self):
        found = calibrate([20, 21, 39.9, 40, 55], [1, 2, 3, 4, 5], keep_end=True, end_m=40, ring_width_m=20)
        assert [(ring.start_m, ring.end_m, ring.points) for ring in found.rings] == [(10, 30, 2), (30, 40, 1)]
        assert (found.end_m, found.beyond) == (40, 2)

    @pytest.mark.parametrize(("rate", "points"), [(0.8, 100), (0.5, 100), (0.9, 200), (0.99, 2000), (1.0, 100)])
    def test_few_points(self, rate, points):
        assert few_points(rate) == points

    def test_no_clutter(self):
        with pytest.raises(InputError, match="no clutter point from 10 m on"):
            calibrate([], [])
        with pytest.raises(InputError, match="no clutter point between 10 and 70 m"):
            calibrate([80.0], [3], keep_end=True)

    def test_memory_is_bounded_by_rings(self):
        calibration = Calibration(params(ring_width_m=0.5), filter_rate=0.8)
        ranges = np.geomspace(10, 1e30, 10_000)
        calibration.add(ranges, np.ones(len(ranges)))
        assert len(calibration._rings) <= 250
        assert calibration.points == len(ranges)


class TestClutterSelector:
    @staticmethod
    def read(frame, truth=None, *, labelled=False, margin_m=0.0, **given):
        class Fixed:
            def truth(self, _):
                return truth

            def finish(self):
                pass

        selector = ClutterSelector(params(**given), Fixed() if labelled else None, margin_m)
        chosen = selector.clutter(frame)
        return selector, (frame.range_m[chosen].tolist(), frame.intensity[chosen].tolist())

    def test_every_valid_point_beyond_start_m(self):
        frame = on_axis([5, 9.99, 10, 69, 70, 500, math.nan, 30], [1, 2, 3, 4, 5, 6, 7, math.nan])
        reader, taken = self.read(frame)
        assert taken == ([10, 69, 70, 500], [3, 4, 5, 6])
        assert (reader.frames, reader.unlabelled, reader.marked) == (1, 0, 0)

    def test_own_structure_is_not_clutter(self):
        _, taken = self.read(on_axis([12, 20, 80], [1, 2, 3]), exclude_boxes=((11, 13, -1, 1, -1, 1),))
        assert taken == ([20, 80], [2, 3])

    def test_boxes_are_inflated(self):
        one = Boxes(("a",), ("ship",), np.array([[20.0, 0, 0]]), np.full((1, 3), 2.0), np.zeros(1))
        area = Boxes(("b",), ("ignore",), np.array([[40.0, 0, 0]]), np.full((1, 3), 2.0), np.zeros(1))
        frame = on_axis([18.4, 18.6, 20, 21.6, 30, 40, 41.4], 1)
        for margin_m, left in ((0, [18.4, 18.6, 21.6, 30, 41.4]), (0.5, [18.4, 21.6, 30])):
            reader, taken = self.read(frame, Truth(one, area), labelled=True, margin_m=margin_m)
            assert taken[0] == left
            assert reader.marked == 7 - len(left)

    def test_labelled_points(self):
        points = np.array([CLUTTER, 7, IGNORED, CLUTTER, 3])
        reader, taken = self.read(on_axis([20, 21, 22, 23, 2], 1), Truth(None, points=points), labelled=True)
        assert taken[0] == [20, 23]
        assert reader.marked == 2

    def test_frames_without_labels_are_counted(self):
        reader, taken = self.read(on_axis([20]), None, labelled=True)
        assert taken == ([], [])
        assert (reader.frames, reader.unlabelled) == (0, 1)

    @pytest.mark.parametrize("labelled", [False, True])
    def test_missing_fields(self, labelled):
        with pytest.raises(FieldError, match="no intensity field"):
            self.read(make_frame([[20, 0, 0]]), labelled=labelled)
