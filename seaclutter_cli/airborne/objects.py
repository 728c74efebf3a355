"""Objects from classified points: clusters with a class, a box and an area; and warnings of implausible ones."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from seaclutter_cli.airborne.features import NonSeaPoints
from seaclutter_cli.airborne.forest import class_name
from seaclutter_cli.airborne.map import IS_WATER, TileMap
from seaclutter_cli.airborne.separation import Separation
from seaclutter_cli.airborne.surface import OTHER, WATER
from seaclutter_cli.arrays import Floats, Ints
from seaclutter_cli.grids.cells import nearest
from seaclutter_cli.grids.elevation import sliced
from seaclutter_cli.params import Count, Positive, Share, key
from seaclutter_cli.text import count, share

_LEAST_SIDE_M, _AROUND_M = 0.1, 10.0
_TOP, _DOUBT, _STEEPNESS = 0.9, 1.75, 6.0
_MAX_SPREAD_M = 4.0
_MIN_SEA = 0.05
_MAX_OBJECT_M = 1.0
_MANY, _EXACT, _SAMPLE = 100, 0.5, 10_000
_LARGEST_SHIP_M = (460.0, 130.0, 80.0)  # length, width, height of the largest ever built, and a margin


@dataclass(frozen=True, kw_only=True)
class ObjectFindingParams:
    """Parameters of the search for objects."""

    tolerance_m: Positive = key(4.0, "Points closer than this in the plane belong to the same object.")
    min_points: Count = key(15, "Minimum number of points of an object.")
    min_probability: Share = key(
        0.4, "Classified clusters with a lower probability are left out; most of them are wave crests."
    )


@dataclass(frozen=True)
class FoundObject:
    """An object found in a tile.

    ``number``: number in the tile, from 1; ``code``: code of the class; None without a classification; ``probability``:
    how sure it is that this is an object: `likely_object`, times the mean probability of the class over the points if
    they are classified; ``points``: number of points; ``center``: centre of the box in metres; ``size``: length and
    width of the smallest enclosing rectangle in metres; ``yaw``: direction of the length in radians, counter-clockwise
    from x, from -pi/2 to pi/2; ``height_m``: height above the sea that one point in a hundred exceeds; ``area_m2``:
    area of the convex hull.
    """

    number: int
    code: int | None
    probability: float
    points: int
    center: tuple[float, float]
    size: tuple[float, float]
    yaw: float
    height_m: float
    area_m2: float

    @property
    def name(self) -> str:
        """Name of the class."""
        return "unclassified" if self.code is None else class_name(self.code)

    @property
    def attributes(self) -> dict[str, Any]:
        """Attributes in geodata: lengths in metres, the area in square metres; no class of unclassified objects."""
        return {
            "object": self.number,
            **({} if self.code is None else {"class": self.name}),
            "probability": round(self.probability, 3),
            "points": self.points,
            "height": round(self.height_m, 2),
            "area_m2": round(self.area_m2, 1),
        }

    def placed(self, unit_m: float) -> Self:
        """Return the object with its centre in another unit of length, given in metres."""
        return self if unit_m == 1 else replace(self, center=(self.center[0] / unit_m, self.center[1] / unit_m))

    def corners(self, unit_m: float = 1.0) -> Floats:
        """Return the corners of the box, shape (4, 2), counter-clockwise, in the unit of its centre, given in metres.

        Sides are at least ten centimetres long, so that collinear points have a valid outline.
        """
        size = np.maximum(self.size, _LEAST_SIDE_M)
        half = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * size / (2 * unit_m)
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return np.asarray(half @ np.array([[c, s], [-s, c]]) + self.center)


def find_objects(
    points: NonSeaPoints, probability: Floats, classes: Sequence[int], params: ObjectFindingParams
) -> tuple[list[FoundObject], Ints, Ints]:
    """Return the objects of a tile, and for each point the numbers of its object and of its left-out cluster.

    The numbers have shape (N,); 0 stands for no object, or for no cluster that was left out.

    ``points``: the N non-sea points; ``probability``, shape (N, C): probability of each class; ``classes``: codes of
    the C classes; ``params``: parameters of the search.

    The class of a point is its most probable one. The class of an object is the most frequent class of its points; in a
    tie, the first.
    """
    best_class = probability.argmax(axis=1) if len(probability) else np.empty(0, np.int64)
    found: list[FoundObject] = []
    numbers, left_out = np.zeros((2, points.xy.shape[1]), np.int64)
    for cluster, own in enumerate(_clusters(points.xy, params), 1):
        best = int(np.argmax(np.bincount(best_class[own], minlength=len(classes))))
        heights = points.height_m[own]
        likely = float(probability[own, best].mean()) * likely_object(heights, points.least_m)
        if likely >= params.min_probability:
            found.append(object_around(len(found) + 1, points.xy[:, own], heights, int(classes[best]), likely))
            numbers[own] = len(found)
        else:
            left_out[own] = cluster - len(found)
    return found, numbers, left_out


def _clusters(xy: Floats, params: ObjectFindingParams) -> list[Ints]:
    """Return the indices of the points, shape (2, N), of each cluster."""
    from seaclutter_cli.clustering import euclidean_clusters  # slow to import, not needed for settings

    flat = np.vstack((xy, np.zeros(xy.shape[1])))
    number = euclidean_clusters(flat, params.tolerance_m, params.min_points)
    order = np.argsort(number, kind="stable")
    return np.split(order, np.searchsorted(number[order], np.arange(number.max(initial=-1) + 1)))[1:]


def likely_object(height_m: Floats, least_m: float) -> float:
    """Return how likely points with these heights above the water around them, shape (N,), are an object, from 0 to 1.

    ``least_m`` is the height that makes a point one. Nine in ten of the points of a group of crests are lower than 1.75
    times that height; those of ships, reefs, mats and structures rise higher.
    """
    top = float(np.quantile(height_m, _TOP)) / least_m
    return float(1 / (1 + np.exp(-_STEEPNESS * (top - _DOUBT))))


def unclassified_objects(
    parts: Iterable[Floats], found: Separation, tile: TileMap, params: ObjectFindingParams
) -> list[FoundObject]:
    """Return the objects of a separated tile: clusters of its non-sea points off the land.

    ``parts`` are the coordinates of the points in metres, ``tile`` is its map. Heights of the separation are not used,
    as the output of an earlier run has none. They are above the mean elevation of the sea up to ten metres around the
    object, or in the tile where there is none; for the probability, above that of the nearest cell.
    """
    chosen = [np.empty((3, 0))]
    for part, xyz in sliced(parts):
        own = xyz[:, found.classification[part] == OTHER]
        chosen.append(own[:, ~found.land.contain(own[:2])])
    xyz, objects = np.concatenate(chosen, axis=1), list[FoundObject]()
    if not (tile.kind == IS_WATER).any():
        return objects
    for one, rows in enumerate(_clusters(xyz[:2], params), 1):
        own = xyz[:, rows]
        mean, level = _levels_around(tile, own)
        likely = likely_object(own[2] - level, found.sea.object_height_m)
        objects.append(object_around(one, own[:2], own[2] - mean, None, likely))
    return objects


def _levels_around(tile: TileMap, xyz: Floats) -> tuple[float, Floats]:
    """Return the mean elevation of the sea around the points of an object, and that of the cell nearest to each."""
    low, high = xyz[:2].min(axis=1) - _AROUND_M, xyz[:2].max(axis=1) + _AROUND_M
    first, last = (np.maximum(end // tile.cell_m - tile.first, 0).astype(np.int64) for end in (low, high))
    around = tile.level_m[first[0] : last[0] + 1, first[1] : last[1] + 1]
    known = np.isfinite(around)
    if not known.any():
        mean = float(tile.level_m[np.isfinite(tile.level_m)].mean(dtype=np.float64))
        return mean, np.full(xyz.shape[1], mean)
    place = np.stack(np.nonzero(known)) + (first + tile.first)[:, None] + 0.5
    level = around[known].astype(np.float64)
    return float(level.mean()), level[nearest(place * tile.cell_m, xyz[:2])]


def object_around(number: int, xy: Floats, height_m: Floats, code: int | None, probability: float) -> FoundObject:
    """Return the object of points with positions, shape (2, N), and heights, shape (N,), in metres."""
    center, size, yaw, area = smallest_rectangle(xy.T)
    top_m = float(np.quantile(height_m, 0.99))
    return FoundObject(number, code, probability, xy.shape[1], center, size, yaw, top_m, area)


def smallest_rectangle(xy: Floats) -> tuple[tuple[float, float], tuple[float, float], float, float]:
    """Return centre, size, direction and hull area of the smallest rectangle around points, shape (N, 2).

    One of its sides is on a side of the convex hull. Collinear points have a rectangle of width 0.

    Examples
    --------
    >>> center, size, yaw, area = smallest_rectangle(np.array([[0.0, 0], [4, 0], [4, 2], [0, 2], [1, 1]]))
    >>> center, size, yaw, area
    ((2.0, 1.0), (4.0, 2.0), 0.0, 8.0)
    """
    from scipy.spatial import ConvexHull, QhullError

    origin = xy.mean(axis=0)
    try:
        hull = ConvexHull(xy - origin)
        corners, area = (xy - origin)[hull.vertices], float(hull.volume)
    except (QhullError, ValueError):
        far = (xy - origin)[[np.argmin(xy @ [1.0, 1e-3]), np.argmax(xy @ [1.0, 1e-3])]]
        corners, area = far, 0.0
    sides = np.roll(corners, -1, axis=0) - corners
    angles = np.unique(np.arctan2(sides[:, 1], sides[:, 0]) % (np.pi / 2))
    c, s = np.cos(angles)[:, None], np.sin(angles)[:, None]
    along, across = c * corners[:, 0] + s * corners[:, 1], c * corners[:, 1] - s * corners[:, 0]
    spans = np.ptp(along, axis=1), np.ptp(across, axis=1)
    best = int(np.argmin(spans[0] * spans[1] + 1e-12 * (spans[0] + spans[1])))
    middle = [(axis[best].max() + axis[best].min()) / 2 for axis in (along, across)]
    c1, s1, yaw = float(c[best, 0]), float(s[best, 0]), float(angles[best])
    center = c1 * middle[0] - s1 * middle[1] + origin[0], s1 * middle[0] + c1 * middle[1] + origin[1]
    length, width = float(spans[0][best]), float(spans[1][best])
    if width > length:
        length, width, yaw = width, length, yaw - np.pi / 2
    return (float(center[0]), float(center[1])), (length, width), float(yaw), area


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
    """Return a line about ships that are larger than any, if there are some."""
    sizes = [(*one.size, one.height_m) for one in objects if one.name == "ship"]
    beyond = [size for size in sizes if np.greater(size, _LARGEST_SHIP_M).any()]
    if not beyond:
        return []
    largest = " by ".join(f"{value:.0f}" for value in max(beyond))
    problem = f"{count(len(beyond), 'ship')} of implausible size, up to {largest} m"
    return [f"{problem}; check that the tile is of the sea and that its unit is right"]
