"""Terrain without water."""

import numpy as np
import pytest

from tests.airborne.coasts import hummocks, shares


def rising(share, rng, count=60_000):
    """Return ground; a share of the echoes, everywhere, is from crowns that hide none of it."""
    x, y = rng.uniform(0, 150, count), rng.uniform(0, 120, count)
    high = rng.random(count) < share
    return np.stack((x, y, np.where(high, rng.uniform(5, 15, count), hummocks(x, y))))


@pytest.mark.parametrize(("share", "is_wood"), [(0.2, True), (0.01, False)])
def test_what_rises_everywhere_is_a_wood(share, is_wood):
    """A few birds or drops above each square are none."""
    xyz = rising(share, np.random.default_rng(4))
    on_land, _ = shares(xyz, np.ones(xyz.shape[1], np.bool_), {"number_of_returns": np.ones(xyz.shape[1], int)})
    assert (on_land == 1) == is_wood


def test_heights_above_the_ground_below_trees_are_no_lake():
    """The ground is perfectly level, and crowns are above most of it."""
    rng = np.random.default_rng(4)
    x, y = rng.uniform(0, 150, 80_000), rng.uniform(0, 120, 80_000)
    wood = np.sin(x / 9) * np.sin(y / 7) > -0.6
    z = np.where(wood & (rng.random(len(x)) < 0.5), rng.uniform(3, 20, len(x)), 0.0)
    columns = {"intensity": rng.normal(200, 40, len(x)), "number_of_returns": np.ones(len(x), int)}
    assert shares(np.stack((x, y, z)), np.ones(len(x), np.bool_), columns)[0] == 1
