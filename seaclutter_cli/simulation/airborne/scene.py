"""Scenes of airborne tiles: what lies where, the sea, and the lidar above it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Gt, Interval, Len

from seaclutter_cli.errors import ConfigError
from seaclutter_cli.simulation.airborne.shapes import KINDS, Size
from seaclutter_cli.truth import OBJECT_CLASSES
from seaclutter_cli.validation import (
    build_list,
    build_sections,
    builtin_files,
    find_file,
    kind_of,
    plain,
    raise_problems,
    read_yaml,
    renamed,
)

_TRIES = 4000
_MARGIN_M = 12.0


@dataclass(frozen=True, kw_only=True)
class TileParams:
    """The tile as such.

    Parameters
    ----------
    description : str
        What the scene shows.
    size_m : (float, float)
        Extent along x and y.
    origin_m : (float, float)
        Its corner, in the coordinates of a map.
    seed : int
        What all chance comes from.
    gap_m : float
        Water between objects placed by chance.
    """

    description: str = renamed("", formerly="about")
    size_m: Annotated[tuple[Annotated[float, Interval(ge=50, le=3000)], ...], Len(2, 2)] = (875.0, 695.0)
    origin_m: Annotated[tuple[float, ...], Len(2, 2)] = (512_000.0, 3_458_000.0)
    seed: Annotated[int, Ge(0)] = 1
    gap_m: Annotated[float, Ge(0)] = 25.0


@dataclass(frozen=True, kw_only=True)
class AirborneParams:
    """The lidar and its flight; lines run along x.

    Parameters
    ----------
    height_m : float
        Flying height.
    scan_angle_deg : float
        Full angle across the track; less where the tile is narrower than that.
    overlap : float
        Share of a strip that the next one covers again.
    pulses_m2 : float
        Pulses per square metre and strip, on lines as close as the pulses on them.
    divergence_mrad : float
        Width of the beam.
    max_returns : int
        Echoes of a pulse at most.
    gain : float
        Digital numbers for an echo of reflectivity 1, met head on.
    range_noise_m : float
        Standard deviation of ranges.
    """

    height_m: Annotated[float, Interval(ge=200, le=3000)] = 500.0
    scan_angle_deg: Annotated[float, Interval(gt=0, le=60)] = 50.0
    overlap: Annotated[float, Interval(ge=0, le=0.8)] = 0.15
    pulses_m2: Annotated[float, Interval(gt=0, le=50)] = 2.0
    divergence_mrad: Annotated[float, Interval(gt=0, le=3)] = 0.4
    max_returns: Annotated[int, Interval(ge=1, le=3)] = 3
    gain: Annotated[float, Gt(0)] = 8000.0
    range_noise_m: Annotated[float, Ge(0)] = 0.03


@dataclass(frozen=True, kw_only=True)
class WaterParams:
    """The water.

    Parameters
    ----------
    wave_m : float
        Significant height of the wind sea.
    wave_period_s : float
        Its peak period.
    swell_m : float
        Significant height of the swell.
    swell_period_s : float
        Its peak period.
    direction_deg : float
        Where both run to, counter-clockwise from x.
    reflectivity : float
        Of the surface, met head on.
    stray_echo_share : float
        Share of echoes from nothing, below and above the surface.
    """

    wave_m: Annotated[float, Interval(ge=0, le=3)] = 0.1
    wave_period_s: Annotated[float, Interval(ge=1, le=10)] = 2.2
    swell_m: Annotated[float, Interval(ge=0, le=5)] = 0.25
    swell_period_s: Annotated[float, Interval(ge=5, le=20)] = 8.0
    direction_deg: float = 40.0
    reflectivity: Annotated[float, Interval(ge=0, le=1)] = 0.08
    stray_echo_share: Annotated[float, Interval(ge=0, le=0.1)] = renamed(0.00004, formerly="stray")


@dataclass(frozen=True, kw_only=True)
class TileObjectParams:
    """Something in the water; what is left out, chance decides.

    Parameters
    ----------
    kind : str
        Its class.
    position_m : (float, float) or None
        Its middle, from the tile's corner.
    heading_deg : float or None
        Counter-clockwise from x.
    size_m : (float, float, float) or None
        Length, width and height.
    reflectivity : float or None
        Met head on.
    """

    kind: str
    position_m: Annotated[tuple[float, ...], Len(2, 2)] | None = renamed(None, formerly="at_m")
    heading_deg: float | None = None
    size_m: Annotated[tuple[Annotated[float, Gt(0)], ...], Len(3, 3)] | None = None
    reflectivity: Annotated[float, Interval(ge=0, le=1)] | None = None

    def __post_init__(self) -> None:
        """Check the class."""
        if self.kind not in KINDS:
            raise ValueError(f"kind: unknown class {self.kind!r}; allowed: {', '.join(KINDS)}")


@dataclass(frozen=True)
class TileObject:
    """An object with its place: number from 1, class, middle in metres from the corner, heading in radians, size."""

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


@dataclass(frozen=True)
class TileScene:
    """All of a scene."""

    tile: TileParams
    lidar: AirborneParams
    water: WaterParams
    objects: tuple[TileObjectParams, ...]

    def with_tile(self, **changes: Any) -> "TileScene":
        """Return the scene with other values in the section ``tile``; None leaves one as it is."""
        return replace(self, tile=replace(self.tile, **{k: v for k, v in changes.items() if v is not None}))

    def things(self) -> list[TileObject]:
        """Return the objects, each with a place clear of the others.

        Raises
        ------
        ConfigError
            If there is no room for one.
        """
        placed: list[TileObject] = []
        order = sorted(range(len(self.objects)), key=lambda at: self.objects[at].position_m is None)
        for at in order:
            placed.append(self._place(at, placed))
        return sorted(placed, key=lambda thing: thing.number)

    def _place(self, at: int, placed: list[TileObject]) -> TileObject:
        given, rng = self.objects[at], np.random.default_rng([self.tile.seed, 1, at])
        kind = KINDS[given.kind]
        share = rng.beta(1.2, 1.8, 3)  # rather small than large, length and width alike
        share[1] = np.clip(0.7 * share[0] + 0.3 * share[1], 0, 1)
        chance = np.array(kind.least) + share * (np.array(kind.most) - np.array(kind.least))
        length, width, height = given.size_m or chance.tolist()
        size = (length, width, height)
        shade = float(rng.uniform(*kind.shades)) if given.reflectivity is None else given.reflectivity
        for _ in range(_TRIES):
            heading = float(rng.uniform(0, 360)) if given.heading_deg is None else given.heading_deg
            reach = _MARGIN_M + np.asarray(_bounds(size, float(np.radians(heading)))) / 2
            place = given.position_m or tuple(
                rng.uniform(reach, np.maximum(np.array(self.tile.size_m) - reach, reach + 1e-6))
            )
            thing = TileObject(at + 1, given.kind, place, float(np.radians(heading)), size, shade)  # type: ignore[arg-type]
            if given.position_m or all(_apart(thing, other, self.tile.gap_m) for other in placed):
                return thing
        raise ConfigError(f"objects.{at}: no room for another {given.kind}; leave some out, or make the tile larger")

    def as_dict(self) -> dict[str, Any]:
        """Return the scene as it stands in a file, with all defaults."""
        sections = {name: plain(getattr(self, name)) for name in ("tile", "lidar", "water")}
        objects = [{key: value for key, value in plain(item).items() if value is not None} for item in self.objects]
        return {**sections, "objects": objects}


def _bounds(size: Size, heading: float) -> tuple[float, float]:
    """Return the extent along x and y of a turned rectangle."""
    c, s = abs(np.cos(heading)), abs(np.sin(heading))
    return float(size[0] * c + size[1] * s), float(size[0] * s + size[1] * c)


def _apart(one: TileObject, other: TileObject, gap_m: float) -> bool:
    sides = zip(
        one.position_m,
        other.position_m,
        _bounds(one.size_m, one.heading),
        _bounds(other.size_m, other.heading),
        strict=True,
    )
    return any(abs(a - b) > 0.5 * (u + v) + gap_m for a, b, u, v in sides)


_KINDS = {"tile": TileParams, "lidar": AirborneParams, "water": WaterParams}
_SECTIONS = (*_KINDS, "objects", "random")


def builtin_tiles() -> Mapping[str, Path]:
    """Return the tile scenes that come with the program by name."""
    return builtin_files("scenes/tiles")


def is_tile_scene(name: str) -> bool:
    """Whether a name is that of a built-in tile scene, or of a file with a section ``tile``."""
    path = Path(name)
    return "tile" in read_yaml(path, _SECTIONS) if path.exists() else name in builtin_tiles()


def load_tile_scene(name: str) -> TileScene:
    """Return a tile scene from a file, or a built-in one by its name; `ConfigError` with everything that is wrong."""
    path = find_file(name, "scenes/tiles", "tile scene")
    return parse_tile_scene(read_yaml(path, _SECTIONS), str(path))


def parse_tile_scene(raw: Mapping[str, Any], where: str) -> TileScene:
    """Return the scene that a mapping describes; ``where`` names it in errors."""
    problems = [f"{key}: unknown section; allowed: {', '.join(_SECTIONS)}" for key in raw if key not in _SECTIONS]
    parts = build_sections(_KINDS, raw, problems)
    listed = build_list(TileObjectParams, raw.get("objects") or [], "objects", "an object", problems)
    objects = [*listed, *_random(raw.get("random") or {}, problems)]
    raise_problems(where, problems)
    return TileScene(**parts, objects=tuple(objects))


def _random(raw: Any, problems: list[str]) -> list[TileObjectParams]:
    """Return so many objects of each class, all else left to chance."""
    if not isinstance(raw, dict):
        problems.append(f"random: must be a section with keys, is {kind_of(raw)}")
        return []
    problems += [f"random.{key}: unknown class; allowed: {', '.join(KINDS)}" for key in raw if key not in KINDS]
    wrong = [key for key, count in raw.items() if type(count) is not int or not 0 <= count <= 50]
    problems += [f"random.{key}: must be a whole number from 0 to 50" for key in wrong]
    # The large ones first, while there is room.
    order = [name for name in ("island", "fishing fence", "aquaculture", *KINDS) if name in raw and name not in wrong]
    return [TileObjectParams(kind=name) for name in dict.fromkeys(order) for _ in range(raw[name])]
