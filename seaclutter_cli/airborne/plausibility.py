"""Signs that a tile is not of the sea, or that an object is not what it is called."""

from collections.abc import Iterable, Sequence

import numpy as np

from seaclutter_cli.airborne.objects import FoundObject
from seaclutter_cli.airborne.separation import Separation
from seaclutter_cli.airborne.surface import WATER
from seaclutter_cli.arrays import Floats
from seaclutter_cli.text import count, share

_MAX_SPREAD_M = 4.0
_MIN_SEA = 0.05
_MAX_OBJECT_M = 1.0
_MANY, _EXACT, _SAMPLE = 100, 0.5, 10_000
_LARGEST_M = {"ship": (460.0, 130.0, 80.0)}  # length, width, height of the largest ships ever built, and a margin


def doubts_about_sea(parts: Iterable[Floats], found: Separation) -> list[str]:
    """Return reasons to doubt that a tile, of points in metres, is of the sea."""
    is_sea = found.classification == WATER
    points = int(np.count_nonzero(is_sea))
    doubts = []
    if not points:
        doubts.append("no point is sea")
    elif points < _MIN_SEA * len(is_sea):
        doubts.append(f"only {share(points, len(is_sea))} of the points are sea")
    z = np.concatenate([xyz[2] for xyz in parts])[is_sea]
    elevation = z - found.height_m[is_sea]
    if len(elevation):
        low, high = np.quantile(elevation, (0.01, 0.99))
        if high - low > _MAX_SPREAD_M:
            doubts.append(
                f"what was taken for the sea is not level: it lies between {low:.1f} and {high:.1f} m; if the tile "
                "is of land, neither classes nor objects mean anything"
            )
        at_once = np.count_nonzero(z == np.median(z[:: len(z) // _SAMPLE + 1]))
        if len(z) >= _MANY and at_once > _EXACT * len(z):
            doubts.append(
                f"{share(int(at_once), len(z))} of what was taken for the sea has exactly one elevation; if elevations "
                "are heights above the ground, neither classes nor objects mean anything"
            )
    if found.is_doubtful:
        doubts.append(
            "hardly anything distinguishes sea from land: no reflections of water, no clear waves, no even water in a "
            "hollow; the tile may be of land; classes of its points help, see separation.trust_classes"
        )
    if found.sea.surface == "followed" and found.sea.object_height_m > _MAX_OBJECT_M:
        doubts.append(
            f"waves of {found.sea.wave_height_m:.1f} m: what rises less than {found.sea.object_height_m:.1f} m above "
            "the surface cannot be distinguished from them by height"
        )
    return doubts


def doubts_about_objects(objects: Sequence[FoundObject]) -> list[str]:
    """Return a line for each class with objects that are larger than any of its kind."""
    doubts = []
    for name, limits in _LARGEST_M.items():
        own = [one for one in objects if one.name == name]
        sizes = [(*one.size, one.height_m) for one in own]
        beyond = [size for size in sizes if any(value > limit for value, limit in zip(size, limits, strict=True))]
        if beyond:
            largest = " by ".join(f"{value:.0f}" for value in max(beyond))
            doubts.append(
                f"{count(len(beyond), name)} of implausible size, up to {largest} m; check that the tile is of the sea "
                "and that its unit is right"
            )
    return doubts
