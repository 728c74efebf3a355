"""Kappa on plain tiles at one moment: random waves, boxes and a coast, without the simulator and its intensities.

Run as ``python benchmarks/one_moment.py SEED...``. Tiles of 300 m by 300 m have five echoes per square metre at random,
and either no intensities or such as ground has everywhere. The table goes to standard output.
"""

import sys

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.classes import OTHER, WATER
from seaclutter_cli.airborne.separation import separate
from seaclutter_cli.airborne.surface import SeparationParams
from seaclutter_cli.evaluation.confusion import Confusion

Values = NDArray[np.float64]

SIZE_M, PER_M2, NOISE_M = 300.0, 5.0, 0.03
SEAS = {  # significant height and length in metres
    "calm": (0.0, 1.0),
    "0.4 m, 15 m": (0.4, 15.0),
    "0.8 m, 30 m": (0.8, 30.0),
    "1.0 m, 60 m": (1.0, 60.0),
    "1.5 m, 40 m": (1.5, 40.0),
    "1.5 m, 80 m": (1.5, 80.0),
    "1.5 m, 100 m": (1.5, 100.0),
}
LANDS = ("none", "cliff, 15 m", "quay, 2 m", "polder, 1 m", "beach, 1 in 25")
BOXES = ((60, 60, 40, 8, 6), (120, 200, 25, 6, 4), (150, 80, 12, 5, 3), (40, 240, 60, 12, 12))  # x, y, sides, height


def waves(rng: np.random.Generator, x: Values, y: Values, height_m: float, length_m: float) -> Values:
    """Return the elevation of sixty waves of similar lengths and directions."""
    if not height_m:
        return np.zeros(len(x))
    z = np.zeros(len(x))
    for _ in range(60):
        length, heading = length_m * np.exp(rng.normal(0, 0.25)), rng.normal(0.6, 0.35)
        along = x * np.cos(heading) + y * np.sin(heading)
        z += np.cos(2 * np.pi * along / length + rng.uniform(0, 2 * np.pi))
    return height_m / 4 * z / z.std()


def ground(name: str, x: Values, y: Values) -> Values:
    """Return the elevation of the land, which begins three fifths across the tile."""
    away = x - 0.6 * SIZE_M
    heights = {
        "none": np.full(len(x), -99.0),
        "cliff, 15 m": 15 + 2 * np.sin(x / 30) + np.cos(y / 20),
        "quay, 2 m": np.full(len(x), 2.0),
        "polder, 1 m": 1 + 0.05 * np.sin(x / 17) * np.cos(y / 23),
    }
    return 0.04 * away if name not in heights else np.where(away > 0, heights[name], -99.0)


def kappa(land: str, sea: tuple[float, float], seed: int, *, with_intensity: bool) -> float:
    """Return the kappa of sea and non-sea points of a tile."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, SIZE_M, (2, int(PER_M2 * SIZE_M**2)))
    water, solid = waves(rng, x, y, *sea), ground(land, x, y)
    for east, north, length, width, height in BOXES:
        box = (np.abs(x - east) < length / 2) & (np.abs(y - north) < width / 2)
        solid = np.where(box, np.maximum(solid, height), solid)
    z = np.maximum(water, solid) + rng.normal(0, NOISE_M, len(x))
    columns = {"intensity": rng.normal(100, 15, len(x))} if with_intensity else {}
    found = separate([np.stack((x, y, z))], SeparationParams(), columns.get).classification
    truth, said = (np.where(is_water, WATER, OTHER) for is_water in (solid <= water, found == WATER))
    return Confusion.of(truth, said, (OTHER, WATER)).kappa


def main(seeds: list[int]) -> None:
    print("| land | sea | no intensities | those of ground |\n| --- | --- | ---: | ---: |")
    for land in LANDS:
        for label, sea in SEAS.items():
            each = [[kappa(land, sea, seed, with_intensity=given) for seed in seeds] for given in (False, True)]
            print(
                f"| {land} | {label} | {' | '.join(f'{min(own):.3f} to {max(own):.3f}' for own in each)} |", flush=True
            )


if __name__ == "__main__":
    main([int(seed) for seed in sys.argv[1:]])
