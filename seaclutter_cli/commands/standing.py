"""The points of a tile that stand out of the sea, with what a classifier is told of them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.features import Standing, features_of
from seaclutter_cli.airborne.separation import Separation
from seaclutter_cli.airborne.settings import Settings
from seaclutter_cli.commands.classify_separate import separate_tile
from seaclutter_cli.commands.console import warn
from seaclutter_cli.sources.tiles import CloudTile, LasTile, intensity_name, read_columns


@dataclass(frozen=True)
class Stood:
    """A tile that was separated.

    Parameters
    ----------
    separation : Separation
        Sea and what is not.
    points : Standing
        What is not.
    features : ndarray, shape (N, F), float64
        Of these N points.
    """

    separation: Separation
    points: Standing
    features: NDArray[np.float64]


def stand_out(tile: LasTile | CloudTile, settings: Settings, *, quiet: bool) -> Stood:
    """Separate a tile and compute the features of what is no sea."""
    separation = separate_tile(tile, settings.separation)
    other = separation.other
    xy = np.concatenate([tile.xyz(part)[:2] for part in tile.parts()], axis=1)[:, other]
    name = intensity_name(tile)
    if name is None and settings.features.features == "full":
        warn(f"{tile.path}: no intensity field; intensities are taken as 0", quiet=quiet)
    intensity: Any = read_columns(tile, [name])[name][other] if name else np.zeros(len(other))
    density = separation.points_per_cell / settings.separation.cell_m**2
    points = Standing(xy, separation.height_m[other].astype(np.float64), intensity.astype(np.float64), density)
    return Stood(separation, points, features_of(points, settings.features))
