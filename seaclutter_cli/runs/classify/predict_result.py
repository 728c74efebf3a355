"""Objects found in tiles, as text and as data."""

from collections import Counter
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.classification import ClassifiedPoints
from seaclutter_cli.airborne.objects import FoundObject
from seaclutter_cli.runs.recordings import Result
from seaclutter_cli.sources.crs import Crs
from seaclutter_cli.text import count, printable, table

DIMENSIONS = {
    "predicted_class": ("u1", "0 none, 1 ship ... 8 garbage"),
    "probability": ("f4", "of the predicted class"),
    "predicted_object": ("u4", "number of the object, 0 none"),
}


def columns_of(found: ClassifiedPoints) -> dict[str, NDArray[Any]]:
    """Return the columns to write to a tile, a value for each of its points."""
    separation = found.tile.separation
    classes = separation.classification
    out: dict[str, NDArray[Any]] = {name: np.zeros(len(classes), kind) for name, (kind, _) in DIMENSIONS.items()}
    for column, values in zip(out.values(), (found.code, found.probability, found.number), strict=True):
        column[separation.other] = values
    return {"classification": classes, **out}


@dataclass(frozen=True)
class TileObjects:
    """Objects found in one tile.

    Parameters
    ----------
    name : str
        Name of the tile.
    points : int
        Number of points of the tile.
    objects : list of FoundObject
        Objects of the tile, with centres in its coordinates.
    clusters_left_out, points_left_out : int
        Number of clusters that are too unlikely to be objects, and number of their points.
    seconds : float
        Processing time.
    crs : Crs
        Coordinate reference system of the tile.
    """

    name: str
    points: int
    objects: list[FoundObject]
    clusters_left_out: int
    points_left_out: int
    seconds: float
    crs: Crs = field(default_factory=Crs)

    @classmethod
    def of(cls, name: str, found: ClassifiedPoints, seconds: float, crs: Crs) -> Self:
        """Return the objects of a classified tile."""
        left_out = found.left_out
        clusters, points = int(left_out.max(initial=0)), int(np.count_nonzero(left_out))
        size = len(found.tile.separation.classification)
        objects = [one.placed(crs.unit_m) for one in found.objects]
        return cls(name, size, objects, clusters, points, seconds, crs)

    def as_dict(self) -> dict[str, Any]:
        """Return the objects as JSON-compatible data."""
        return {
            "tile": self.name,
            "objects": [{"class": one.name, **vars(one)} for one in self.objects],
            "clusters_left_out": self.clusters_left_out,
            "points_left_out": self.points_left_out,
        }

    def as_text(self, min_probability: float) -> str:
        """Return the objects in lines of at most 80 characters; positions are rounded to the metre."""
        counts = Counter(one.name for one in self.objects)
        found = ", ".join(f"{many:,} {kind}" for kind, many in counts.items()) or "no objects"
        lines = [f"{printable(self.name)}: {found}"]
        if self.objects:
            digits = len(str(len(self.objects)))
            head = (" " * digits + " class", "prob", "points", "x", "y", "length", "width", "height", "area")
            lines.append(table(head, [_cells(one, digits) for one in self.objects]))
        if self.clusters_left_out:
            points = count(self.points_left_out, "point")
            why = f"probability below {min_probability:g} (objects.min_probability)"
            lines.append(f"{count(self.clusters_left_out, 'cluster')} left out: {points}, {why}")
        lines.append(f"{count(self.points, 'point')} in {self.seconds:.1f} s")
        return "\n".join(lines)


def _cells(one: FoundObject, digits: int) -> tuple[str, ...]:
    lengths = (f"{value:.1f}" for value in (*one.size, one.height_m))
    center = (f"{value:.0f}" for value in one.center)
    label = f"{one.number:>{digits}} {one.name}"
    return (label, f"{one.probability:.2f}", f"{one.points:,}", *center, *lengths, f"{one.area_m2:,.0f}")


@dataclass(frozen=True)
class PredictResult(Result):
    """Objects found in several tiles.

    Parameters
    ----------
    tiles : list of TileObjects
        Objects of each tile.
    min_probability : float
        Clusters with a lower probability were left out.
    """

    tiles: list[TileObjects]
    min_probability: float

    def as_dict(self) -> list[dict[str, Any]]:
        """Return the objects as JSON-compatible data."""
        return [tile.as_dict() for tile in self.tiles]

    def as_text(self) -> str:
        """Return the objects as human-readable text."""
        return "\n".join(tile.as_text(self.min_probability) for tile in self.tiles)
