"""Boundary cases of every rule, computed by hand; the plain loops of `reference` must pass them, too."""

import math
import time
from collections import Counter
from functools import cache

import numpy as np
import pytest

from seaclutter_cli import neighbors as neighbor_search
from seaclutter_cli.filters import FILTERS
from seaclutter_cli.frame import Reason
from tests.filters.frames import make_frame, on_axis, row_and_points
from tests.filters.reference_points import outliers_of, points_of
from tests.filters.steps import EXCLUDED, FAR, INVALID, KEPT, LOW, NEAR, OUTLIER, below, reasons

RING_METHODS = ["ring_intensity", "ring_intensity_outlier", "joint"]
INTENSITY_METHODS = [*RING_METHODS, "global_intensity"]
NEIGHBOR_METHODS = ["ring_intensity_outlier", "joint", "sor", "ror"]


@cache
def cloud_sensitive_to_neighbors(size, neighbors):
    """Return random points, and their outliers, which differ for one neighbour more or fewer."""
    others = {neighbors + 1, max(neighbors - 1, 1)} - {neighbors}
    for seed in range(100):
        cloud = np.random.default_rng(seed).normal((17, 0, 0), (1, 2, 1), (size, 3))
        points = points_of(make_frame(cloud))
        outliers = outliers_of(points, neighbors, 1)
        if all(outliers != outliers_of(points, other, 1) for other in others):
            return cloud, outliers
    raise AssertionError("no such points")


def test_codes_of_the_reasons():
    names = ("KEPT", "INVALID", "NEAR", "LOW_INTENSITY", "OUTLIER", "FAR", "EXCLUDED", "UNCONFIRMED", "MIRRORED")
    assert [(reason.name, reason.value) for reason in Reason] == list(zip(names, range(9), strict=True))


class TestParams:
    @pytest.mark.parametrize("name", RING_METHODS)
    def test_defaults_of_rings(self, name):
        params = FILTERS[name].Params()
        assert (params.start_m, params.end_m, params.ring_width_m) == (10, 70, 15)
        assert tuple(params.initial_thresholds) == (30, 16, 7, 4)
        assert (params.near, params.far) == ("drop", "keep")
        assert len(params.exclude_boxes) == 0

    @pytest.mark.parametrize("name", ["ring_intensity_outlier", "joint"])
    def test_defaults_of_outliers(self, name):
        params = FILTERS[name].Params()
        assert (params.max_neighbors, params.neighbor_fraction, params.std_ratio) == (30, 0.1, 1)

    def test_defaults_of_single_methods(self):
        assert FILTERS["joint"].Params().update_weight == 0.6
        assert (FILTERS["sor"].Params().neighbors, FILTERS["sor"].Params().std_ratio) == (30, 1)
        assert (FILTERS["ror"].Params().radius_m, FILTERS["ror"].Params().min_neighbors) == (0.5, 5)
        params = FILTERS["global_intensity"].Params()
        assert (params.start_m, params.end_m, params.threshold, params.filter_rate) == (10, 70, None, 0.8)
        assert (params.near, params.far, len(params.exclude_boxes)) == ("drop", "keep", 0)

    @pytest.mark.parametrize("name", RING_METHODS)
    @pytest.mark.parametrize(
        ("rings", "params"),
        [
            (4, {}),
            (4, {"end_m": 55.5}),
            (3, {"end_m": 55.0}),
            (1, {"end_m": 11.0}),
            (2, {"end_m": 25.0000001}),
            (6, {"start_m": 0.2, "end_m": 0.8, "ring_width_m": 0.1}),
            (3, {"start_m": 1.1, "end_m": 4.4, "ring_width_m": 1.1}),
        ],
    )
    def test_one_threshold_per_range_ring(self, name, rings, params):
        """This includes (0.8 - 0.2) / 0.1, which is slightly more than 6 in floating point."""
        assert FILTERS[name].Params(initial_thresholds=(5,) * rings, **params)
        for wrong in (rings - 1, rings + 1):
            with pytest.raises(ValueError, match="initial_thresholds"):
                FILTERS[name].Params(initial_thresholds=(5,) * wrong, **params)


