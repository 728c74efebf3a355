"""Euclidean clusters: equal to brute-force single linkage on any points, in bounded memory."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from seaclutter_cli import clustering
from seaclutter_cli.clustering import ClusterFinder, euclidean_clusters, pairs_within

TOLERANCES = st.sampled_from([1.5, 1.0, 0.1, 0.7, 1e-6, 1e6])


def single_linkage(xyz, tolerance_m, min_points):
    x, y, z = xyz[:, :, None] - xyz[:, None, :]
    with np.errstate(over="ignore"):
        near = np.sqrt(x * x + y * y + z * z) < tolerance_m
    labels = np.full(xyz.shape[1], -1)
    seen = np.zeros(xyz.shape[1], bool)
    for first in range(xyz.shape[1]):
        if not seen[first]:
            component = fresh = np.arange(xyz.shape[1]) == first
            while fresh.any():
                fresh = near[fresh].any(axis=0) & ~component
                component = component | fresh
            seen |= component
            if component.sum() >= min_points:
                labels[component] = labels.max() + 1
    return labels


def check(xyz, tolerance_m, min_points):
    xyz = np.asarray(xyz, float)
    np.testing.assert_array_equal(
        euclidean_clusters(xyz, tolerance_m, min_points), single_linkage(xyz, tolerance_m, min_points)
    )


@pytest.fixture(params=["as it is", "shortened gaps", "every pair of cells by itself"])
def implementations(request, monkeypatch):
    if request.param == "shortened gaps":
        monkeypatch.setattr(clustering, "_FEW_CELLS", 0)
    elif request.param == "every pair of cells by itself":
        monkeypatch.setattr(clustering, "_ALL_PAIRED", 0)
        monkeypatch.setattr(clustering, "_BLOCK", 1)


SEARCH = settings(max_examples=60, deadline=None)


@pytest.mark.parametrize("extent", [1, 4, 12, 300])
@given(seed=st.integers(0, 2**32), size=st.integers(0, 150), tolerance_m=TOLERANCES, min_points=st.integers(1, 7))
@settings(SEARCH)
def test_random_points(extent, seed, size, tolerance_m, min_points):
    check(np.random.default_rng(seed).uniform(0, extent, (3, size)) * tolerance_m, tolerance_m, min_points)


@given(arrays(np.int64, st.tuples(st.just(3), st.integers(0, 60)), elements=st.integers(-4, 4)), TOLERANCES)
@SEARCH
def test_lattices_with_the_tolerance_as_spacing_and_many_equal_points(steps, tolerance_m):
    for spacing in (1, 0.5, np.nextafter(1, 0), 1 / np.sqrt(2), 1 / np.sqrt(3)):
        check(steps * (tolerance_m * spacing), tolerance_m, 2)


@given(arrays(np.float64, st.tuples(st.just(3), st.integers(0, 40)), elements=st.floats(-1e150, 1e150)), TOLERANCES)
@SEARCH
def test_any_coordinates(xyz, tolerance_m):
    check(xyz, tolerance_m, 1)


@pytest.mark.parametrize("origin", [0, 5e5, 1e9, 1e12, 1e15, 1e16, 1e20])
def test_far_from_the_origin(origin, implementations):
    rng = np.random.default_rng(1)
    check(rng.normal(0, 3, (3, 300)) + origin, 1.5, 3)
    check(np.concatenate((rng.normal(0, 3, (3, 100)), rng.normal(0, 3, (3, 100)) + origin), axis=1), 1.5, 3)


def test_all_implementations_of_the_cell_search(implementations):
    rng = np.random.default_rng(2)
    for extent in (1, 5, 20, 200):
        check(rng.uniform(-extent, extent, (3, 400)), 1.5, 3)
    check(np.repeat(rng.uniform(-9, 9, (3, 100)), 4, axis=1), 1.5, 5)


@pytest.mark.parametrize("distance", [1.5, np.nextafter(1.5, 0), np.nextafter(1.5, 2), 1.4999])
def test_dense_lumps_that_almost_touch(distance, implementations):
    rng = np.random.default_rng(3)
    lump = rng.uniform(0, 0.5, (3, 60))
    lump[0, 0], lump[1:, 0] = 0.5, 0.2
    other = rng.uniform(0, 0.5, (3, 60))
    other[:, 0] = [0, 0.2, 0.2]
    both = np.concatenate((lump, other + np.array([[0.5 + distance], [0], [0]])), axis=1)
    check(both, 1.5, 5)


@pytest.mark.parametrize("size", [0, 1, 30, 400])
def test_pairs_within_a_reach(size):
    xyz = np.random.default_rng(size).uniform(0, 5, (3, size)).round(1)
    near = np.linalg.norm(xyz[:, :, None] - xyz[:, None], axis=0) < 1.05
    found = np.sort(pairs_within(xyz, 1.05), axis=0).T.tolist()
    assert sorted(found) == np.argwhere(np.triu(near, 1)).tolist()


def test_clusters_are_numbered_by_their_first_points_and_small_ones_are_left_out():
    x = np.array([9, 50, 0, 0.5, 9.5, 1.0, 10, 70, 70.5])
    labels = euclidean_clusters(np.stack((x, 0 * x, 0 * x)), 1.5, 3)
    assert labels.tolist() == [0, -1, 1, 1, 0, 1, 0, -1, -1]


@pytest.mark.parametrize(("size", "min_points"), [(0, 1), (0, 5), (4, 5), (1, 1)])
def test_few_points(size, min_points):
    labels = euclidean_clusters(np.ones((3, size)), 1.5, min_points)
    assert labels.tolist() == ([0] * size if size >= min_points else [-1] * size)


def test_subsets_have_the_same_clusters_as_alone():
    rng = np.random.default_rng(4)
    xyz = rng.uniform(-15, 15, (3, 800)) * np.array([[1], [1], [0.2]])
    among = rng.random(800) < 0.9
    finder = ClusterFinder(np.where(among, xyz, np.nan), among, 1.5)
    for share in (0, 0.1, 0.5, 0.9, 1):
        keep = among & (rng.random(800) < share)
        labels = finder.clusters(keep, 3)
        assert (labels[~keep] == -1).all()
        np.testing.assert_array_equal(labels[keep], single_linkage(xyz[:, keep], 1.5, 3))


RNG = np.random.default_rng(5)
DIRECTIONS = RNG.normal(0, 1, (3, 60_000))
SHELLS = 0.4 * DIRECTIONS / np.linalg.norm(DIRECTIONS, axis=0)
SHELLS[:, 30_000:] += 2.35 / np.sqrt(3)
EDGE = np.arange(39) * 0.87


@pytest.mark.parametrize(
    ("xyz", "clusters"),
    [
        (np.ones((3, 60_000)), 1),
        (RNG.uniform(-0.5, 0.5, (3, 60_000)), 1),
        (RNG.uniform(-1e6, 1e6, (3, 60_000)), 0),
        (SHELLS, 2),
        (np.stack(np.meshgrid(EDGE, EDGE, EDGE)).reshape(3, -1), 1),
    ],
    ids=["equal", "ball", "far apart", "facing shells", "lattice"],
)
def test_memory_is_bounded_for_any_points(xyz, clusters):
    tracemalloc.start()
    labels = euclidean_clusters(xyz, 1.5, 5)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert labels.max() + 1 == clusters
    assert peak < 150e6


def balls(count, distance, seed=0):
    """Return the points of two balls of 1 mm whose centres are at a distance along the diagonal."""
    rng = np.random.default_rng(seed)
    xyz = rng.normal(size=(3, 2 * count))
    xyz *= 0.0005 * rng.random(2 * count) ** (1 / 3) / np.linalg.norm(xyz, axis=0)
    xyz[:, count:] += distance / np.sqrt(3)
    return xyz


@given(distance=st.floats(1.499, 1.502), seed=st.integers(0, 1000))
def test_dense_components_that_almost_touch_with_a_tree(distance, seed):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(clustering, "_BLOCK", 1)
        check(balls(20, distance, seed), 1.5, 1)


@given(xyz=arrays(float, (3, 30), elements=st.integers(0, 4).map(float)))
def test_distances_equal_to_the_tolerance_with_a_tree(xyz):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(clustering, "_BLOCK", 1)
        check(xyz, 2.0, 1)


def test_dense_components_that_almost_touch_take_no_quadratic_work(monkeypatch):
    compared = []
    near = ClusterFinder._near

    def counted(self, difference):
        compared.append(difference[0].size)
        return near(self, difference)

    monkeypatch.setattr(ClusterFinder, "_near", counted)
    count = 20_000
    assert euclidean_clusters(balls(count, 1.5011), 1.5, 1).max() == 1
    assert sum(compared) < 10 * count
