"""Searches for neighbours against all distances."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaclutter_cli.neighbors import nearest, nth_neighbor_distances, within


def distances(points, query):
    return np.sqrt(((points[:, None, :] - query[:, :, None]) ** 2).sum(axis=0))


@given(seed=st.integers(0, 2**32), size=st.integers(1, 80), asked=st.integers(1, 40), steps=st.booleans())
def test_counts_within_a_radius(seed, size, asked, steps):
    rng = np.random.default_rng(seed)
    points, query = rng.uniform(-20, 20, (3, size)), rng.uniform(-20, 20, (3, asked))
    radius = rng.uniform(0, 15, asked)
    if steps:  # equal points, and distances equal to the radius
        points, query, radius = np.round(points), np.round(query), np.round(radius)
    counts = within(points, query, radius)
    if counts is None:
        reach = np.abs(points[0][None, :] - query[0][:, None]) <= radius[:, None] * (1 + 2e-9)
        assert reach.sum() > 8 * (size + asked)
    else:
        assert counts.tolist() == (distances(points, query) <= radius[:, None]).sum(axis=1).tolist()


def test_dense_points_are_left_to_a_tree():
    points = np.zeros((3, 17))
    assert within(points, points, np.ones(17)) is None


def test_few_dense_points_are_counted():
    points = np.zeros((3, 16))
    assert within(points, points, np.zeros(16)).tolist() == [16] * 16


@given(seed=st.integers(0, 2**32), size=st.integers(2, 60))
def test_counts_agree_with_distances_to_the_nth_neighbor(seed, size):
    rng = np.random.default_rng(seed)
    points = np.round(rng.uniform(-9, 9, (3, size)))
    radius, ranks = np.full(size, 2.0), (1, 3, 7)
    counts = within(points, points, radius)
    if counts is not None:
        far = nth_neighbor_distances(np.ascontiguousarray(points.T), ranks)
        np.testing.assert_array_equal(far <= 2, counts[:, None] > np.array(ranks))


@pytest.mark.parametrize("axes", [2, 3])
def test_nearest_of_other_points(axes):
    rng = np.random.default_rng(3)
    points, query = rng.uniform(-20, 20, (300, axes)), rng.uniform(-20, 20, (40, axes))
    index, distance = nearest(points, query)
    every = distances(points.T, query.T)
    np.testing.assert_array_equal(index, every.argmin(axis=1))
    np.testing.assert_allclose(distance, every.min(axis=1))
