"""Random coasts in simulated tiles, for `ground_filters.py`: one kind of land each, or a lock between two levels."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from seaclutter_cli.errors import ConfigError
from seaclutter_cli.simulation.airborne.scene import LandParams, TileObjectParams, TileScene, load_tile_scene

SIZE_M = 500.0, 400.0
OBJECTS = ("ship", "reef", "seaweed", "fishing fence")
Lands = list[LandParams]


def _shore(rng: np.random.Generator) -> dict[str, tuple[float, ...] | float]:
    """Return the outline of land that covers about half of a tile, on a random side."""
    bearing = float(rng.uniform(0, 2 * np.pi))
    away = 500 + float(rng.uniform(-60, 40))
    position = (SIZE_M[0] / 2 + away * np.cos(bearing), SIZE_M[1] / 2 + away * np.sin(bearing))
    return {"position_m": position, "size_m": (1000.0, 1400.0), "heading_deg": float(np.degrees(bearing))}


def _beach(rng: np.random.Generator) -> Lands:
    slope = float(np.exp(rng.uniform(np.log(0.01), np.log(0.08))))
    values = {"slope": slope, "height_m": float(rng.uniform(1.5, 5)), "relief_m": float(rng.uniform(0.05, 0.25))}
    return [LandParams(kind="beach", **_shore(rng), **values, trees=float(rng.uniform(0, 0.2)))]  # type: ignore[arg-type]


def _cliff(rng: np.random.Generator) -> Lands:
    values = {"height_m": float(rng.uniform(3, 25)), "relief_m": float(rng.uniform(0.2, 1))}
    return [LandParams(kind="cliff", **_shore(rng), **values)]  # type: ignore[arg-type]


def _polder(rng: np.random.Generator, low: float, high: float) -> Lands:
    values = {"height_m": float(rng.uniform(low, high)), "relief_m": float(rng.uniform(0.03, 0.12))}
    return [LandParams(kind="polder", **_shore(rng), **values)]  # type: ignore[arg-type]


def _island(rng: np.random.Generator) -> Lands:
    size = (float(rng.uniform(120, 280)), float(rng.uniform(90, 200)))
    values = {"height_m": float(rng.uniform(0.8, 3)), "slope": float(rng.uniform(0.03, 0.15))}
    heading = float(rng.uniform(0, 180))
    return [LandParams(kind="island", position_m=(250.0, 200.0), size_m=size, heading_deg=heading, **values)]


def _lock(rng: np.random.Generator) -> Lands:
    level, middle = float(rng.uniform(0.4, 3)), float(rng.uniform(200, 300))
    crest = level + float(rng.uniform(1, 2.5))
    return [
        LandParams(
            kind="basin", position_m=(middle + 500, 200.0), size_m=(1000.0, 900.0), height_m=level, crest_m=crest
        ),
        LandParams(
            kind="cliff", position_m=(middle, 200.0), size_m=(90.0, 900.0), height_m=crest, relief_m=0.2, ragged_m=0
        ),
        LandParams(kind="basin", position_m=(middle, 200.0), size_m=(110.0, 24.0), height_m=level / 2, crest_m=crest),
    ]


COASTS: Mapping[str, Callable[[np.random.Generator], Lands]] = {
    "beach, 1 in 100 to 1 in 12": _beach,
    "cliff, 3 to 25 m": _cliff,
    "polder, 0.1 to 1.2 m": lambda rng: _polder(rng, 0.1, 1.2),
    "polder below the sea, 0.5 to 4 m": lambda rng: _polder(rng, -4.0, -0.5),
    "low island, 0.8 to 3 m": _island,
    "lock, levels 0.4 to 3 m apart": _lock,
}


def coast_scene(name: str, seed: int) -> TileScene:
    """Return a random coast of a kind, with objects in its water."""
    scene = load_tile_scene("shore").with_tile(seed=seed, size_m=SIZE_M, gap_m=12.0)
    lands = COASTS[name](np.random.default_rng([seed, list(COASTS).index(name)]))
    objects = [TileObjectParams(kind=kind, size_m=None) for kind in OBJECTS]
    while True:  # where there is little water, not all objects find room
        chosen = replace(scene, land=tuple(lands), objects=tuple(objects))
        try:
            chosen.placed_objects()
        except ConfigError:
            objects.pop()
        else:
            return chosen
