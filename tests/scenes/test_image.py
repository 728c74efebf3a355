"""Top views: the same as with a loop over points, and defined for any frame."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaclutter_cli.scenes.model import IMAGE_SIZE, top_view

ANY = st.one_of(
    st.floats(-80, 80),
    st.sampled_from([0.0, -0.0, 60.0, -60.0, math.nan, math.inf, -math.inf, 1e300, 1e-300, 59.999]),
)
POINTS = st.lists(st.tuples(ANY, ANY, ANY), max_size=40)


def array(points):
    return np.array(points, float).reshape(-1, 3).T


def cells_by_hand(point, extent_m, slack):
    """Return the cells that may contain a point, given some slack at the edges."""
    x, y, _ = point
    cell_m = 2 * extent_m / IMAGE_SIZE
    rows = {math.floor((extent_m - x) / cell_m + shift) for shift in (-slack, 0, slack)}
    columns = {math.floor((extent_m - y) / cell_m + shift) for shift in (-slack, 0, slack)}
    inside = range(IMAGE_SIZE)
    return {(row, column) for row in rows for column in columns if row in inside and column in inside}


@given(POINTS)
def test_the_same_as_with_a_loop_over_points(points):
    returns = [point for point in points if all(map(math.isfinite, point)) and any(point)]
    full = set(map(tuple, np.argwhere(top_view(array(points), 60.0)).tolist()))
    certain = [cells_by_hand(point, 60.0, 1e-3) for point in returns]
    certain = {next(iter(cells)) for cells in certain if len(cells) == 1}
    possible = set().union(*(cells_by_hand(point, 60.0, 1e-3) for point in returns))
    # A point near the edge of the square may be in or out, so a single cell is not certain there.
    rim = {(row, column) for row, column in certain if {row, column} & {0, IMAGE_SIZE - 1}}
    assert certain - rim <= full <= possible


@given(POINTS, POINTS)
def test_a_view_of_two_clouds_is_the_union_of_both_views(some, others):
    together = top_view(array([*some, *others]), 60.0)
    np.testing.assert_array_equal(together, top_view(array(some), 60.0) | top_view(array(others), 60.0))
    np.testing.assert_array_equal(together, top_view(array([*others, *some, *some]), 60.0))


def test_forward_is_up_and_left_is_left():
    assert np.argwhere(top_view(array([(50, 20, 3)]), 60.0)).tolist() == [[18, 74]]
    assert np.argwhere(top_view(array([(-50, -20, 3)]), 60.0)).tolist() == [[205, 149]]


@pytest.mark.parametrize(
    "points",
    [
        [],
        [(math.nan, 1, 1)],
        [(1, math.nan, 1)],
        [(1, 1, math.nan)],
        [(1, 1, math.inf)],
        [(0, 0, 0)],
        [(-0.0, 0, -0.0)] * 3,
        [(61, 0, 0)],
        [(0, -61, 0)],
        [(1e300, 1e300, 0)],
        [(-60, 0, 0)],
        [(0, -60, 0)],
    ],
)
def test_an_empty_image(points):
    image = top_view(array(points), 60.0)
    assert image.shape == (224, 224)
    assert image.dtype == np.uint8
    assert not image.any()


@pytest.mark.parametrize(
    ("points", "cell"),
    [
        ([(0, 0, 3)], (112, 112)),  # directly above the lidar
        ([(0, 0, 0), (-0.1, -0.2, 0)], (112, 112)),
        ([(0, 0, 0), (1e-9, 0, 0)], (112, 112)),
        ([(60, 60, 0)], (0, 0)),
        ([(-59.99, -59.99, -2)] * 5, (223, 223)),
    ],
)
def test_a_single_cell(points, cell):
    assert list(map(tuple, np.argwhere(top_view(array(points), 60.0)))) == [cell]


def test_the_input_is_not_changed():
    points = array([(1, 2, 3), (math.nan, 0, 0), (0, 0, 0)])
    before = points.copy()
    top_view(points, 60.0)
    np.testing.assert_array_equal(points, before)


def test_finer_cells_subdivide_those_of_a_view():
    xyz = np.random.default_rng(1).uniform(-70, 70, (3, 40000))
    finer = top_view(xyz, 60.0, 4 * IMAGE_SIZE).reshape(IMAGE_SIZE, 4, IMAGE_SIZE, 4)
    np.testing.assert_array_equal(finer.any(axis=(1, 3)), top_view(xyz, 60.0))


def test_all_points_of_a_large_frame_count():
    rng = np.random.default_rng(1)
    xyz = rng.uniform(-70, 70, (3, 40000)) * (rng.random(40000) < 0.01)  # most are at the origin
    np.testing.assert_array_equal(top_view(xyz, 60.0), top_view(xyz[:, xyz.any(axis=0)], 60.0))
    assert not top_view(np.zeros((3, 40000)), 60.0).any()
