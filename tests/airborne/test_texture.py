"""Texture against a matrix computed by hand and against plain loops over Eq. 5 to 9."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaclutter_cli.airborne import features as module
from seaclutter_cli.airborne.features import FEATURES, FeatureParams, NonSeaPoints, features_of


def non_sea(xy, height, intensity=None, density=1.0):
    intensity = np.ones(len(height)) if intensity is None else np.asarray(intensity, float)
    return NonSeaPoints(np.asarray(xy, float).T, np.asarray(height, float), intensity, density)


def plain_texture(points, params):
    """Return the features of each point, with the matrix of each direction filled pair by pair."""
    positions, level = points.xy.T.tolist(), []
    for height in points.height_m:
        grey = math.floor(height * params.levels / params.max_height_m)
        level.append(min(max(grey, 0), params.levels - 1))
    out = []
    for here in positions:
        near = [k for k, there in enumerate(positions) if math.dist(here, there) <= params.radius_m]
        sums = np.zeros(3)
        for degrees in (0, 45, 90, 135):
            x, y = (params.shift_m * f(math.radians(degrees)) for f in (math.cos, math.sin))
            matrix = np.zeros((params.levels, params.levels))
            for k in near:
                shifted = [math.dist(positions[k], (there[0] + x, there[1] + y)) for there in positions]
                matrix[level[k], level[shifted.index(min(shifted))]] += 1
            matrix /= matrix.sum()
            for (c, d), share in np.ndenumerate(matrix):
                sums += share / (1 + (c - d) ** 2), share * abs(c - d), share**2
        out.append(sums / 4)
    return np.array(out)


def test_a_matrix_computed_by_hand():
    """Three points on a line, 1 m apart, with levels 0, 2 and 1; the cloud is shifted by 1 m.

    Shifted to the east, the nearest point is the western neighbour, or for the first point itself: (0, 0), (2, 0),
    (1, 2). Shifted to the north-east by 0.71 m each way, it is the same. Shifted to the north, it is the point itself.
    Shifted to the north-west, it is the eastern neighbour, or for the last point itself: (0, 2), (2, 1), (1, 1).
    """
    points = non_sea([(0, 0), (1, 0), (2, 0)], [0.0, 2.0, 1.0])
    params = FeatureParams(features="texture", radius_m=5, shift_m=1, levels=4, max_height_m=4)
    east = np.array([(1 + 1 / 5 + 1 / 2) / 3, (0 + 2 + 1) / 3, 3 / 9])
    north = np.array([1, 0, 3 / 9])
    north_west = np.array([(1 / 5 + 1 / 2 + 1) / 3, (2 + 1 + 0) / 3, 3 / 9])
    expected = (2 * east + north + north_west) / 4
    np.testing.assert_allclose(features_of(points, params), np.tile(expected, (3, 1)), rtol=1e-12)


def test_only_neighbours_count():
    """Two pairs of points far apart: the matrix of each contains only its own two pairs."""
    points = non_sea([(0, 0), (1, 0), (100, 0), (101, 0)], [0.0, 0.0, 3.0, 0.0])
    params = FeatureParams(features="texture", radius_m=2, shift_m=1, levels=4, max_height_m=4)
    found = features_of(points, params)
    np.testing.assert_allclose(found[:2], [[1, 0, 1]] * 2)
    assert (found[2:, 1] > 0).all()


@given(seed=st.integers(0, 2**32), size=st.integers(1, 40), levels=st.integers(2, 9))
@settings(deadline=None, max_examples=25)
def test_any_cloud_as_with_loops(seed, size, levels):
    rng = np.random.default_rng(seed)
    points = non_sea(rng.uniform(0, 8, (size, 2)), rng.uniform(-1, 9, size))
    params = FeatureParams(features="texture", radius_m=2.5, shift_m=0.8, levels=levels, max_height_m=7)
    np.testing.assert_allclose(features_of(points, params), plain_texture(points, params), rtol=1e-10)


@pytest.mark.parametrize("features", FEATURES)
def test_blocks_threads_and_position_do_not_matter(monkeypatch, features):
    rng = np.random.default_rng(4)
    xy, height = np.round(rng.uniform(0, 30, (700, 2)), 3), rng.exponential(2, 700)
    points = non_sea(xy, height, rng.uniform(0, 500, 700))
    params = FeatureParams(features=features)
    expected = features_of(points, params)
    monkeypatch.setattr(module, "threads", lambda: 3)
    monkeypatch.setattr(module, "_BLOCK_POINTS", 50)
    monkeypatch.setattr(module, "_BLOCK_PAIRS", 400)
    monkeypatch.setattr(module, "_BINS", 5000)
    np.testing.assert_allclose(features_of(points, params), expected, rtol=1e-9, atol=1e-9)
    far = NonSeaPoints(points.xy + np.array([[5e5], [4e6]]), points.height_m, points.intensity, 1.0)
    np.testing.assert_allclose(features_of(far, params)[:, :11], expected[:, :11], rtol=1e-5, atol=1e-6)


def test_features_of_the_full_set():
    """A flat sheet and a rail, 100 m apart, with a point every half metre."""
    sheet = np.stack(np.mgrid[:41, :41], -1).reshape(-1, 2) * 0.5
    rail = np.column_stack([np.arange(80) * 0.5 + 100, np.zeros(80)])
    height = np.concatenate([np.full(len(sheet), 2.0), np.full(len(rail), 1.0)])
    intensity = np.concatenate([np.full(len(sheet), 300.0), np.tile([100.0, 300.0], 40)])
    points = non_sea(np.concatenate([sheet, rail]), height, intensity, density=4.0)
    found = dict(zip(FEATURES["full"], features_of(points, FeatureParams()).T, strict=True))
    middle, on_rail = 20 * 41 + 20, len(sheet) + 40
    values = {name: (round(float(v[middle]), 2), round(float(v[on_rail]), 2)) for name, v in found.items()}
    assert values["height"] == values["mean_height"] == (2.0, 1.0)
    assert values["height_deviation"] == (0, 0)
    assert values["linearity"] == (0, 1)
    assert values["planarity"] == (1, 0)
    assert values["density"][0] == pytest.approx(1, abs=0.05)
    assert values["density"][1] < 0.2
    assert values["intensity"][0] == 300
    assert values["intensity_deviation"][0] == 0
    assert 0.45 < values["intensity_deviation"][1] < 0.55
    assert values["context_height"] == (2.0, 1.0)
    assert values["context_height_deviation"] == (0, 0)
    assert values["context_density"][0] == pytest.approx(1, abs=0.06)
    assert values["context_density"][1] < 0.1


def test_context_features_cover_the_wider_surroundings():
    """Low points 6 m from a tower, and low points far from any."""
    rng = np.random.default_rng(0)
    low, tower = rng.uniform(0, 2, (50, 2)), rng.uniform(7, 9, (50, 2))
    height = np.concatenate([np.ones(50), np.full(50, 11.0), np.ones(50)])
    points = non_sea(np.concatenate([low, tower, low + 500]), height)
    found = dict(zip(FEATURES["full"], features_of(points, FeatureParams(context_m=14.0)).T, strict=True))
    np.testing.assert_allclose(found["context_height"][:50], 6)
    np.testing.assert_allclose(found["context_height_deviation"][:50], 5)
    np.testing.assert_allclose(found["context_height"][100:], 1)
    np.testing.assert_allclose(found["mean_height"][:50], 1)


@pytest.mark.parametrize("features", FEATURES)
@pytest.mark.parametrize("size", [0, 1, 2])
def test_very_few_points(features, size):
    params = FeatureParams(features=features)
    found = features_of(non_sea(np.zeros((size, 2)), np.ones(size)), params)
    assert found.shape == (size, len(params.names))
    assert np.isfinite(found).all()
