"""Kappa of sea and non-sea points over sea states, on simulated tiles.

Run as ``python benchmarks/seas.py SCENE SEED...``, such as ``mixed 411 412 413 414 415``. The table goes to standard
output. A period follows from the length of the waves: the period of a wave in deep water.
"""

import sys
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.separation import separate
from seaclutter_cli.airborne.settings import TileSettings
from seaclutter_cli.airborne.squares import Column
from seaclutter_cli.airborne.surface import NEVER, OTHER, WATER
from seaclutter_cli.evaluation.confusion import Confusion
from seaclutter_cli.simulation.airborne.recording import simulate_strips
from seaclutter_cli.simulation.airborne.scene import TileScene, load_tile_scene

GRAVITY = 9.81
SEAS = {  # significant height and length in metres of the wind sea, and of the swell
    "calm": (0.1, 7.6, 0.25, 100),
    "wind sea 0.5 m": (0.5, 12, 0, 100),
    "wind sea 0.8 m": (0.8, 18, 0, 100),
    "wind sea 1.1 m": (1.1, 25, 0, 100),
    "wind sea 1.5 m": (1.5, 33, 0, 100),
    "wind sea 2.0 m": (2.0, 44, 0, 100),
    "swell 0.8 m, 20 m long": (0.2, 7.6, 0.8, 20),
    "swell 1.2 m, 40 m long": (0.3, 10, 1.2, 40),
    "swell 1.5 m, 60 m long": (0.3, 10, 1.5, 60),
    "swell 1.5 m, 80 m long": (0.3, 10, 1.5, 80),
    "swell 1.5 m, 100 m long": (0.3, 10, 1.5, 100),
    "swell 2.0 m, 120 m long": (0.3, 10, 2.0, 120),
    "both: 1.0 and 1.1 m": (1.0, 23, 1.1, 100),
    "too steep: 1.0 m, 7.6 m long": (1.0, 7.6, 0, 100),
    "too steep: 1.5 m, 7.6 m long": (1.5, 7.6, 0, 100),
}
CLASSES = (NEVER, OTHER, WATER)


def with_sea(scene: TileScene, sea: tuple[float, ...]) -> TileScene:
    wave_m, wave_length_m, swell_m, swell_length_m = sea
    periods = [float(np.sqrt(2 * np.pi * length / GRAVITY)) for length in (wave_length_m, swell_length_m)]
    water = replace(scene.water, wave_m=wave_m, wave_period_s=periods[0], swell_m=swell_m, swell_period_s=periods[1])
    return replace(scene, water=water)


def column_of(points: NDArray[np.void]) -> Column:
    """Return the attributes of simulated points for `separate`."""
    return lambda name: points[name] if name in (points.dtype.names or ()) else None


def kappas(scene: TileScene, heights: tuple[float | str, ...]) -> list[float]:
    """Return kappa with each setting of ``height_m``; simulated noise echoes are left out."""
    points = np.concatenate(list(simulate_strips(scene)))
    xyz = np.stack([points[axis] for axis in "xyz"])
    known = np.isin(points["classification"], (OTHER, WATER))
    found = []
    for height in heights:
        params = replace(TileSettings().separation, height_m=height)
        own = separate([xyz], params, column_of(points))
        found.append(Confusion.of(points["classification"][known], own.classification[known], CLASSES).kappa)
    return found


def main(name: str, seeds: list[int]) -> None:
    print("| sea | fixed, 0.5 m | auto |\n| --- | --- | --- |")
    for label, sea in SEAS.items():
        scene = with_sea(load_tile_scene(name), sea)
        each = [kappas(scene.with_tile(seed=seed), (0.5, "auto")) for seed in seeds]
        ranges = [f"{min(own):.3f} to {max(own):.3f}" for own in zip(*each, strict=True)]
        print(f"| {label} | {' | '.join(ranges)} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1], [int(seed) for seed in sys.argv[2:]])
