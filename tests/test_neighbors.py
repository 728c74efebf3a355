"""Searches for neighbours against all distances."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaclutter_cli.neighbors import nearest, nth_neighbor_distance


def distances(points, query):
    return np.sqrt(((points[:, None, :] - query[:, :, None]) ** 2).sum(axis=0))


@given(seed=st.integers(0, 2**32), size=st.integers(2, 60))
def test_counts_agree_with_distances_to_the_nth_neighbor(seed, size):
    rng = np.random.default_rng(seed)
    points = np.round(rng.uniform(-9, 9, (3, size)))
    counts = (distances(points, points) <= 2).sum(axis=1)
    for rank in {1, 3, 7} & set(range(size)):
        far = nth_neighbor_distance(np.ascontiguousarray(points.T), rank)
        np.testing.assert_array_equal(far <= 2, counts > rank)


@pytest.mark.parametrize("axes", [2, 3])
def test_nearest_of_other_points(axes):
    rng = np.random.default_rng(3)
    points, query = rng.uniform(-20, 20, (300, axes)), rng.uniform(-20, 20, (40, axes))
    index, distance = nearest(points, query)
    every = distances(points.T, query.T)
    np.testing.assert_array_equal(index, every.argmin(axis=1))
    np.testing.assert_allclose(distance, every.min(axis=1))
