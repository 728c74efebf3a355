"""The points of a tile that stand out of the sea, with the features by which a classifier names them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.features import Standing, features_of
from seaclutter_cli.airborne.separation import Separation
from seaclutter_cli.airborne.settings import TileSettings
from seaclutter_cli.runs.classify.separate import separate_tile
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.sources.tiles import CloudTile, Coordinates, LasTile, intensity_name, read_columns


@dataclass(frozen=True)
class TileFeatures:
    """A separated tile and the features of what is no sea.

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


def tile_features(tile: LasTile | CloudTile, settings: TileSettings, observer: Observer) -> TileFeatures:
    """Separate a tile and compute the features of what is no sea."""
    separation = separate_tile(tile, settings.separation)
    other = separation.other
    xy = np.concatenate([xyz[:2] for xyz in Coordinates(tile)], axis=1)[:, other]
    name = intensity_name(tile)
    if name is None and settings.features.features == "full":
        observer.warn(f"{tile.path}: no intensity field; intensities are taken as 0")
    intensity: Any = read_columns(tile, [name])[name][other] if name else np.zeros(len(other))
    density = separation.points_per_cell / settings.separation.cell_m**2
    points = Standing(xy, separation.height_m[other].astype(np.float64), intensity.astype(np.float64), density)
    return TileFeatures(separation, points, features_of(points, settings.features))