class TestRings:
    @pytest.mark.parametrize("name", RING_METHODS)
    @pytest.mark.parametrize(
        ("range_m", "ring", "reason"),
        [
            (below(10), None, NEAR),
            (10, 0, KEPT),
            (below(25), 0, KEPT),
            (25, 1, KEPT),
            (below(40), 1, KEPT),
            (40, 2, KEPT),
            (below(55), 2, KEPT),
            (55, 3, KEPT),
            (below(70), 3, KEPT),
            (70, None, KEPT),
            (71, None, KEPT),
        ],
    )
    def test_edges_belong_to_the_next_range_ring(self, make, name, range_m, ring, reason):
        result = make(name).step(on_axis(range_m))
        assert list(result.reason) == [reason]
        assert list(result.rings.points) == [int(k == ring) for k in range(4)]

    def test_an_edge_in_single_precision(self, make):
        ranges = [np.nextafter(np.float32(25), np.float32(0)), 25]
        result = make("ring_intensity").step(on_axis(ranges, coordinates="f4"))
        assert list(result.rings.points) == [1, 1, 0, 0]

    def test_range_has_three_dimensions(self, make):
        result = make("ring_intensity").step(make_frame([[15, 20, 0], [0, -15, 20], [-24, 0, -7], [12, 16, -15]], 99))
        assert list(result.rings.points) == [0, 4, 0, 0]

    @pytest.mark.parametrize(("range_m", "points"), [(55, [0, 0, 0, 1]), (below(62), [0, 0, 0, 1]), (62, [0, 0, 0, 0])])
    def test_last_range_ring_ends_at_the_far_limit(self, make, range_m, points):
        result = make("ring_intensity", end_m=62.0, far="drop").step(on_axis(range_m))
        assert list(result.rings.points) == points
        assert list(result.reason) == [KEPT if sum(points) else FAR]

    def test_every_point_has_a_range_ring_for_any_width(self, make):
        edges = 10 + np.arange(100) * 0.3
        ranges = np.concatenate([np.nextafter(edges, 0), edges, np.nextafter(edges, 99)])
        ranges = ranges[(ranges >= 10) & (ranges < 40)]
        method = make("ring_intensity", end_m=40.0, ring_width_m=0.3, initial_thresholds=(0,) * 100)
        assert sum(method.step(on_axis(ranges)).rings.points) == len(ranges)

    @pytest.mark.parametrize("name", INTENSITY_METHODS)
    def test_near_and_far_can_be_kept_or_dropped(self, make, name):
        frame = on_axis([5, 80], 0)
        threshold = {"threshold": 10.0} if name == "global_intensity" else {}
        assert reasons(make(name, **threshold), frame) == [NEAR, KEPT]
        assert reasons(make(name, near="keep", far="drop", **threshold), frame) == [KEPT, FAR]

    @pytest.mark.parametrize("name", ["ring_intensity_outlier", "joint"])
    def test_points_of_other_range_rings_are_not_neighbors(self, make, name):
        """The last point of the first range ring is near points just beyond the edge, which do not count."""
        result = make(name).step(on_axis([*row_and_points(), 24.875, 25.0, 25.125]))
        assert list(result.reason) == [KEPT] * 11 + [OUTLIER] + [KEPT] * 2
        assert list(result.rings.points) == [12, 2, 0, 0]

    @pytest.mark.parametrize("name", ["ring_intensity_outlier", "joint"])
    def test_removed_points_and_points_outside_the_range_rings_are_not_neighbors(self, make, name):
        ranges = [9.875, 10, *row_and_points(), row_and_points(2)[-1], row_and_points(2)[-1] + 0.125]
        method = make(name, std_ratio=0.0, near="keep")
        assert reasons(method, on_axis(ranges, [99] * 14 + [29])) == [KEPT, OUTLIER, *[KEPT] * 11, OUTLIER, LOW]


