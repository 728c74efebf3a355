import numpy as np
import pytest

from seaclutter_cli.simulation.layouts import LAYOUTS, REACH_M, horizon, horizon_class, scene_class
from seaclutter_cli.simulation.marine.recording import Renderer
from seaclutter_cli.simulation.marine.scene import load_scene, parse_scene

WATER = [name for name, layout in LAYOUTS.items() if layout.scene_class in ("open", "confined")]
TREES = [name for name in LAYOUTS if name not in WATER]
SEEDS = range(2)


def scene(*walls, lidar_m=2.5):
    objects = [
        {"track_id": number + 1, "shape": "quay_wall", "size_m": size, "path": [position], "heading_deg": heading}
        for number, (position, size, heading) in enumerate(walls)
    ]
    return parse_scene({"vessel": {"lidar_height_m": lidar_m}, "objects": objects}, "test")


def test_a_wall_closes_the_bearings_that_it_spans():
    ahead = horizon(scene(([21, 0], [2, 40, 3], 0)))
    assert ahead.mean() == pytest.approx(0.25, abs=0.02)
    assert ahead[0]
    assert not ahead[60]
    assert np.array_equal(ahead, horizon(scene(([21, 0], [40, 2, 3], 90))))


def test_far_or_low_objects_or_those_below_the_beams_close_nothing():
    assert horizon(scene(([REACH_M + 2, 0], [2, 40, 3], 0))).mean() == 0
    assert horizon(scene(([21, 0], [2, 40, 0.4], 0))).mean() == 0
    assert horizon(scene(([4, 0], [2, 40, 1], 0), lidar_m=6.0))[0] == 0


def test_classes_of_simple_scenes():
    left, right = ([0, 15], [200, 2, 3], 0), ([0, -15], [200, 2, 3], 0)
    assert horizon_class(horizon(scene(left, right))) == "confined"
    assert horizon_class(horizon(scene(left))) is None
    assert horizon_class(horizon(scene(([40, 0], [20, 4, 3], 90)))) == "open"
    assert horizon_class(horizon(scene())) == "open"


def test_a_gap_of_one_bearing_does_not_split_a_facade():
    boats = [([12.0, 1.1 * number], [4, 0.7, 2], 0) for number in range(-12, 13)]
    row = horizon(scene(*boats))
    assert np.count_nonzero(row) > 30
    assert np.count_nonzero(np.diff(np.flatnonzero(row)) > 1) == 1  # astern


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        *((name, "confined") for name in ("harbour", "lock", "narrow_channel", "moored_rows")),
        *((name, "open") for name in ("calm", "clutter_only", "buoy_speedboat", "departure", "rough")),
        *((name, "sparse") for name in ("poplar", "willow")),
        ("apple", "dense"),
    ],
)
def test_the_built_in_scenes_have_their_classes(name, expected):
    assert scene_class(load_scene(name)) == expected


@pytest.fixture(scope="module")
def frames():
    return {
        name: [Renderer(LAYOUTS[name].make(np.random.default_rng(seed))).frame(0) for seed in SEEDS] for name in LAYOUTS
    }


def solid_share(points):
    """Return the share of the bearings, three degrees each, with a solid object within reach."""
    x, y = points["x"].astype(float), points["y"].astype(float)
    distance = np.hypot(x, y)
    solid = (points["label"] > 0) & (distance < REACH_M) & (distance > 4)
    return len(np.unique(np.floor(np.degrees(np.arctan2(y, x))[solid] / 3))) / 120


@pytest.mark.parametrize("name", WATER)
def test_rendered_points_agree_with_the_rule(frames, name):
    shares = [solid_share(frame.points) for frame in frames[name]]
    if LAYOUTS[name].scene_class == "confined":
        assert min(shares) > 0.45
    else:
        assert max(shares) < 0.45


@pytest.mark.parametrize("name", TREES)
def test_dense_trees_fill_the_bearings_along_the_row_and_sparse_trees_do_not(frames, name):
    for frame in frames[name]:
        points = frame.points
        x, y = points["x"].astype(float), points["y"].astype(float)
        trees = (points["label"] > 0) & (points["label"] < 65535)
        columns = len(np.unique(np.round(np.degrees(np.arctan2(y, x))[trees], 1)))
        assert (columns > 200) == (LAYOUTS[name].scene_class == "dense")


def features(points):
    x, y = points["x"].astype(float), points["y"].astype(float)
    distance = np.hypot(x, y)
    near = distance < REACH_M
    return {
        "points": len(points),
        "occupied cells": len(np.unique(np.floor(x[near] / 0.5) * 1e4 + np.floor(y[near] / 0.5))),
        "clutter points": int((points["label"] == 0).sum()),
        "median range": float(np.median(distance)),
        "95 % of ranges": float(np.quantile(distance, 0.95)),
        "far share": float((distance > 40).mean()),
    }


def best_accuracy(values, confined):
    """Return the balanced accuracy of the best threshold on one feature."""
    found = [np.array([values[confined] > t, values[confined] <= t]).mean(axis=1) for t in values]
    false = [np.array([values[~confined] > t, values[~confined] <= t]).mean(axis=1) for t in values]
    return max(float(((one + 1 - other) / 2).max()) for one, other in zip(found, false, strict=True))


def test_no_single_feature_separates_the_classes(frames):
    rows = [
        (LAYOUTS[name].scene_class == "confined", features(frame.points)) for name in WATER for frame in frames[name]
    ]
    confined = np.array([is_confined for is_confined, _ in rows])
    for feature in rows[0][1]:
        values = np.array([row[feature] for _, row in rows], float)
        assert best_accuracy(values, confined) < 0.9, feature


@pytest.mark.slow
def test_no_single_feature_separates_the_classes_in_many_scenes():
    rows = [
        (LAYOUTS[name].scene_class == "confined", features(Renderer(LAYOUTS[name].make(rng)).frame(0).points))
        for name in WATER
        for rng in np.random.default_rng(5).spawn(20)
    ]
    confined = np.array([is_confined for is_confined, _ in rows])
    for feature in rows[0][1]:
        assert best_accuracy(np.array([row[feature] for _, row in rows], float), confined) < 0.87, feature
