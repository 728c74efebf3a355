"""Land in tile scenes: beaches, cliffs, polders, islands, and basins with a level of their own."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from annotated_types import Interval, Len
from numpy.typing import NDArray

from seaclutter_cli.params import NotNegative, OneOf, Positive, Share, key

Map = NDArray[np.float64]
Side = Annotated[float, Interval(gt=0, le=10_000)]

DRY_M = -100.0
"""Level of the water where there is none, which is below all ground."""
DEEP_M = -30.0
_WALL_M = 2.5
_CREST_WIDTH_M, _DIKE_SLOPE = 4.0, 1 / 3


@dataclass(frozen=True, kw_only=True)
class LandParams:
    """Land, or water behind a wall; values that are null are those of the kind."""

    kind: Annotated[str, OneOf("kind of land", ("beach", "cliff", "polder", "island", "basin"))] = key(meaning="Kind.")
    position_m: Annotated[tuple[float, ...], Len(2, 2)] = key(meaning="Centre, from the corner of the tile.")
    size_m: Annotated[tuple[Side, ...], Len(2, 2)] = key(meaning="Length and width; both may go beyond the tile.")
    heading_deg: float = key(0.0, "Direction of the length, counter-clockwise from x.")
    height_m: Annotated[float, Interval(ge=-20, le=200)] | None = key(
        None, "Elevation of the ground above mean sea level, or of the water in a basin."
    )
    slope: Positive | None = key(
        None, "Rise per metre from the shore of a beach or island up to height_m, and of the bottom in front of it."
    )
    crest_m: Annotated[float, Interval(ge=-20, le=200)] | None = key(
        None, "Elevation of the dike around a polder, or of the wall around a basin."
    )
    relief_m: NotNegative | None = key(None, "Standard deviation of the undulation of the ground.")
    ragged_m: NotNegative | None = key(None, "Standard deviation of the position of the shoreline.")
    trees: Share | None = key(None, "Share of the ground under trees.")
    houses: Share | None = key(None, "Share of the plots of 30 m with a house.")
    reflectivity: Share | None = key(None, "Reflectivity of the ground at normal incidence.")

    @property
    def relief(self) -> "Relief":
        """Values of the land, those of its kind where they are null."""
        typical = LANDS[self.kind].typical
        return replace(typical, **{key: value for key in vars(typical) if (value := getattr(self, key)) is not None})

    def distance(self, x: Map, y: Map) -> Map:
        """Return how far positions are inside the outline, in metres; negative outside."""
        heading = np.radians(self.heading_deg)
        c, s = np.cos(heading), np.sin(heading)
        dx, dy = x - self.position_m[0], y - self.position_m[1]
        along, across = np.abs(c * dx + s * dy), np.abs(c * dy - s * dx)
        half = [side / 2 for side in self.size_m]
        if LANDS[self.kind].is_round:
            return np.asarray((1 - np.hypot(along / half[0], across / half[1])) * min(half))
        beyond = np.maximum(along - half[0], 0), np.maximum(across - half[1], 0)
        return np.asarray(np.minimum(half[0] - along, half[1] - across).clip(min=0) - np.hypot(*beyond))


@dataclass(frozen=True)
class Relief:
    """Values of a kind of land, as in `LandParams`."""

    height_m: float
    slope: float = 0.05
    crest_m: float = 5.0
    relief_m: float = 0.15
    ragged_m: float = 0.0
    trees: float = 0.0
    houses: float = 0.0
    reflectivity: float = 0.3


Profile = Callable[[Map, Relief], tuple[Map, Map | float | None]]
"""Returns the ground, and the level of the water inside if it is not the sea, from the distance to the shoreline."""


@dataclass(frozen=True)
class LandKind:
    """A kind of land: its meaning for the reference of keys, its ground and water, its values, and its outline."""

    meaning: str
    profile: Profile
    typical: Relief
    is_round: bool = False


def _beach(distance: Map, relief: Relief) -> tuple[Map, None]:
    """Return ground that rises evenly from below the water to its height."""
    return np.clip(relief.slope * distance, DEEP_M, relief.height_m), None


def _cliff(distance: Map, relief: Relief) -> tuple[Map, None]:
    """Return ground at its height from the shoreline on, above deep water."""
    return np.where(distance > 0, relief.height_m, DEEP_M), None


def _polder(distance: Map, relief: Relief) -> tuple[Map, float]:
    """Return level ground without water behind a dike, which slopes by one in three on both sides."""
    outside = _DIKE_SLOPE * distance
    inside = relief.crest_m - _DIKE_SLOPE * (distance - relief.crest_m / _DIKE_SLOPE - _CREST_WIDTH_M)
    return np.minimum(np.minimum(outside, relief.crest_m), np.maximum(inside, relief.height_m)), DRY_M


def _basin(distance: Map, relief: Relief) -> tuple[Map, float]:
    """Return a wall, and water at its own level inside."""
    return np.where((distance > 0) & (distance < _WALL_M), relief.crest_m, DEEP_M), relief.height_m


LANDS: Mapping[str, LandKind] = {
    "beach": LandKind(
        "ground that rises from the water, also below it",
        _beach,
        Relief(4.0, slope=0.03, ragged_m=8, trees=0.08, houses=0.03),
    ),
    "cliff": LandKind(
        "ground with a steep edge in deep water",
        _cliff,
        Relief(12.0, relief_m=0.5, ragged_m=4, trees=0.2, reflectivity=0.22),
    ),
    "polder": LandKind(
        "flat dry ground, also below the sea, behind a dike",
        _polder,
        Relief(0.3, relief_m=0.06, trees=0.02, houses=0.04, reflectivity=0.4),
    ),
    "island": LandKind(
        "a beach on all sides of an ellipse", _beach, Relief(2.5, slope=0.08, ragged_m=6, trees=0.1), is_round=True
    ),
    "basin": LandKind(
        "water with a level of its own behind a wall: a dock, a lock chamber, a lagoon",
        _basin,
        Relief(1.2, relief_m=0, crest_m=3.0, reflectivity=0.25),
    ),
}
"""Kinds of land by their names in scenes; to add one, add a line here and its name in `LandParams`."""
