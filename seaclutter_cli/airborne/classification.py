"""Classification of a tile: separation, features, forest, objects."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.features import NonSeaPoints, features_of
from seaclutter_cli.airborne.forest import predict
from seaclutter_cli.airborne.objects import FoundObject, find_objects
from seaclutter_cli.airborne.separation import Separation, separate
from seaclutter_cli.airborne.settings import TileSettings
from seaclutter_cli.interfaces import TilePoints

if TYPE_CHECKING:
    from seaclutter_cli.airborne.model import ObjectModel


@dataclass(frozen=True)
class TileFeatures:
    """A separated tile and the features of its non-sea points.

    Parameters
    ----------
    separation : Separation
        Sea and non-sea points.
    points : NonSeaPoints
        The N non-sea points.
    features : ndarray, shape (N, F), float64
        Features of these points.
    """

    separation: Separation
    points: NonSeaPoints
    features: NDArray[np.float64]


def tile_features(tile: TilePoints, settings: TileSettings) -> TileFeatures:
    """Return a separated tile with the features of its non-sea points; missing intensities count as 0.

    Raises
    ------
    InputError
        If the tile cannot be separated.
    """
    separation = separate(tile, settings.separation, tile.column)
    other = separation.other
    xy = np.concatenate([xyz[:2] for xyz in tile], axis=1)[:, other]
    intensity = tile.column("intensity")
    bright = np.zeros(len(other)) if intensity is None else intensity[other].astype(np.float64)
    density = separation.points_per_cell / settings.separation.cell_m**2
    points = NonSeaPoints(xy, separation.height_m[other].astype(np.float64), bright, density)
    return TileFeatures(separation, points, features_of(points, settings.features))


@dataclass(frozen=True)
class ClassifiedPoints:
    """Classes and objects of the N non-sea points of a tile.

    Parameters
    ----------
    tile : TileFeatures
        The separated tile.
    code : ndarray, shape (N,), int64
        Class of each point.
    probability : ndarray, shape (N,), float64
        Probability of that class.
    number : ndarray, shape (N,), int64
        Object of each point; 0 for none.
    left_out : ndarray, shape (N,), int64
        Cluster of each point if it is too unlikely to be an object; 0 for none.
    objects : list of FoundObject
        Objects found in the tile.
    """

    tile: TileFeatures
    code: NDArray[np.int64]
    probability: NDArray[np.float64]
    number: NDArray[np.int64]
    left_out: NDArray[np.int64]
    objects: list[FoundObject]


def classify_points(tile: TilePoints, model: "ObjectModel") -> ClassifiedPoints:
    """Return the classes and objects of a tile; raise `InputError` if it cannot be separated."""
    found = tile_features(tile, model.settings)
    probability = predict(model.forest, found.features)
    classes = [int(code) for code in model.forest.classes_]
    objects, number, left_out = find_objects(found.points, probability, classes, model.settings.objects)
    code = np.array(classes)[probability.argmax(axis=1)] if len(probability) else np.empty(0, np.int64)
    return ClassifiedPoints(found, code, probability.max(axis=1, initial=0.0), number, left_out, objects)
