"""Classification of a tile: separation, features, forest, objects."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seaclutter_cli.airborne.features import NonSeaPoints, features_of
from seaclutter_cli.airborne.forest import predict
from seaclutter_cli.airborne.objects import FoundObject, find_objects
from seaclutter_cli.airborne.separation import Separation, separate
from seaclutter_cli.airborne.settings import TileSettings
from seaclutter_cli.arrays import Floats, Ints
from seaclutter_cli.interfaces import TilePoints

if TYPE_CHECKING:
    from seaclutter_cli.airborne.model import ObjectModel


@dataclass(frozen=True)
class TileFeatures:
    """A separated tile and the features of its non-sea points.

    ``separation``: sea and non-sea points; ``points``: the N non-sea points; ``features``, shape (N, F): features of
    these points.
    """

    separation: Separation
    points: NonSeaPoints
    features: Floats


def tile_features(tile: TilePoints, settings: TileSettings) -> TileFeatures:
    """Return a separated tile with the features of its non-sea points; missing intensities count as 0.

    Raise `InputError` if the tile cannot be separated.
    """
    separation = separate(tile, settings.separation, tile.column)
    other = separation.other
    xy = np.concatenate([xyz[:2] for xyz in tile], axis=1)[:, other]
    intensity = tile.column("intensity")
    bright = np.zeros(len(other)) if intensity is None else intensity[other].astype(np.float64)
    density = separation.points_per_cell / settings.separation.cell_m**2
    least_m = separation.sea.object_height_m
    points = NonSeaPoints(xy, separation.height_m[other].astype(np.float64), bright, density, least_m)
    return TileFeatures(separation, points, features_of(points, settings.features))


@dataclass(frozen=True)
class ClassifiedPoints:
    """Classes and objects of the N non-sea points of a tile.

    ``tile``: the separated tile; ``code``, shape (N,): class of each point; ``probability``, shape (N,): probability of
    that class; ``number``, shape (N,): object of each point; 0 for none; ``left_out``, shape (N,): cluster of each
    point if it is too unlikely to be an object; 0 for none; ``objects``: objects found in the tile.
    """

    tile: TileFeatures
    code: Ints
    probability: Floats
    number: Ints
    left_out: Ints
    objects: list[FoundObject]


def classify_points(tile: TilePoints, model: "ObjectModel") -> ClassifiedPoints:
    """Return the classes and objects of a tile; raise `InputError` if it cannot be separated."""
    found = tile_features(tile, model.settings)
    probability = predict(model.forest, found.features)
    classes = [int(code) for code in model.forest.classes_]
    objects, number, left_out = find_objects(found.points, probability, classes, model.settings.objects)
    code = np.array(classes)[probability.argmax(axis=1)] if len(probability) else np.empty(0, np.int64)
    return ClassifiedPoints(found, code, probability.max(axis=1, initial=0.0), number, left_out, objects)
