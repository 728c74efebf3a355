"""Boxes and the points in them."""

import numpy as np
import pytest

from seaclutter_cli.truth import Boxes


def random_boxes(rng, count):
    tracks = tuple(map(str, range(count)))
    sizes = rng.choice([0, 0.5, 3, 20], (count, 3))
    return Boxes(tracks, tracks, rng.uniform(-20, 20, (count, 3)), sizes, rng.uniform(-7, 7, count))


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("margin_m", [0, 0.5])
def test_points_in_boxes(seed, margin_m):
    """A point is inside if its distances from the centre along the sides are at most half of them and the margin."""
    rng = np.random.default_rng(seed)
    boxes = random_boxes(rng, 20)
    xyz = rng.uniform(-25, 25, (3, 500))
    xyz[:, :20] = boxes.centers.T
    xyz[seed % 3, 20:30] = [np.nan, np.inf] * 5
    expected = np.zeros((20, 500), bool)
    for row, center, size, yaw in zip(expected, boxes.centers, boxes.sizes, boxes.yaws, strict=True):
        turn = np.array([[np.cos(yaw), np.sin(yaw), 0], [-np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
        with np.errstate(invalid="ignore"):
            row[:] = (np.abs(turn @ (xyz.T - center).T) <= size[:, None] / 2 + margin_m).all(axis=0)
    np.testing.assert_array_equal(boxes.covers(xyz, margin_m), expected.any(axis=0))
    assert [inside.tolist() for inside in boxes.members(xyz, margin_m)] == [
        np.flatnonzero(r).tolist() for r in expected
    ]


def test_boxes_of_any_size():
    boxes = Boxes(("1", "2"), ("a", "b"), np.zeros((2, 3)), np.array([[1e308] * 3, [0.0] * 3]), np.zeros(2))
    found = boxes.members(np.array([[0.0, 1e9], [0, 0], [0, 0]]), 0)
    assert [inside.tolist() for inside in found] == [[0, 1], [0]]
