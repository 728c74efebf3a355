"""Points of tiles with waves and a coast, and what the separation makes of them."""

from copy import deepcopy
from functools import lru_cache

import numpy as np

from seaclutter_cli.airborne.separation import separate
from seaclutter_cli.airborne.surface import OTHER, SeparationParams

SIZE = 400.0, 300.0


def relief(rng, x, y, std=0.1):
    """Return ground that undulates over some ten metres."""
    total = sum(np.sin(x / rng.uniform(4, 14) + y / rng.uniform(4, 14) + rng.uniform(0, 7)) for _ in range(12))
    return std * total / np.sqrt(6) + rng.normal(0, 0.03, len(x))


def waves(rng, x, y, height, length):
    total = np.zeros(len(x))
    for _ in range(30):
        k, angle = 2 * np.pi / (length * rng.normal(1, 0.1)), 0.6 + rng.normal(0, 0.3)
        total += np.sin(k * (np.cos(angle) * x + np.sin(angle) * y) + rng.uniform(0, 7))
    return height / 4 * total / total.std() + rng.normal(0, 0.03, len(x))


def tile(ground, *, height=0.1, length=15.0, level=0.0, speckle=True, seed=5):
    """Return points, whether each is on land, and their attributes.

    ``ground`` returns the elevation of the ground; where it is below the water, there is water.
    """
    x, y, bumps, surface, rng = _sea(height, length, seed)
    bottom = ground(x, y, bumps)
    surface = surface + (level(x, y) if callable(level) else level)
    rng = deepcopy(rng)
    land = bottom > surface
    water = rng.gamma(2.0, 30, len(x)) if speckle else rng.normal(60, 10, len(x))
    intensity = np.where(land, rng.normal(200, 40, len(x)), water).clip(0)
    columns = {"intensity": intensity, "number_of_returns": np.ones(len(x), int)}
    return np.stack((x, y, np.maximum(bottom, surface))), land, columns


@lru_cache(maxsize=8)
def _sea(height, length, seed):
    """Return positions, the relief and the waves there, and the generator that goes on from here; not to be changed."""
    rng = np.random.default_rng(seed)
    x, y = (rng.uniform(0, side, 240_000) for side in SIZE)
    return x, y, relief(rng, x, y), waves(rng, x, y, height, length), rng


def shares(xyz, land, columns, **params):
    """Return the share of land, and that of water, called non-sea."""
    other = separate([xyz], SeparationParams(**params), columns.get).classification == OTHER
    return other[land].mean() if land.any() else 1.0, other[~land].mean() if not land.all() else 0.0


def sea_only(x, _y, _bumps):
    return np.full(len(x), -5.0)


def hummocks(x, y):
    """Return ground that is nowhere level."""
    return 0.4 * np.sin(x / 3) * np.sin(y / 4) + 1.2 * np.sin(x / 11 + y / 13) + 1.5


COASTS = {
    "beach 1 in 30": lambda x, _, bumps: (x - 200) / 30 + bumps,
    "beach 1 in 100": lambda x, _, bumps: (x - 150) / 100 + bumps,
    "cliff": lambda x, _, bumps: np.where(x > 250, 15 + bumps, -5),
    "dike and low polder": lambda x, _, bumps: np.select([x < 190, x < 205], [-5.0, 4.0], 0.6 + bumps),
}
