"""Parameters of the separation, and the surface that it compares points with."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Bytes, Floats, Mask
from seaclutter_cli.grids.elevation import Cells, GriddedPoints
from seaclutter_cli.grids.opening import SurfaceParams
from seaclutter_cli.params import Positive, key

NEVER, OTHER, GROUND, WATER = 0, 1, 2, 9
"""ASPRS classes: never classified (points without finite coordinates), unclassified, ground, water."""
CALM_M = 0.5
"""Greatest height above the opened surface that separates objects from calm water."""


@dataclass(frozen=True, kw_only=True)
class SeparationParams(SurfaceParams):
    """Parameters of the separation of a tile into sea and non-sea points."""

    height_m: Positive | Literal["auto"] = key(  # type: ignore[assignment]  # a frame is too small
        "auto",
        "A point higher than this above the opened surface is a non-sea point, as in [Shi2022]; auto: a height from "
        "the waves, 0.35 to 0.5 m on calm water, and a surface that follows them on rough water.",
    )
    island_m: Positive | None = key(
        2.0,
        "The opened surface is land where it rises more than this above the sea level, down to height_m above that "
        "level; null: it is sea, as in [Shi2022].",
    )
    land: Literal["keep", "class2", "ignore"] = key(
        "keep",
        "What low and flat land becomes: non-sea points; the same, with class 2 on the ground; or sea, as in "
        "[Shi2022].",
    )
    trust_classes: tuple[Literal[2, 9], ...] = key(
        (),
        "ASPRS classes of the input that are right: its ground (2), its water (9), or both. Points of these classes "
        "keep them, and tell land and water around them.",
    )

    @property
    def follows_waves(self) -> bool:
        """Whether the surface and the height follow the waves."""
        return self.height_m == "auto"

    @property
    def threshold_m(self) -> float:
        """Greatest height above the opened surface that separates objects from calm water."""
        return CALM_M if self.height_m == "auto" else self.height_m

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.island_m is not None and self.island_m < self.threshold_m:
            raise ValueError(f"island_m ({self.island_m:g}) must not be less than height_m ({self.threshold_m:g})")


@dataclass(frozen=True)
class Surface:
    """Surface of the sea, and what is no sea.

    ``elevation``, shape (S, 256, 256): elevation of the surface; ``limit``, shape (S, 256, 256): height above it over
    which a point of the cell is a non-sea point; ``land``, shape (S, 256, 256): cells of which all points are non-sea
    points; ``ground_top``, shape (S, 256, 256): elevation up to which points on land are ground; None: ground has no
    class of its own.
    """

    elevation: Cells
    limit: Cells | float
    land: Mask
    ground_top: Cells | None = None

    def heights(self, z: Floats, cell: NDArray[np.int32]) -> tuple[Cells, Cells]:
        """Return the heights of points above the surface, and the height over which each is a non-sea point."""
        limit = np.broadcast_to(self.limit, self.elevation.shape).reshape(-1)[cell]
        return z - self.elevation.reshape(-1)[cell], np.where(self.land.reshape(-1)[cell], -np.inf, limit)

    def classes(self, points: GriddedPoints) -> tuple[Bytes, NDArray[np.float32]]:
        """Return class and height of the points of the grid, both of shape (N,)."""
        classification, height = np.full(points.size, NEVER, np.uint8), np.full(points.size, np.nan, np.float32)
        for own, z, cell in points:
            above, limit = self.heights(z, cell)
            height[own] = above
            code = np.where(above > limit, np.uint8(OTHER), np.uint8(WATER))
            if self.ground_top is not None:
                code[self.land.reshape(-1)[cell] & (z <= self.ground_top.reshape(-1)[cell])] = GROUND
            classification[own] = code
        return classification, height