class TestExcluded:
    BOX = (20.0, 24.0, -1.0, 1.0, -2.0, 0.5)

    @pytest.mark.parametrize("name", INTENSITY_METHODS)
    def test_edges_belong_to_the_box(self, make, name):
        corners = [[x, y, z] for x in self.BOX[:2] for y in self.BOX[2:4] for z in self.BOX[4:]]
        outside = [[below(20), 0, 0], [24.000001, 0, 0], [22, -1.000001, 0], [22, 0, 0.500001], [22, 0, -2.000001]]
        threshold = {"threshold": 10.0} if name == "global_intensity" else {}
        method = make(name, exclude_boxes=[self.BOX], **threshold)
        assert reasons(method, make_frame(corners + outside, 0)) == [EXCLUDED] * 8 + [LOW] * 5

    @pytest.mark.parametrize("name", INTENSITY_METHODS)
    def test_comes_after_invalid_and_before_all_other_reasons(self, make, name):
        """The boxes contain points that are near, far, dark, without a return and NaN."""
        xyz = [[5, 0, 0], [80, 0, 0], [22, 0, 0], [0, 0, 0], [5, math.nan, 0], [5, 0, 0], [6, 6, 6]]
        intensity = [50, 50, 0, 50, 50, math.nan, 50]
        threshold = {"threshold": 10.0} if name == "global_intensity" else {}
        boxes = [(-10, 30, -5, 5, -5, 5), (70, 90, -5, 5, -5, 5)]
        method = make(name, exclude_boxes=boxes, far="drop", **threshold)
        expected = [EXCLUDED, EXCLUDED, EXCLUDED, INVALID, INVALID, INVALID, KEPT]
        assert reasons(method, make_frame(xyz, intensity)) == expected

    def test_excluded_points_are_in_no_range_ring_and_not_neighbors(self, make):
        frame = on_axis(np.concatenate([row_and_points(2), row_and_points(2)[-1:] + 1 / 8]))
        end = row_and_points(2)[-1]
        assert reasons(make("joint"), frame)[-2:] == [KEPT, KEPT]
        result = make("joint", exclude_boxes=[(end + 0.1, 30, -1, 1, -1, 1)]).step(frame)
        assert list(result.reason[-2:]) == [OUTLIER, EXCLUDED]
        assert list(result.rings.points) == [12, 0, 0, 0]


class TestIntensity:
    @pytest.mark.parametrize("name", RING_METHODS)
    def test_equal_to_the_threshold_is_kept(self, make, name):
        ranges, limits = [12, 30, 45, 60], [30, 16, 7, 4]
        assert reasons(make(name), on_axis(ranges, limits)) == [KEPT] * 4
        assert reasons(make(name), on_axis(ranges, [below(limit) for limit in limits])) == [LOW] * 4

    @pytest.mark.parametrize("name", RING_METHODS)
    @pytest.mark.parametrize(("intensity", "reason"), [(30, KEPT), (29, LOW)])
    def test_all_equal(self, make, name, intensity, reason):
        angles = np.arange(36) * math.pi / 18
        circle = np.column_stack([20 * np.cos(angles), 20 * np.sin(angles), np.zeros(36)])
        result = make(name).step(make_frame(circle, intensity))
        assert list(result.reason) == [reason] * 36
        assert list(result.rings.low_intensity) == [36 * (reason == LOW), 0, 0, 0]


