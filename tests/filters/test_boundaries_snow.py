"""Boundary cases of the rules for snow (DROR, DSOR, LIOR, LIDSOR, naive)."""

import math
import time
from collections import Counter

import numpy as np
import pytest

from seaclutter_cli import neighbors as neighbor_search
from seaclutter_cli.errors import FieldError
from seaclutter_cli.filters import FILTERS
from tests.filters.frames import make_frame, on_axis
from tests.filters.steps import INVALID, KEPT, LOW, OUTLIER, above, below, reasons

METHODS = ["dror", "dsor", "lior", "lidsor", "naive"]
DIM = {"dror": None, "dsor": None, "lior": 5, "lidsor": 4, "naive": 0}
"""Intensity at which each method may remove a point."""
SMALL = 1e-7
HALF_THE_RANGE = {"radius_multiplier": 0.5, "angle_deg": 30.0, "min_points": 2}
"""Parameters that make the search radius of DROR half the horizontal range."""


def pairs(*gaps, range_m, intensity=0):
    """Return a frame of distant pairs of points at one range, with the given gap within each pair."""
    gap, bearing = np.repeat(gaps, 2), np.repeat(np.arange(len(gaps)), 2) * math.pi / 2
    height = gap / 2 * np.tile([-1, 1], len(gaps))
    level = np.sqrt(range_m**2 - height**2)
    return make_frame(np.column_stack([level * np.cos(bearing), level * np.sin(bearing), height]), intensity)


def settings_of(name):
    return vars(FILTERS[name].Params())


def test_defaults():
    assert settings_of("dror") == {"radius_multiplier": 3, "angle_deg": 0.16, "min_radius_m": 0.04, "min_points": 3}
    assert settings_of("dsor") == {"neighbors": 4, "std_ratio": 0.01, "range_multiplier_per_m": 0.05}
    assert settings_of("lior") == {"intensity_threshold": 5, "max_range_m": 71.2, "radius_m": 0.1, "min_neighbors": 3}
    spatial = {"neighbors": 50, "std_ratio": 0.15, "range_multiplier_per_m": 0.05}
    assert settings_of("lidsor") == {**spatial, "intensity_threshold": 5, "max_range_m": 20}
    assert settings_of("naive") == {"intensity_threshold": 1, "max_range_m": 20}


