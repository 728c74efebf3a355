"""Faces: what stands up has them, water and spray do not."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaclutter_cli.water import Faces
from seaclutter_cli.water.faces import _COLUMN_DEG

LEVEL_M = -2.5
BEARINGS_DEG = np.arange(-10, 10, 0.2)


def along_beams(distance, bearing_deg, elevation_deg):
    """Return positions at horizontal distances, shape (3, N)."""
    bearing, slope = np.radians(bearing_deg), np.tan(np.radians(elevation_deg))
    return np.stack((distance * np.cos(bearing), distance * np.sin(bearing), distance * slope))


def scanned(distance_m, elevations_deg, bearings_deg=BEARINGS_DEG):
    """Return echoes at one distance in a grid of beams, shape (3, N)."""
    bearing, elevation = (axis.ravel() for axis in np.meshgrid(bearings_deg, elevations_deg))
    return along_beams(np.full(len(bearing), float(distance_m)), bearing, elevation)


def volume(rng, size, middle, extent):
    return np.array(middle)[:, None] + rng.uniform(-0.5, 0.5, (3, size)) * np.array(extent)[:, None]


def water_plane(slope, *, elevations_deg=None, bearings_deg=BEARINGS_DEG, noise_m=0.02, seed=1):
    """Return echoes of water that rises with the distance along x, shape (3, N)."""
    elevations_deg = -np.arange(4, 20, 0.5) if elevations_deg is None else elevations_deg
    bearing, elevation = (axis.ravel() for axis in np.meshgrid(bearings_deg, elevations_deg))
    rise = np.tan(np.radians(elevation)) - slope * np.cos(np.radians(bearing))
    # z = level + slope (x - 20), from which the distance of each beam follows
    distance = (LEVEL_M - 20 * slope) / rise
    distance = distance + np.random.default_rng(seed).normal(0, noise_m, len(distance))
    shown = (distance > 5) & (distance < 45)
    return along_beams(distance[shown], bearing[shown], elevation[shown])


class TestBodies:
    @pytest.mark.parametrize("distance_m", [8.0, 20.0, 40.0, 80.0])
    def test_a_wall_has_one_face_of_its_height_and_only_joined_neighbours(self, distance_m):
        wall = scanned(distance_m, np.arange(-4, 4.1, 0.5))
        faces = Faces.of(wall)
        assert faces.height_m == pytest.approx(np.ptp(wall[2]))
        assert faces.low_m == pytest.approx(wall[2].min())
        assert faces.joined.all()
        joined, loose = faces.neighbors(np.ones(wall.shape[1], np.bool_))
        assert joined.min() >= 3
        assert not loose.any()

    def test_the_part_above_the_water_counts(self):
        faces = Faces.of(scanned(20, np.arange(-8, 2.1, 0.5)))
        height = faces.above_m(np.full(len(faces.top_m), LEVEL_M))
        assert height == pytest.approx(20 * math.tan(math.radians(2)) - LEVEL_M)

    def test_what_is_below_the_water_has_no_height_above_it(self):
        faces = Faces.of(scanned(20, np.arange(-12, -8, 0.5)))
        assert (faces.above_m(np.full(len(faces.top_m), LEVEL_M)) <= 0).all()

    def test_beams_far_apart_belong_to_one_face_if_it_is_known_that_they_are(self):
        wall = scanned(20, np.arange(-4, 4.1, 2.0))
        assert not Faces.of(wall).height_m.any()
        elevation = np.degrees(np.arctan2(wall[2], np.hypot(*wall[:2])))
        assert Faces.of(wall, elevation, np.full_like(elevation, 2.0)).height_m == pytest.approx(np.ptp(wall[2]))

    def test_a_raked_hull_has_a_face_and_a_beach_has_none(self):
        for rake, has_face in ((0.2, True), (4.0, False)):  # run per rise
            elevation = np.arange(-6, 0.1, 0.5)
            tangent = np.tan(np.radians(elevation))
            distance = (20 - rake * LEVEL_M) / (1 - rake * tangent)
            hull = along_beams(distance, np.zeros(len(elevation)), elevation)
            assert bool(Faces.of(hull).height_m.max() > 1) is has_face

    def test_two_bodies_in_one_direction_are_two_faces(self):
        near, far = scanned(20, np.arange(-6, -3, 0.5)), scanned(24, np.arange(-2.9, 0, 0.5))
        faces = Faces.of(np.concatenate((near, far), axis=1))
        assert faces.height_m[: near.shape[1]] == pytest.approx(np.ptp(near[2]))
        assert faces.height_m[near.shape[1] :] == pytest.approx(np.ptp(far[2]))

    @pytest.mark.parametrize("bearing_deg", [0.0, 0.15, 44.9, 45.0, 90.0, -90.0, 179.9, 180.0, -179.95])
    def test_a_mast_between_two_columns_has_one_face(self, bearing_deg):
        """Its echoes scatter by 0.1° around any bearing, also that at which bearings begin again."""
        elevation = np.arange(-4, 4.1, 0.5)
        bearings_deg = bearing_deg + np.resize((-0.05, 0.05), len(elevation))
        mast = along_beams(np.full(len(elevation), 20.0), bearings_deg, elevation)
        assert Faces.of(mast).height_m == pytest.approx(np.ptp(mast[2]))


class TestWater:
    @pytest.mark.parametrize("slope_deg", [0.0, 5.0, 10.0, 15.0])
    def test_a_slope_of_water_has_no_face(self, slope_deg):
        height = Faces.of(water_plane(math.tan(math.radians(slope_deg)))).height_m
        assert (height > 0.35).mean() < 0.01

    def test_random_points_in_a_volume_have_mostly_loose_neighbours(self):
        spray = volume(np.random.default_rng(1), 600, (15, 0, -0.5), (2.5, 5, 3))
        faces = Faces.of(spray)
        assert faces.joined.mean() < 0.35
        _, loose = faces.neighbors(np.ones(600, np.bool_))
        assert loose.mean() > 1.5

    def test_only_the_neighbours_asked_for_count(self):
        wall = scanned(20, np.arange(-4, 4.1, 0.5))
        high = wall[2] > 0
        joined, loose = Faces.of(wall).neighbors(high)
        assert not joined[~high].any()
        assert joined[high].all()
        assert not loose.any()
        assert not np.any(Faces.of(wall).neighbors(np.zeros(len(high), np.bool_)))


class TestFewPoints:
    def test_no_point(self):
        faces = Faces.of(np.empty((3, 0)))
        assert [len(values) for values in (faces.low_m, faces.top_m, faces.joined)] == [0, 0, 0]
        assert faces.pairs.shape == (2, 0)
        assert [len(counts) for counts in faces.neighbors(np.empty(0, np.bool_))] == [0, 0]

    @pytest.mark.parametrize("point", [(20.0, 0.0, 1.0), (-20.0, -0.0, 0.0), (0.0, 0.0, 3.0)])
    def test_one_point(self, point):
        faces = Faces.of(np.array(point)[:, None])
        assert (faces.low_m, faces.top_m) == (point[2], point[2])
        assert faces.pairs.shape == (2, 0)


CELLS = st.tuples(st.integers(-500, 500), st.integers(-30, 30), st.integers(8, 240))
"""Column, beam and distance in quarters of a metre; no echo is at an edge of a column or beam."""


def positions(cells):
    column, beam, distance = np.array(cells, float).reshape(-1, 3).T
    return along_beams(distance / 4, (column + 0.2) * _COLUMN_DEG, 0.3 * beam + 0.01)


def pairs_of(pairs, joined):
    """Return the pairs in an order of their own."""
    return sorted((*sorted(pair), is_joined) for pair, is_joined in zip(pairs.T.tolist(), joined.tolist(), strict=True))


@settings(max_examples=100, deadline=None)
@given(cells=st.lists(CELLS, max_size=40), turn=st.integers(0, 1199))
def test_a_turn_by_columns_changes_no_face(cells, turn):
    xyz = positions(cells)
    angle = math.radians(turn * _COLUMN_DEG)
    x, y, z = xyz
    turned = np.stack((x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle), z))
    elevation = np.degrees(np.arctan2(z, np.hypot(x, y)))
    one, other = Faces.of(xyz, elevation), Faces.of(turned, elevation)
    assert np.array_equal(one.low_m, other.low_m)
    assert np.array_equal(one.top_m, other.top_m)


@settings(max_examples=100, deadline=None)
@given(cells=st.lists(CELLS, max_size=40, unique_by=lambda cell: cell[1]), seed=st.integers(0, 9))
def test_the_order_of_the_points_does_not_matter(cells, seed):
    """Elevations differ."""
    xyz = positions(cells)
    order = np.random.default_rng(seed).permutation(xyz.shape[1])
    one, other = Faces.of(xyz), Faces.of(xyz[:, order])
    np.testing.assert_array_equal(other.low_m, one.low_m[order])
    np.testing.assert_array_equal(other.top_m, one.top_m[order])
    assert pairs_of(order[other.pairs], other.joined) == pairs_of(one.pairs, one.joined)


@settings(max_examples=100, deadline=None)
@given(cells=st.lists(CELLS, min_size=1, max_size=30))
def test_faces_contain_their_points(cells):
    xyz = positions(cells)
    faces = Faces.of(xyz)
    assert np.isfinite(faces.height_m).all()
    assert (faces.low_m <= xyz[2]).all()
    assert (faces.top_m >= xyz[2]).all()
    assert np.isin(faces.low_m, xyz[2]).all()
    assert (faces.pairs[0] != faces.pairs[1]).all()
    counts = sum(faces.neighbors(np.ones(xyz.shape[1], np.bool_)))
    assert counts.sum() == 2 * len(faces.joined)


@settings(max_examples=100, deadline=None)
@given(cells=st.lists(CELLS, max_size=30, unique_by=lambda cell: cell[1]))
def test_duplicates_have_the_faces_of_the_points(cells):
    """Elevations differ, but for those of the copies."""
    xyz = positions(cells)
    one, twice = Faces.of(xyz), Faces.of(np.repeat(xyz, 2, axis=1))
    assert np.array_equal(twice.low_m, np.repeat(one.low_m, 2))
    assert np.array_equal(twice.top_m, np.repeat(one.top_m, 2))
