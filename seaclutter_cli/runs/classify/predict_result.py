"""Named points and objects of tiles: for people and as data."""

from collections import Counter
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.classification import NamedPoints
from seaclutter_cli.airborne.objects import FoundObject
from seaclutter_cli.runs.recordings import Result
from seaclutter_cli.text import count, table

DIMENSIONS = {
    "predicted_class": ("u1", "0 none, 1 ship ... 8 garbage"),
    "probability": ("f4", "of the predicted class"),
    "predicted_object": ("u4", "number of the object, 0 none"),
}


def columns_of(named: NamedPoints) -> dict[str, NDArray[Any]]:
    """Return the columns that a tile is written with, a value for each of its points."""
    separation = named.tile.separation
    classes = separation.classification
    out: dict[str, NDArray[Any]] = {name: np.zeros(len(classes), kind) for name, (kind, _) in DIMENSIONS.items()}
    for column, values in zip(out.values(), (named.code, named.probability, named.number), strict=True):
        column[separation.other] = values
    return {"classification": classes, **out}


@dataclass(frozen=True)
class NamedTile:
    """The objects of one tile.

    Parameters
    ----------
    name : str
        Of the tile.
    points : int
        Points of the tile.
    objects : list of FoundObject
        The objects.
    clusters_left_out, points_left_out : int
        Clusters that are too unlikely to be objects, and their points.
    seconds : float
        How long it took.
    """

    name: str
    points: int
    objects: list[FoundObject]
    clusters_left_out: int
    points_left_out: int
    seconds: float

    @classmethod
    def of(cls, name: str, named: NamedPoints, seconds: float) -> Self:
        """Return the objects of a tile without its points."""
        left_out = named.left_out
        clusters, points = int(left_out.max(initial=0)), int(np.count_nonzero(left_out))
        return cls(name, len(named.tile.separation.classification), named.objects, clusters, points, seconds)

    def as_dict(self) -> dict[str, Any]:
        """Return the objects as JSON holds them."""
        return {
            "tile": self.name,
            "objects": [{"class": one.name, **vars(one)} for one in self.objects],
            "clusters_left_out": self.clusters_left_out,
            "points_left_out": self.points_left_out,
        }

    def as_text(self, min_probability: float) -> str:
        """Return the objects in lines of 80 characters: places to the metre, which the files have in full."""
        counts = Counter(one.name for one in self.objects)
        lines = [f"{self.name}: " + (", ".join(f"{many:,} {kind}" for kind, many in counts.items()) or "no objects")]
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
    place = (f"{value:.0f}" for value in one.center)
    named = f"{one.number:>{digits}} {one.name}"
    return (named, f"{one.probability:.2f}", f"{one.points:,}", *place, *lengths, f"{one.area_m2:,.0f}")


@dataclass(frozen=True)
class PredictResult(Result):
    """The objects of several tiles.

    Parameters
    ----------
    tiles : list of NamedTile
        One for each tile.
    min_probability : float
        Clusters that are less likely were left out.
    """

    tiles: list[NamedTile]
    min_probability: float

    def as_dict(self) -> list[dict[str, Any]]:
        """Return the objects as JSON holds them."""
        return [tile.as_dict() for tile in self.tiles]

    def as_text(self) -> str:
        """Return the objects as people read them."""
        return "\n".join(tile.as_text(self.min_probability) for tile in self.tiles)
