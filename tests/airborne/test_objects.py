import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaclutter_cli.airborne.features import NonSeaPoints
from seaclutter_cli.airborne.objects import (
    ObjectFindingParams,
    find_objects,
    likely_object,
    object_around,
    smallest_rectangle,
)


def rectangle(rng, center, size, yaw, count=300):
    inside = (rng.random((count, 2)) - 0.5) * size
    inside[:4] = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * np.array(size) / 2
    c, s = np.cos(yaw), np.sin(yaw)
    return inside @ np.array([[c, s], [-s, c]]) + center


@given(seed=st.integers(0, 2**32), yaw=st.floats(-1.5, 1.5), length=st.floats(5, 50), width=st.floats(1, 4))
@settings(deadline=None, max_examples=40)
def test_the_smallest_rectangle_around_a_rectangle_is_itself(seed, yaw, length, width):
    points = rectangle(np.random.default_rng(seed), (5e5, 4e6), (length, width), yaw)
    center, size, found, area = smallest_rectangle(points)
    np.testing.assert_allclose(center, (5e5, 4e6), atol=1e-5)
    np.testing.assert_allclose(size, (length, width), atol=1e-5)
    assert found == pytest.approx(yaw, abs=1e-4)
    assert area == pytest.approx(length * width, rel=1e-5)


@pytest.mark.parametrize("points", [[(1, 2)], [(1, 2), (4, 6)], [(0, 0), (3, 4), (6, 8)]])
def test_points_on_a_line(points):
    center, size, yaw, area = smallest_rectangle(np.array(points, float))
    assert size == pytest.approx((5.0 * (len(points) - 1), 0))
    assert area == 0
    np.testing.assert_allclose(center, np.mean(points, axis=0))
    if len(points) > 1:
        assert np.tan(yaw) == pytest.approx(4 / 3)


@pytest.mark.parametrize("points", [[(1, 2)], [(1, 2), (4, 6)], [(0, 0), (3, 4), (6, 8)]])
def test_the_outline_of_points_on_a_line_has_an_area(points):
    one = object_around(1, np.array(points, float).T, np.zeros(len(points)), None, 1.0)
    area = shoelace(one.corners())
    assert area == pytest.approx(0.1 * max(one.size[0], 0.1), abs=0.02)
    assert one.size[1] == pytest.approx(0)


def two_objects():
    rng = np.random.default_rng(0)
    ship, mat = rectangle(rng, (100, 50), (40, 8), 0.4), rectangle(rng, (200, 80), (10, 9), 0.0, 60)
    isolated = np.array([[300.0, 300], [301, 300]])
    xy = np.concatenate([ship, mat, isolated])
    probability = np.tile([0.7, 0.3], (len(xy), 1))
    probability[300:360] = [0.2, 0.8]
    probability[310:320] = [1.0, 0.0]
    height = np.concatenate([np.linspace(1, 9, 300), np.full(62, 1.5)])
    points = NonSeaPoints(xy.T, height, np.ones(len(xy)), 1.0)
    objects, number, left_out = find_objects(points, probability, (1, 5), ObjectFindingParams())
    assert not left_out.any(), "isolated points are not a cluster"
    return objects, number


def test_objects_have_the_class_of_most_of_their_points():
    objects, number = two_objects()
    assert [(one.number, one.name, one.points) for one in objects] == [(1, "ship", 300), (2, "seaweed", 60)]
    assert np.bincount(number).tolist() == [2, 300, 60]
    assert objects[0].probability == pytest.approx(0.7)
    assert objects[0].size == pytest.approx((40, 8), abs=1e-6)
    assert objects[0].height_m == pytest.approx(9, abs=0.1)


def test_unlikely_clusters_are_left_out():
    rng = np.random.default_rng(0)
    xy = np.concatenate([rectangle(rng, (100, 50), (9, 8), 0.0), rectangle(rng, (200, 80), (9, 8), 0.0)])
    points = NonSeaPoints(xy.T, np.full(600, 2.0), np.ones(600), 1.0)
    probability = np.repeat([[0.3, 0.3, 0.2, 0.2], [0.1, 0.7, 0.1, 0.1]], 300, axis=0)
    objects, number, left_out = find_objects(points, probability, (1, 2, 3, 4), ObjectFindingParams())
    assert [(one.number, one.code) for one in objects] == [(1, 2)]
    assert np.bincount(number).tolist() == [300, 300]
    np.testing.assert_array_equal(left_out, number == 0)


@pytest.mark.parametrize(("top_m", "low", "high"), [(0.6, 0.0, 0.1), (0.95, 0.5, 0.9), (3.0, 0.99, 1.0)])
def test_what_hardly_rises_above_crests_is_hardly_an_object(top_m, low, high):
    assert low <= likely_object(np.linspace(0.5, top_m, 50), 0.5) <= high


def test_no_points_no_objects():
    empty = NonSeaPoints(np.empty((2, 0)), np.empty(0), np.empty(0), 1.0)
    objects, number, left_out = find_objects(empty, np.empty((0, 2)), (1, 5), ObjectFindingParams())
    assert (objects, len(number), len(left_out)) == ([], 0, 0)


def shoelace(corners):
    """Return the area within corners, positive if they are counter-clockwise, as GeoJSON requires."""
    x, y = np.asarray(corners).T
    return 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1))


def test_outlines_of_objects():
    objects, _ = two_objects()
    assert shoelace(objects[0].corners()) == pytest.approx(320, rel=1e-3)
    assert objects[1].attributes["class"] == "seaweed"
