"""Surfaces of rough water beside mats that reflect like ground."""

import numpy as np

from seaclutter_cli.airborne.separation import separate
from seaclutter_cli.airborne.surface import OTHER, SeparationParams
from tests.airborne.coasts import SIZE, sea_only, shares, tile


def with_mat(height_m, rng, *, like_ground):
    """Return a wind sea with a mat of 30 m by 20 m that follows the waves, as bright as the water."""
    xyz, land, columns = tile(sea_only, height=1.0, length=25.0)
    mat = (np.abs(xyz[0] - SIZE[0] / 2) < 15) & (np.abs(xyz[1] - SIZE[1] / 2) < 10)
    xyz[2] += np.where(mat, height_m, 0)
    if like_ground:
        columns["intensity"] = np.where(mat, rng.gamma(20, 3, len(mat)), columns["intensity"])
    return xyz, mat | land, columns


def test_foam_that_reflects_like_ground_is_no_object():
    xyz, _, columns = with_mat(0.0, np.random.default_rng(2), like_ground=True)
    assert (separate([xyz], SeparationParams(), columns.get).classification == OTHER).mean() < 1e-3


def test_without_reflections_a_mat_follows_the_waves_as_water_does():
    """The mat of these tests is hard enough to show something."""
    assert shares(*with_mat(0.45, np.random.default_rng(2), like_ground=False))[0] < 0.5
