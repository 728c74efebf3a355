"""Features of points, the input of the classifier."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Interval

from seaclutter_cli.airborne.texture import TEXTURE, Levels, Neighborhoods, PointBlock, levels_of, texture
from seaclutter_cli.arrays import Floats
from seaclutter_cli.params import Positive, key

FEATURES = {
    "texture": TEXTURE,
    "full": (
        *TEXTURE,
        "height",
        "mean_height",
        "height_deviation",
        "density",
        "linearity",
        "planarity",
        "intensity",
        "intensity_deviation",
        "context_height",
        "context_height_deviation",
        "context_density",
    ),
}
"""Feature names by feature set."""


@dataclass(frozen=True, kw_only=True)
class FeatureParams:
    """Features of the non-sea points."""

    features: Literal["texture", "full"] = key(
        "full", "Texture only, or texture with height, density, shape and intensity of the neighbourhood."
    )
    radius_m: Positive = key(3.0, "Radius of the neighbourhood in the plane, r.")
    shift_m: Positive = key(1.0, "Shift of the cloud for its co-occurrence matrix, d.")
    levels: Annotated[int, Interval(ge=2, le=64)] = key(32, "Number of grey levels of height, K.")
    max_height_m: Positive = key(8.0, "Height above the sea at the upper bound of the last level.")
    context_m: Positive = key(10.0, "Radius of the wider surroundings.")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the features."""
        return FEATURES[self.features]


@dataclass(frozen=True)
class NonSeaPoints:
    """The N non-sea points of a tile.

    ``xy``, shape (2, N): horizontal coordinates in metres; ``height_m``, shape (N,): height above the sea surface;
    ``intensity``, shape (N,): intensity in the sensor's unit; 0 where there is none; ``points_per_m2``: density of the
    whole tile, sea included, over the cells with points; ``least_m``: height that makes a point one of them.
    """

    xy: Floats
    height_m: Floats
    intensity: Floats
    points_per_m2: float
    least_m: float = 0.5


def features_of(points: NonSeaPoints, params: FeatureParams) -> Floats:
    r"""Return the features of points, shape (N, F), in the order of ``params.names``.

    For the texture, see `texture`. The full set adds the height of the point and, over its neighbours within r: mean
    and standard deviation of the height; density relative to the whole tile, whose density depends on the flight;
    linearity and planarity, :math:`(l_1 - l_2) / l_1` and :math:`(l_2 - l_3) / l_1` for the eigenvalues
    :math:`l_1 \ge l_2 \ge l_3` of the covariance of the positions; mean and relative standard deviation of the
    intensity. The wider surroundings distinguish the shore of an island from a rock: mean and standard deviation of
    the height, and density, over the cells of width r / 2 whose centroid is within ``context_m`` of the centroid of
    the point's own cell.
    """
    if not len(points.height_m):
        return np.empty((0, len(params.names)))
    near = Neighborhoods(points.xy)
    levels = levels_of(near, points.height_m, params.levels, params.max_height_m, params.shift_m)
    if params.features == "texture":
        return near.apply(params.radius_m, lambda block: texture(block, levels))
    own = near.apply(params.radius_m, lambda block: _full(block, levels, points, params.radius_m))
    return np.hstack((own, _context(points, params)))


def _full(block: PointBlock, levels: Levels, points: NonSeaPoints, radius_m: float) -> Floats:
    count = block.count
    height, intensity = points.height_m[block.neighbor], points.intensity[block.neighbor]
    mean = block.total(height) / count
    brightness = block.total(intensity) / count
    spread = np.sqrt(block.total((intensity - brightness[block.own]) ** 2) / count)
    deviation = np.sqrt(block.total((height - mean[block.own]) ** 2) / count)
    columns = (
        points.height_m[block.points],
        mean,
        deviation,
        count / (np.pi * radius_m**2 * points.points_per_m2),
        *_shape(block, points),
        brightness,
        spread / np.maximum(brightness, 1e-9),
    )
    return np.column_stack((texture(block, levels), *columns))


def _context(points: NonSeaPoints, params: FeatureParams) -> Floats:
    """Return mean and deviation of the height, and relative density, of the wider surroundings, shape (N, 3)."""
    side = np.floor((points.xy - points.xy.min(axis=1, keepdims=True)) / (params.radius_m / 2)).astype(np.int64)
    _, which, count = np.unique(side[0] * (side[1].max() + 1) + side[1], return_inverse=True, return_counts=True)
    which = which.reshape(-1)
    x, y, height = (np.bincount(which, values) / count for values in (*points.xy, points.height_m))
    square = np.asarray(np.bincount(which, (points.height_m - height[which]) ** 2), np.float64)
    expected = np.pi * params.context_m**2 * points.points_per_m2

    def summed(block: PointBlock) -> Floats:
        weight = count[block.neighbor].astype(np.float64)
        total = block.total(weight)
        mean = block.total(weight * height[block.neighbor]) / total
        within = block.total(square[block.neighbor])
        between = block.total(weight * (height[block.neighbor] - mean[block.own]) ** 2)
        return np.column_stack((mean, np.sqrt((within + between) / total), total / expected))

    return Neighborhoods(np.stack((x, y))).apply(params.context_m, summed)[which]


def _shape(block: PointBlock, points: NonSeaPoints) -> tuple[Floats, Floats]:
    """Return linearity and planarity, shape (B,) each; 0 where all neighbours coincide."""
    center = block.points[block.own]
    offset = [axis[block.neighbor] - axis[center] for axis in (points.xy[0], points.xy[1], points.height_m)]
    count = block.count
    mean = [block.total(axis) / count for axis in offset]
    covariance = np.empty((len(block.points), 3, 3))
    for i in range(3):
        for j in range(i + 1):
            product = block.total(offset[i] * offset[j]) / count - mean[i] * mean[j]
            covariance[:, i, j] = covariance[:, j, i] = product
    least, middle, most = np.maximum(np.linalg.eigvalsh(covariance), 0).T
    scale = np.where(most > 0, most, 1)
    return (most - middle) / scale, (middle - least) / scale
