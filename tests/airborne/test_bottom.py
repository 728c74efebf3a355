"""Echoes from the bottom of clear water."""

import numpy as np

from seaclutter_cli.airborne.separation import separate
from seaclutter_cli.airborne.surface import GROUND, OTHER, WATER, SeparationParams

SIZE = np.array([[200.0], [150.0]])
DEPTH_M = 4.0


def pulses(rng, elevation, second, share):
    """Return coordinates and columns of pulses, of which a share has a second echo."""
    xy = rng.uniform(0, 1, (2, 100_000)) * SIZE
    first = elevation(*xy)
    several = (rng.random(len(first)) < share) & (second(*xy) < first)
    xyz = np.hstack((np.vstack((xy, first)), np.vstack((xy, second(*xy)))[:, several]))
    return xyz, {
        "return_number": np.r_[np.ones(len(first)), np.full(several.sum(), 2)].astype(np.uint8),
        "number_of_returns": np.r_[1 + several, np.full(several.sum(), 2)].astype(np.uint8),
    }


def ship(x, y):
    return (np.abs(x - 120) < 30) & (np.abs(y - 70) < 7)


def clear_water(share, lone=0.0, wave=0.15):
    rng = np.random.default_rng(3)

    def surface(x, y):
        water = wave * np.sin(x / 3 + y / 5) + rng.normal(0, 0.03, len(x))
        return np.where(ship(x, y), 5.0, water)

    def bottom(x, y):
        return np.where(ship(x, y), 9.0, np.sin(x / 20) - DEPTH_M)

    xyz, columns = pulses(rng, surface, bottom, share)
    seen = np.flatnonzero((columns["number_of_returns"] == 2) & (columns["return_number"] == 1))
    kept = np.ones(xyz.shape[1], np.bool_)
    kept[seen[rng.random(len(seen)) < lone]] = False
    return xyz[:, kept], {name: values[kept] for name, values in columns.items()}


def test_a_fixed_height_is_the_published_method():
    xyz, columns = clear_water(0.4)
    found = separate([xyz], SeparationParams(height_m=0.5), columns.get)
    assert np.mean(found.classification[np.abs(xyz[2]) < 0.5] == WATER) < 0.1


def test_a_trusted_bottom_keeps_its_class():
    xyz, columns = clear_water(0.4)
    columns["classification"] = np.where(xyz[2] < -2, GROUND, OTHER).astype(np.uint8)
    found = separate([xyz], SeparationParams(trust_classes=(2,)), columns.get)
    assert (found.classification[xyz[2] < -2] == GROUND).all()