class TestAll:
    @pytest.mark.parametrize("name", METHODS)
    def test_no_points(self, make, name):
        assert reasons(make(name), on_axis([], [])) == []

    @pytest.mark.parametrize(
        ("name", "one", "two"),
        [
            ("dror", OUTLIER, OUTLIER),
            ("dsor", KEPT, OUTLIER),
            ("lior", OUTLIER, OUTLIER),
            ("lidsor", KEPT, OUTLIER),
            ("naive", LOW, LOW),
        ],
    )
    def test_one_or_two_points(self, make, name, one, two):
        """As in SOR, a single point has no distance to others; as in ROR, it has too few of them."""
        assert reasons(make(name), on_axis(10, DIM[name])) == [one]
        assert reasons(make(name), on_axis([10, 10.5], DIM[name])) == [two] * 2

    @pytest.mark.parametrize("name", ["dsor", "lidsor"])
    def test_with_too_few_others_all_are_used(self, make, name):
        frame = on_axis([14, 15, 16, 19], 0)
        assert set(reasons(make(name, neighbors=3), frame)) == {KEPT, OUTLIER}
        assert reasons(make(name, neighbors=3), frame) == reasons(make(name, neighbors=10**9), frame)

    @pytest.mark.parametrize("name", METHODS)
    def test_invalid_points_keep_that_reason_and_are_not_neighbors(self, make, name):
        xyz = [[0, 0, 0]] * 20 + [[math.nan, 0, 0]] * 20 + [[0.01, 0, 0]] * 20
        intensity = np.array([0] * 40 + [math.inf] * 20)
        frame = make_frame([*xyz, [0.01, 0, 0.01]], [*intensity, 0])
        alone = KEPT if name in {"dsor", "lidsor"} else LOW if name == "naive" else OUTLIER
        assert reasons(make(name), frame) == [INVALID] * 60 + [alone]

    @pytest.mark.parametrize("name", ["lior", "lidsor", "naive"])
    def test_a_cloud_without_intensity(self, name):
        with pytest.raises(FieldError, match="intensity"):
            FILTERS[name](FILTERS[name].Params()).step(on_axis([20, 30], None))

    @pytest.mark.parametrize("search", ["fast", "slow"])
    @pytest.mark.parametrize("name", METHODS)
    @pytest.mark.parametrize("positions", [1, 2, 200])
    def test_many_equal_points_are_fast(self, monkeypatch, name, positions, search):
        if search == "slow":
            monkeypatch.setattr(neighbor_search, "_FastTree", None)
        xyz = np.random.default_rng(1).normal((15, 0, 0), 0.5, (positions, 3)).repeat(60_000 // positions, axis=0)
        method = FILTERS[name](FILTERS[name].Params())
        start = time.perf_counter()
        expected = {"dsor": OUTLIER, "naive": LOW}.get(name, KEPT)
        assert Counter(reasons(method, make_frame(xyz, DIM[name]))) == {expected: 60_000}
        assert time.perf_counter() - start < 5


class TestDror:
    @pytest.mark.parametrize("height", [0, 100])
    @pytest.mark.parametrize(("distance", "reason"), [(2, KEPT), (2 * (1 + SMALL), OUTLIER)])
    def test_points_at_the_radius_are_neighbors(self, make, distance, reason, height):
        """The radius depends on the horizontal range, while the distance is 3D."""
        frame = make_frame([[4, 0, height], [4, 0, height + distance]])
        assert reasons(make("dror", **HALF_THE_RANGE), frame) == [reason] * 2

    def test_each_point_has_its_own_radius(self, make):
        assert reasons(make("dror", **HALF_THE_RANGE), on_axis([4, 8])) == [OUTLIER, KEPT]

    @pytest.mark.parametrize(("distance", "reason"), [(0.04, KEPT), (0.04 * (1 + SMALL), OUTLIER)])
    def test_smallest_radius(self, make, distance, reason):
        """Directly above the lidar the horizontal range is 0."""
        frame = make_frame([[0, 0, 5], [0, 0, 5 + distance]])
        assert reasons(make("dror", min_points=2), frame) == [reason] * 2

    @pytest.mark.parametrize(("points", "reason"), [(1, OUTLIER), (2, OUTLIER), (3, KEPT), (4, KEPT)])
    def test_the_point_itself_counts(self, make, points, reason):
        """Its duplicates count, too."""
        assert reasons(make("dror"), on_axis([20.0] * points)) == [reason] * points

    @pytest.mark.parametrize(("spacing", "reason"), [(0.959, KEPT), (0.961, OUTLIER)])
    def test_points_of_a_revolution(self, make, spacing, reason):
        """The default radius at 40 m is a chord of approximately 6 x 0.16 degrees."""
        angles = np.radians(spacing * np.arange(9))
        frame = make_frame(np.column_stack([40 * np.cos(angles), 40 * np.sin(angles), np.full(9, -2)]))
        assert reasons(make("dror"), frame)[1:-1] == [reason] * 7


class TestDsor:
    @pytest.mark.parametrize(
        ("range_m", "reason"), [(19, OUTLIER), (20, OUTLIER), (20 * (1 + SMALL), KEPT), (21, KEPT)]
    )
    def test_equal_to_the_limit_is_removed(self, make, range_m, reason):
        """Mean 1 and deviation 0 give a limit of 0.05 per metre of range."""
        assert reasons(make("dsor"), pairs(1, range_m=range_m)) == [reason] * 2

    @pytest.mark.parametrize(("last", "reason"), [(6, OUTLIER), (6 * (1 - SMALL), KEPT)])
    def test_mean_and_sample_deviation(self, make, last, reason):
        """Pairs with gaps of 1, 4, 5 and 6: mean 4, deviation 2, limit (4 + 2) * 0.01 * 100 at 100 m."""
        method = make("dsor", neighbors=1, std_ratio=1.0, range_multiplier_per_m=0.01)
        assert reasons(method, pairs(1, 4, 5, last, range_m=100)) == [KEPT] * 6 + [reason] * 2

    def test_equal_points_are_removed(self, make):
        """Their distances and the limit are 0."""
        assert reasons(make("dsor"), on_axis([20.0] * 9)) == [OUTLIER] * 9

    def test_needs_no_intensity(self, make):
        assert reasons(make("dsor"), on_axis([30, 31, 32], None)) == [KEPT] * 3


class TestLior:
    @pytest.mark.parametrize(("intensity", "reason"), [(5, OUTLIER), (above(5), KEPT)])
    def test_equal_to_the_threshold_is_removed(self, make, intensity, reason):
        assert reasons(make("lior"), on_axis(20, intensity)) == [reason]

    @pytest.mark.parametrize(("range_m", "reason"), [(71.2, OUTLIER), (above(71.2), KEPT)])
    def test_equal_to_the_maximum_range_is_removed(self, make, range_m, reason):
        assert reasons(make("lior"), on_axis(range_m, 0)) == [reason]

    @pytest.mark.parametrize(("distance", "reason"), [(0.5, KEPT), (above(0.5), OUTLIER)])
    def test_points_at_the_radius_are_neighbors(self, make, distance, reason):
        method = make("lior", radius_m=0.5, min_neighbors=1)
        assert reasons(method, make_frame([[0, 1, 0], [0, 1, distance]], 0)) == [reason] * 2

    @pytest.mark.parametrize(("others", "reason"), [(2, OUTLIER), (3, KEPT)])
    def test_other_points_count(self, make, others, reason):
        """The point itself does not count, its duplicates do."""
        assert reasons(make("lior"), on_axis([20.0] * (others + 1), 0)) == [reason] * (others + 1)

    def test_bright_and_far_points_are_neighbors_and_are_kept(self, make):
        assert reasons(make("lior"), on_axis([20, 20.05, 20.05, 19.95, 30], [5, 99, 6, 99, 99])) == [KEPT] * 5
        assert reasons(make("lior"), on_axis([71.2, 71.25, 71.25, 71.25, 90], 0)) == [KEPT] * 5
        assert reasons(make("lior"), on_axis([20, 20.05, 20.05, 30], [5, 99, 99, 99])) == [OUTLIER, KEPT, KEPT, KEPT]

    def test_few_candidates_among_many(self, make):
        """A search for some points finds the same neighbours as a search for all points."""
        xyz = np.random.default_rng(2).integers(0, 12, (500, 3)) / 8 + [20, 0, 0]  # some are equal
        intensity = np.where(np.arange(500) % 50, 99, 1)
        everything = np.array(reasons(make("ror", radius_m=0.125, min_neighbors=2), make_frame(xyz)))
        some = reasons(make("lior", radius_m=0.125, min_neighbors=2), make_frame(xyz, intensity))
        assert set(everything[::50]) == {KEPT, OUTLIER}
        assert some == np.where(intensity == 1, everything, KEPT).tolist()


class TestLidsor:
    @pytest.mark.parametrize(("intensity", "reason"), [(below(5), OUTLIER), (5, KEPT)])
    def test_equal_to_the_threshold_is_kept(self, make, intensity, reason):
        assert reasons(make("lidsor"), on_axis([10, 11], intensity)) == [reason] * 2

    @pytest.mark.parametrize(("range_m", "reason"), [(below(16), OUTLIER), (16, KEPT)])
    def test_equal_to_the_maximum_range_is_kept(self, make, range_m, reason):
        assert reasons(make("lidsor", max_range_m=16.0), on_axis([range_m, range_m - 1], 0)) == [reason, OUTLIER]

    @pytest.mark.parametrize(("range_m", "reason"), [(20 * (1 - SMALL), OUTLIER), (20, KEPT), (21, KEPT)])
    def test_equal_to_the_limit_is_kept(self, make, range_m, reason):
        """Mean 1 and deviation 0 give a limit of 0.05 per metre of range."""
        assert reasons(make("lidsor", max_range_m=99.0), pairs(1, range_m=range_m)) == [reason] * 2

    @pytest.mark.parametrize(("last", "reason"), [(6, KEPT), (6 * (1 + SMALL), OUTLIER)])
    def test_mean_and_sample_deviation(self, make, last, reason):
        method = make("lidsor", neighbors=1, std_ratio=1.0, range_multiplier_per_m=0.01, max_range_m=200.0)
        assert reasons(method, pairs(1, 4, 5, last, range_m=100)) == [KEPT] * 6 + [reason] * 2

    def test_the_limit_depends_on_all_points(self, make):
        """A gap of 1 exceeds the limit of 0.5 of its own pair, but not the limit of 3.5 with three gaps of 9."""
        method = make("lidsor", neighbors=1, std_ratio=0.0)
        assert reasons(method, pairs(1, range_m=10)) == [OUTLIER] * 2
        assert reasons(method, pairs(1, 9, 9, 9, range_m=10, intensity=[0] * 2 + [9] * 6)) == [KEPT] * 8


class TestNaive:
    @pytest.mark.parametrize(("intensity", "reason"), [(below(1), LOW), (1, KEPT)])
    def test_equal_to_the_threshold_is_kept(self, make, intensity, reason):
        assert reasons(make("naive"), on_axis(10, intensity)) == [reason]

    @pytest.mark.parametrize(("range_m", "reason"), [(0.001, LOW), (below(20), LOW), (20, KEPT)])
    def test_equal_to_the_maximum_range_is_kept(self, make, range_m, reason):
        assert reasons(make("naive"), on_axis(range_m, 0)) == [reason]

    def test_range_has_three_dimensions(self, make):
        assert reasons(make("naive"), make_frame([[12, 0, 16], [0, 12, 15.9]], 0)) == [KEPT, LOW]