class TestNeighbors:
    """Number of neighbours, n, from the number of points above the threshold in the range ring."""

    @pytest.mark.parametrize(
        ("size", "neighbors"), [(3, 1), (9, 1), (10, 1), (19, 1), (20, 2), (29, 2), (299, 29), (300, 30), (301, 30)]
    )
    @pytest.mark.parametrize("name", ["ring_intensity_outlier", "joint"])
    def test_number_of_neighbors(self, make, name, size, neighbors):
        bright, outliers = cloud_sensitive_to_neighbors(size, neighbors)
        frame = make_frame(np.concatenate([bright, bright + 0.01]), [31] * size + [29] * size)
        expected = [OUTLIER if index in outliers else KEPT for index in range(size)] + [LOW] * size
        assert reasons(make(name), frame) == expected

    def test_the_share_is_exact(self, make):
        """0.29 of 100 points is 29, but slightly less in floating point."""
        cloud, outliers = cloud_sensitive_to_neighbors(100, 29)
        found = np.flatnonzero(reasons(make("joint", neighbor_fraction=0.29), make_frame(cloud, 99)))
        assert found.tolist() == outliers

    @pytest.mark.parametrize("name", ["ring_intensity_outlier", "joint", "sor"])
    def test_one_point_is_kept(self, make, name):
        assert reasons(make(name), on_axis(20)) == [KEPT]

    @pytest.mark.parametrize("name", ["ring_intensity_outlier", "joint", "sor"])
    def test_two_points_are_kept(self, make, name):
        """Both points have the same mean distance."""
        assert reasons(make(name), make_frame([[20, 0.1, 0.2], [11.3, 3.3, 0.7]], 100)) == [KEPT, KEPT]

    def test_sor_with_too_few_others_uses_all(self, make):
        """Mean distances 8/3, 2, 2 and 4: mean 2.67, deviation 0.94."""
        frame = on_axis([20, 21, 22, 25], None)
        assert reasons(make("sor"), frame) == [KEPT, KEPT, KEPT, OUTLIER]
        assert reasons(make("sor", neighbors=3), frame) == reasons(make("sor", neighbors=1000), frame)

    @pytest.mark.parametrize("unit", [1, 0.1, 0.7, 1e-3])
    @pytest.mark.parametrize(("last", "reason"), [(6, KEPT), (6 * (1 + 1e-7), OUTLIER)])
    @pytest.mark.parametrize("name", ["joint", "sor"])
    def test_a_distance_equal_to_the_limit_is_kept(self, make, name, last, reason, unit):
        """Pairs with gaps of 1, 4, 5 and 6: mean 4, deviation 2, so 6 is equal to the limit."""
        gaps = np.repeat([1, 4, 5, last], 2)
        xyz = np.zeros((8, 3))
        xyz[:, 1] = np.tile([0, 1], 4) * gaps
        xyz[:, 0] = np.repeat(np.arange(4), 2) * 10
        params = {"neighbors": 1} if name == "sor" else {"ring_width_m": 60.0, "initial_thresholds": (0,)}
        frame = make_frame(xyz * unit + [25, 0, 0], 9)
        assert reasons(make(name, **params), frame) == [KEPT] * 6 + [reason] * 2

    @pytest.mark.parametrize("name", ["ring_intensity_outlier", "joint", "sor"])
    def test_an_evenly_spaced_row_is_kept(self, make, name):
        params = {"neighbors": 1} if name == "sor" else {}
        frame = on_axis(20 + 0.1 * np.arange(19), 100)
        assert reasons(make(name, **params), frame) == [KEPT] * 19

    @pytest.mark.parametrize("name", ["ring_intensity_outlier", "joint", "sor"])
    def test_an_evenly_spaced_circle_is_kept(self, make, name):
        angles = np.arange(720) * math.pi / 360
        circle = np.column_stack([20 * np.cos(angles), 20 * np.sin(angles), np.full(720, -1.7)])
        assert reasons(make(name), make_frame(circle, 100)) == [KEPT] * 720

    @pytest.mark.parametrize("ratio", [0.0, 1.0])
    def test_ends_of_a_row_are_farther_from_their_neighbors(self, make, ratio):
        """With two neighbours the ends have a mean distance of 1.5, all others 1."""
        assert reasons(make("sor", neighbors=2, std_ratio=ratio), on_axis(20 + np.arange(9))) == [
            OUTLIER,
            *[KEPT] * 7,
            OUTLIER,
        ]

    @pytest.mark.parametrize(("distance", "reason"), [(0.5, KEPT), (math.nextafter(0.5, 1), OUTLIER)])
    def test_ror_counts_points_at_the_radius(self, make, distance, reason):
        assert reasons(make("ror", min_neighbors=1), make_frame([[0, 1, 0], [0, 1, distance]])) == [reason] * 2

    def test_ror_measures_in_three_dimensions(self, make):
        method = make("ror", radius_m=0.875, min_neighbors=1)
        assert reasons(method, make_frame([[1, 1, 1], [1.25, 1.375, 1.75]])) == [KEPT, KEPT]
        assert reasons(method, make_frame([[1, 1, 1], [1.25, 1.375, 1.751]])) == [OUTLIER, OUTLIER]

    @pytest.mark.parametrize(("others", "reason"), [(4, OUTLIER), (5, KEPT)])
    def test_ror_counts_others_only(self, make, others, reason):
        assert reasons(make("ror"), on_axis([1.0] * (others + 1), None)) == [reason] * (others + 1)

    @pytest.mark.parametrize("offset", [2**20, 2**24])
    @pytest.mark.parametrize("name", ["sor", "ror"])
    def test_coordinates_of_a_map_lose_no_precision(self, make, name, offset):
        """Eastings and northings are large, but the distances between the points are small."""
        grid = np.random.default_rng(3).integers(-3000, 3000, (200, 3)) / 1024
        params = {"radius_m": 1.0} if name == "ror" else {}
        near, far = make_frame(grid), make_frame(grid + np.array([offset, 4 * offset, 0]))
        assert reasons(make(name, **params), near) == reasons(make(name, **params), far)
        assert set(reasons(make(name, **params), near)) == {KEPT, OUTLIER}

    @pytest.mark.parametrize("name", ["sor", "ror"])
    def test_the_largest_coordinates_of_single_precision(self, make, name):
        params = {"min_neighbors": 4} if name == "ror" else {}
        frame = on_axis([*row_and_points(), 3.4e38], None, coordinates="f4")
        assert reasons(make(name, **params), frame) == [KEPT] * 11 + [OUTLIER]

    @pytest.mark.parametrize("search", ["fast", "slow"])
    @pytest.mark.parametrize("name", NEIGHBOR_METHODS)
    @pytest.mark.parametrize("positions", [1, 2, 200])
    def test_many_equal_points_are_fast(self, monkeypatch, name, positions, search):
        """A search tree cannot split them; without deduplication the time grows with the square of their number."""
        if search == "slow":
            monkeypatch.setattr(neighbor_search, "_FastTree", None)
        xyz = np.random.default_rng(1).normal((20, 0, 0), 0.5, (positions, 3)).repeat(60_000 // positions, axis=0)
        frame = make_frame(xyz, 100)
        method = FILTERS[name](FILTERS[name].Params())
        start = time.perf_counter()
        assert Counter(reasons(method, frame)) == {KEPT: 60_000}
        assert time.perf_counter() - start < 5

    @pytest.mark.parametrize("name", ["ring_intensity_outlier", "joint", "sor"])
    def test_duplicates_are_neighbors_at_distance_zero(self, make, name):
        """Two single points next to ten equal points are outliers, two equal points are not."""
        params = {"neighbors": 1} if name == "sor" else {}
        assert reasons(make(name, **params), on_axis([20.0] * 10 + [21.0, 22.0])) == [KEPT] * 10 + [OUTLIER] * 2
        assert reasons(make(name, **params), on_axis([20.0] * 10 + [22.0, 22.0])) == [KEPT] * 12
