"""Density-based clusters compared with plain loops and, where installed, with scikit-learn."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from seaclutter_cli.clustering import DbscanFinder

RNG = np.random.default_rng(5)
SEARCH = settings(max_examples=80, deadline=None)
EPS = st.sampled_from([1.5, 1.0, 0.1, 1e-6, 1e6])


def dbscan(xyz, eps_m, min_points):
    everything = np.ones(xyz.shape[1], np.bool_)
    return DbscanFinder(xyz, everything, eps_m, min_points).clusters(everything, 1)


def distances(xyz):
    x, y, z = xyz[:, :, None] - xyz[:, None, :]
    with np.errstate(over="ignore"):
        return np.sqrt(x * x + y * y + z * z)


def check(labels, xyz, eps_m, min_points):
    """Assert that clusters agree with the definition, point by point."""
    separation = distances(xyz)
    near = separation <= eps_m
    core = near.sum(axis=1) >= min_points
    component = np.full(len(core), -1)
    for first in np.flatnonzero(core):
        if component[first] < 0:
            waiting = [first]
            while waiting:
                point = waiting.pop()
                if component[point] < 0:
                    component[point] = first
                    waiting += np.flatnonzero(near[point] & core & (component < 0)).tolist()
    same = component[core][:, None] == component[core]
    assert ((labels[core][:, None] == labels[core]) == same).all()
    assert (labels[core] >= 0).all()
    for point in np.flatnonzero(~core):
        cores = np.flatnonzero(near[point] & core)
        nearest = cores[separation[point, cores] == separation[point, cores].min()] if len(cores) else []
        assert labels[point] in (set(labels[nearest].tolist()) or {-1})
    clustered = labels[labels >= 0]
    firsts = [int(np.flatnonzero(labels == number)[0]) for number in range(clustered.max(initial=-1) + 1)]
    assert firsts == sorted(firsts)


@pytest.mark.parametrize("extent", [1, 4, 12, 300])
@given(seed=st.integers(0, 2**32), size=st.integers(0, 120), eps_m=EPS, min_points=st.integers(1, 7))
@SEARCH
def test_random_points(extent, seed, size, eps_m, min_points):
    xyz = np.random.default_rng(seed).uniform(0, extent, (3, size)) * eps_m
    check(dbscan(xyz, eps_m, min_points), xyz, eps_m, min_points)


@given(
    arrays(np.int64, st.tuples(st.just(3), st.integers(0, 40)), elements=st.integers(-3, 3)),
    st.sampled_from([1.5, 1.0, 0.25]),
    st.integers(1, 9),
)
@SEARCH
def test_lattices_whose_spacing_is_the_distance(steps, eps_m, min_points):
    """Points exactly at the distance are near, and many points are equal."""
    for spacing in (1, 0.5, np.nextafter(1, 2)):
        xyz = steps * (eps_m * spacing)
        check(dbscan(xyz, eps_m, min_points), xyz, eps_m, min_points)


def test_far_from_the_origin():
    for origin in (0, 5e5, 1e9, 1e15):
        xyz = RNG.normal(0, 2, (3, 200)) + origin
        check(dbscan(xyz, 1.5, 6), xyz, 1.5, 6)


@pytest.mark.parametrize("extent", [3, 8, 20])
@pytest.mark.parametrize("min_points", [1, 3, 8])
def test_clusters_of_scikit_learn(extent, min_points):
    """Only border points near several clusters may differ."""
    cluster = pytest.importorskip("sklearn.cluster")
    xyz = RNG.uniform(0, extent, (3, 2000)) * np.array([[1], [1], [0.3]])
    theirs = cluster.DBSCAN(eps=0.5, min_samples=min_points).fit(xyz.T)
    ours = dbscan(xyz, 0.5, min_points)
    core = theirs.core_sample_indices_
    pairs = set(zip(ours[core].tolist(), theirs.labels_[core].tolist(), strict=True))
    assert len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs})
    np.testing.assert_array_equal(ours >= 0, theirs.labels_ >= 0)
    renamed = dict(pairs)
    border = np.setdiff1d(np.flatnonzero(ours >= 0), core)
    for point in border[[renamed[label] for label in ours[border]] != theirs.labels_[border]]:
        separation = np.sqrt(((xyz[:, core] - xyz[:, [point]]) ** 2).sum(axis=0))
        assert len(set(ours[core[separation <= 0.5]])) > 1


def test_a_border_point_belongs_to_the_nearest_core_point():
    """The point between two rows is near the core points at both ends and not a core point itself."""
    line = np.array([0.0, 0.1, 0.2, 0.5])
    for between, expected in ((0.8, 0), (0.9, 1)):
        xyz = np.zeros((3, 9))
        xyz[0] = [*line, *(1.7 - line), between]
        assert dbscan(xyz, 0.45, 4).tolist() == [0] * 4 + [1] * 4 + [expected]


def test_subsets_and_small_clusters():
    xyz = RNG.uniform(-6, 6, (3, 700)) * np.array([[1], [1], [0.2]])
    among = RNG.random(700) < 0.9
    finder = DbscanFinder(np.where(among, xyz, np.nan), among, 0.6, 4)
    for share in (0, 0.2, 0.6, 1):
        keep = among & (RNG.random(700) < share)
        labels = finder.clusters(keep, 1)
        assert (labels[~keep] == -1).all()
        check(labels[keep], xyz[:, keep], 0.6, 4)
        large = finder.clusters(keep, 12)
        sizes = np.bincount(labels[labels >= 0], minlength=1)
        np.testing.assert_array_equal(large >= 0, (labels >= 0) & (sizes[labels] >= 12))


@pytest.mark.parametrize(("size", "min_points"), [(0, 1), (0, 5), (4, 5), (1, 1), (5, 5)])
def test_few_points(size, min_points):
    assert dbscan(np.ones((3, size)), 1.5, min_points).tolist() == [0 if size >= min_points else -1] * size


LUMP = np.concatenate((np.ones((3, 30_000)), RNG.uniform(0, 60, (3, 30_000))), axis=1)


@pytest.mark.parametrize(
    "xyz",
    [np.ones((3, 60_000)), RNG.uniform(-0.5, 0.5, (3, 60_000)), RNG.uniform(-1e6, 1e6, (3, 60_000)), LUMP],
    ids=["equal", "ball", "far apart", "equal and around"],
)
def test_memory_is_bounded_for_any_points(xyz):
    tracemalloc.start()
    dbscan(xyz, 1.5, 5)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 150e6
