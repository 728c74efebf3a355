"""Scenes of airborne tiles: objects, water, lidar, and land: beaches, cliffs, polders, islands and basins."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Interval, Len

from seaclutter_cli import validation
from seaclutter_cli.arrays import Floats
from seaclutter_cli.errors import ConfigError
from seaclutter_cli.params import NotNegative, OneOf, Positive, Share, key
from seaclutter_cli.simulation.airborne.shapes import KINDS, Size
from seaclutter_cli.simulation.scene_file import KEYS, write_scene
from seaclutter_cli.sinks.atomic import OutputGroup
from seaclutter_cli.truth import OBJECT_CLASSES

Map = Floats
Side = Annotated[float, Interval(gt=0, le=10_000)]
Elevation = Annotated[float, Interval(ge=-20, le=200)]
Pair = Annotated[tuple[float, ...], Len(2, 2)]

DRY_M = -100.0
"""Level of the water where there is none, which is below all ground."""
DEEP_M = -30.0
_WALL_M = 2.5
_CREST_WIDTH_M, _DIKE_SLOPE = 4.0, 1 / 3
_TRIES = 4000
_MARGIN_M = 12.0
_ACROSS = 9


@dataclass(frozen=True, kw_only=True)
class TileParams:
    """Parameters of a tile."""

    description: str = key("", "Description of the scene.", formerly="about")
    size_m: Annotated[tuple[Annotated[float, Interval(ge=50, le=3000)], ...], Len(2, 2)] = key(
        (875.0, 695.0), "Extent along x and y."
    )
    origin_m: Pair = key((512_000.0, 3_458_000.0), "Corner in map coordinates.")
    seed: Annotated[int, Ge(0)] = key(1, "Seed of all random values.")
    gap_m: NotNegative = key(25.0, "Minimum gap around objects at random positions.")


@dataclass(frozen=True, kw_only=True)
class AirborneParams:
    """The lidar and its flight; flight lines run along x."""

    height_m: Annotated[float, Interval(ge=200, le=3000)] = key(500.0, "Flying height.")
    scan_angle_deg: Annotated[float, Interval(gt=0, le=60)] = key(
        50.0, "Full angle across the track; smaller if the tile is narrower than the swath."
    )
    overlap: Annotated[float, Interval(ge=0, le=0.8)] = key(0.15, "Share of a strip that the next one covers again.")
    pulses_m2: Annotated[float, Interval(gt=0, le=50)] = key(
        2.0, "Pulses per square metre and strip; scan lines are as close to each other as the pulses on them."
    )
    divergence_mrad: Annotated[float, Interval(gt=0, le=3)] = key(0.4, "Width of the beam.")
    max_returns: Annotated[int, Interval(ge=1, le=3)] = key(3, "Maximum number of echoes per pulse.")
    gain: Positive = key(8000.0, "Digital number of an echo of reflectivity 1 at normal incidence.")
    range_noise_m: NotNegative = key(0.03, "Standard deviation of the range.")


@dataclass(frozen=True, kw_only=True)
class WaterParams:
    """The water of a tile."""

    wave_m: Annotated[float, Interval(ge=0, le=3)] = key(0.1, "Significant wave height of the wind sea.")
    wave_period_s: Annotated[float, Interval(ge=1, le=10)] = key(2.2, "Peak period of the wind sea.")
    swell_m: Annotated[float, Interval(ge=0, le=5)] = key(0.25, "Significant wave height of the swell.")
    swell_period_s: Annotated[float, Interval(ge=5, le=20)] = key(8.0, "Peak period of the swell.")
    direction_deg: float = key(40.0, "Direction in which both travel, counter-clockwise from x.")
    reflectivity: Share = key(0.08, "Reflectivity of the surface at normal incidence.")
    stray_echo_share: Annotated[float, Interval(ge=0, le=0.1)] = key(
        0.00004, "Share of the echoes that are noise below or above the surface.", formerly="stray"
    )


@dataclass(frozen=True, kw_only=True)
class TileObjectParams:
    """An object in the water; values that are null are random."""

    kind: Annotated[str, OneOf("class", tuple(KINDS))] = key(meaning="Class.")
    position_m: Pair | None = key(None, "Centre, from the corner of the tile.", formerly="at_m")
    heading_deg: float | None = key(None, "Heading, counter-clockwise from x.")
    size_m: Annotated[tuple[Annotated[float, Interval(gt=0, le=3000)], ...], Len(3, 3)] | None = key(
        None, "Length, width and height."
    )
    reflectivity: Share | None = key(None, "Reflectivity at normal incidence.")


@dataclass(frozen=True)
class TileObject:
    """An object of a tile, numbered from 1, with its centre in metres from the corner and its heading in radians."""

    number: int
    kind: str
    position_m: tuple[float, float]
    heading: float
    size_m: Size
    reflectivity: float

    @property
    def code(self) -> int:
        """Class in the truth of a tile."""
        return OBJECT_CLASSES.index(self.kind) + 1


@dataclass(frozen=True, kw_only=True)
class LandParams:
    """Land, or water behind a wall; values that are null are those of the kind."""

    kind: Annotated[str, OneOf("kind of land", ("beach", "cliff", "polder", "island", "basin"))] = key(meaning="Kind.")
    position_m: Pair = key(meaning="Centre, from the corner of the tile.")
    size_m: Annotated[tuple[Side, ...], Len(2, 2)] = key(meaning="Length and width; both may go beyond the tile.")
    heading_deg: float = key(0.0, "Direction of the length, counter-clockwise from x.")
    height_m: Elevation | None = key(None, "Elevation of the ground above mean sea level, or of the water in a basin.")
    slope: Positive | None = key(
        None, "Rise per metre from the shore of a beach or island up to height_m, and of the bottom in front of it."
    )
    crest_m: Elevation | None = key(None, "Elevation of the dike around a polder, or of the wall around a basin.")
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
    return np.clip(relief.slope * distance, DEEP_M, relief.height_m), None


def _cliff(distance: Map, relief: Relief) -> tuple[Map, None]:
    return np.where(distance > 0, relief.height_m, DEEP_M), None


def _polder(distance: Map, relief: Relief) -> tuple[Map, float]:
    """Return level ground without water behind a dike, which slopes by one in three on both sides."""
    outside = _DIKE_SLOPE * distance
    inside = relief.crest_m - _DIKE_SLOPE * (distance - relief.crest_m / _DIKE_SLOPE - _CREST_WIDTH_M)
    return np.minimum(np.minimum(outside, relief.crest_m), np.maximum(inside, relief.height_m)), DRY_M


def _basin(distance: Map, relief: Relief) -> tuple[Map, float]:
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


@dataclass(frozen=True)
class TileScene:
    """A scene of an airborne tile."""

    tile: TileParams
    lidar: AirborneParams
    water: WaterParams
    objects: tuple[TileObjectParams, ...]
    land: tuple[LandParams, ...] = ()

    def with_tile(self, **changes: Any) -> "TileScene":
        """Return the scene with other values in the section ``tile``; None keeps a value."""
        return replace(self, tile=replace(self.tile, **{k: v for k, v in changes.items() if v is not None}))

    def placed_objects(self) -> list[TileObject]:
        """Return the objects, with random positions clear of all others and of the land.

        Raises `ConfigError` if there is no room for an object.
        """
        placed: list[TileObject] = []
        for index in sorted(range(len(self.objects)), key=lambda index: self.objects[index].position_m is None):
            placed.append(self._place(index, placed))
        return sorted(placed, key=lambda item: item.number)

    def _place(self, index: int, placed: list[TileObject]) -> TileObject:
        given, rng = self.objects[index], np.random.default_rng([self.tile.seed, 1, index])
        kind = KINDS[given.kind]
        share = rng.beta(1.2, 1.8, 3)  # favours small objects; length and width are correlated
        share[1] = np.clip(0.7 * share[0] + 0.3 * share[1], 0, 1)
        random_size = np.array(kind.smallest) + share * (np.array(kind.largest) - np.array(kind.smallest))
        length, width, height = given.size_m or random_size.tolist()
        size = (length, width, height)
        reflectivity = float(rng.uniform(*kind.reflectivities)) if given.reflectivity is None else given.reflectivity
        for _ in range(_TRIES):
            heading_deg = float(rng.uniform(0, 360)) if given.heading_deg is None else given.heading_deg
            heading = float(np.radians(heading_deg))
            reach = _MARGIN_M + np.asarray(_bounds(size, heading)) / 2
            position = given.position_m or tuple(
                rng.uniform(reach, np.maximum(np.array(self.tile.size_m) - reach, reach + 1e-6))
            )
            item = TileObject(index + 1, given.kind, position, heading, size, reflectivity)  # type: ignore[arg-type]
            alone = all(_apart(item, other, self.tile.gap_m) for other in placed)
            if given.position_m or (alone and self._is_afloat(item)):
                return item
        raise ConfigError(f"objects.{index}: no room for another {given.kind}; remove objects or enlarge the tile")

    def _is_afloat(self, item: TileObject) -> bool:
        """Return whether an object, and the gap around it, is clear of all land."""
        half = np.asarray(_bounds(item.size_m, item.heading)) / 2
        offset = np.linspace(-1, 1, _ACROSS)
        x, y = (at + side * offset for at, side in zip(item.position_m, half, strict=True))
        return all(float(one.distance(x[:, None], y).max()) < -self.tile.gap_m for one in self.land)

    @property
    def sections(self) -> Mapping[str, Any]:
        """Parameters of each section of a file, without objects."""
        return {"tile": self.tile, "lidar": self.lidar, "water": self.water}


def _bounds(size: Size, heading: float) -> tuple[float, float]:
    c, s = abs(np.cos(heading)), abs(np.sin(heading))
    return float(size[0] * c + size[1] * s), float(size[0] * s + size[1] * c)


def _apart(one: TileObject, other: TileObject, gap_m: float) -> bool:
    bounds = (_bounds(item.size_m, item.heading) for item in (one, other))
    sides = zip(one.position_m, other.position_m, *bounds, strict=True)
    return any(abs(a - b) > 0.5 * (u + v) + gap_m for a, b, u, v in sides)


_KINDS = {"tile": TileParams, "lidar": AirborneParams, "water": WaterParams}
_SECTIONS = (*_KINDS, "land", "objects", "random")


def builtin_tiles() -> Mapping[str, Path]:
    """Return the built-in tile scenes by name."""
    return validation.builtin_files("scenes/tiles")


def is_tile_scene(name: str) -> bool:
    """Return whether a name is that of a built-in tile scene, or of a file with a section ``tile``."""
    path = Path(name)
    return "tile" in validation.read_yaml(path, _SECTIONS) if path.exists() else name in builtin_tiles()


def load_tile_scene(name: str) -> TileScene:
    """Return the tile scene in a file, or a built-in one by its name; raises `ConfigError` with all problems."""
    path = validation.find_file(name, "scenes/tiles", "tile scene")
    return parse_tile_scene(validation.read_yaml(path, _SECTIONS), str(path))


def save_tile_scene(scene: TileScene, path: Path, group: OutputGroup | None = None) -> None:
    """Write a scene to a file for `load_tile_scene`, with default values and a comment for every key."""
    lists = {"land": (LandParams, scene.land), "objects": (TileObjectParams, scene.objects)}
    write_scene(path, group, scene.sections, lists)


def parse_tile_scene(raw: Mapping[str, Any], where: str) -> TileScene:
    """Return the scene that a mapping describes; error messages start with ``where``."""
    problems = [f"{key}: unknown section; allowed: {', '.join(_SECTIONS)}" for key in raw if key not in _SECTIONS]
    parts = validation.build_sections(_KINDS, raw, problems)
    listed = validation.build_list(TileObjectParams, raw.get("objects") or [], "objects", problems)
    objects = [*listed, *_random(raw.get("random") or {}, problems)]
    land = validation.build_list(LandParams, raw.get("land") or [], "land", problems)
    validation.raise_problems(where, problems, KEYS)
    return TileScene(**parts, objects=tuple(objects), land=tuple(land))


def _random(raw: Any, problems: list[str]) -> list[TileObjectParams]:
    raw = validation.sections_of({"random": raw}, ["random"], problems)["random"]
    problems += [f"random.{key}: unknown class; allowed: {', '.join(KINDS)}" for key in raw if key not in KINDS]
    wrong = [key for key, count in raw.items() if type(count) is not int or not 0 <= count <= 50]
    problems += [f"random.{key}: must be a whole number from 0 to 50" for key in wrong]
    # Large objects first, while there is room.
    order = [name for name in ("island", "fishing fence", "aquaculture", *KINDS) if name in raw and name not in wrong]
    return [TileObjectParams(kind=name) for name in dict.fromkeys(order) for _ in range(raw[name])]
