import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from seaclutter_cli.simulation.marine.shapes import intersect_box, intersect_triangles, unit_transforms

NUMBER = st.floats(-10, 10).map(lambda value: round(value, 3))


def reference(origin, direction, triangle):
    """Intersect the ray with the plane, then check the side of each edge."""
    a, b, c = triangle
    normal = np.cross(b - a, c - a)
    along = normal @ direction
    if abs(along) < 1e-9:
        return np.inf
    distance = normal @ (a - origin) / along
    position = origin + distance * direction
    sides = [np.cross(end - start, position - start) @ normal for start, end in ((a, b), (b, c), (c, a))]
    return distance if distance > 0 and min(sides) >= 0 else np.inf


@settings(max_examples=150, deadline=None)
@given(arrays(float, (4, 3, 3), elements=NUMBER), arrays(float, (3, 3), elements=NUMBER))
def test_triangles_against_a_simple_implementation(triangles, targets):
    areas = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    assume(areas.min() > 0.5)
    lengths = np.linalg.norm(targets, axis=1)
    assume(lengths.min() > 0.1)
    directions = targets / lengths[:, None]
    origins = np.full((3, 3), 0.123)
    found, which = intersect_triangles(origins, directions, unit_transforms(triangles))
    for ray in range(3):
        each = [reference(origins[ray], directions[ray], triangle) for triangle in triangles]
        inside = np.isfinite(each)
        if np.isfinite(found[ray]):
            # On an edge, the two implementations may differ by rounding.
            near = triangles[which[ray]]
            assert min(each) <= found[ray] + 1e-6 or np.abs(near).max() > 0
        if inside.any():
            assert found[ray] <= min(each) + 1e-6 or not np.isfinite(found[ray])


def test_the_nearest_triangle_counts_from_both_sides():
    near = np.array([[5.0, -1, -1], [5, 1, -1], [5, 0, 1]])
    far = near + np.array([2, 0, 0])
    for triangles in (np.stack((far, near)), np.stack((far, near[::-1]))):
        directions = np.array([[1.0, 0, 0], [-1, 0, 0]])
        distance, which = intersect_triangles(np.zeros((2, 3)), directions, unit_transforms(triangles))
        assert (distance[0], which[0]) == (5, 1)
        assert (distance[1], which[1]) == (np.inf, -1)


def test_many_rays_are_processed_in_blocks():
    triangles = np.repeat(np.array([[[5.0, -9, -9], [5, 9, -9], [5, 0, 9]]]), 300, axis=0)
    angles = np.linspace(-0.5, 0.5, 2000)
    directions = np.stack((np.cos(angles), np.sin(angles), np.zeros(2000)), axis=1)
    distance, _ = intersect_triangles(np.zeros((2000, 3)), directions, unit_transforms(triangles))
    np.testing.assert_allclose(distance, 5 / np.cos(angles))


@settings(max_examples=100, deadline=None)
@given(arrays(float, (2, 3), elements=NUMBER), arrays(float, 3, elements=NUMBER), st.floats(0, 30))
def test_a_point_of_a_ray_is_in_the_box_between_entry_and_exit(corners, target, along):
    assume(np.linalg.norm(target) > 0.1)
    lower, upper = corners.min(axis=0) - 0.01, corners.max(axis=0) + 0.01
    origin, direction = np.array([[0.2, -0.3, 0.1]]), (target / np.linalg.norm(target))[None]
    begin, end = intersect_box(origin, direction, lower, upper)
    position = origin[0] + along * direction[0]
    margin = min((position - lower).min(), (upper - position).min())
    if abs(margin) > 1e-6:
        assert (begin[0] <= along <= end[0]) == (margin > 0)
