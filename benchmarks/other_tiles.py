"""Airborne tiles of an independent simulator, which shares no code, terrain or sensor with `simulation/airborne`.

`make(kind, seed)` returns a tile; a seed decides its sea, ground, sensor and intensities. `benchmarks/train_water.py`
trains with some seeds and reports figures for others.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.surface import GROUND, OTHER, WATER

VEGETATION, BUILDING = 5, 6
GRAVITY = 9.81
Map = NDArray[np.float64]


@dataclass
class World:
    """Ground, level of the water (minus infinity where there is none), canopy and solid tops by square metre."""

    ground: Map
    level: Map
    canopy: Map
    top: Map
    code: NDArray[np.uint8]

    @classmethod
    def of(cls, ground: Map, level: float | Map) -> "World":
        none = np.full(ground.shape, -np.inf)
        levels, code = np.broadcast_to(level, ground.shape).copy(), np.zeros(ground.shape, np.uint8)
        return cls(ground, levels, none.copy(), none, code)

    @property
    def dry(self) -> NDArray[np.bool_]:
        return self.ground > self.level


@dataclass(frozen=True)
class Sea:
    """Sum of sine waves of the spectrum of Pierson and Moskowitz, or near one length, around one or two directions."""

    height: Map
    number: Map
    along: Map
    phase: Map

    @classmethod
    def of(cls, rng: np.random.Generator, parts: list[tuple[float, float]]) -> "Sea":
        height, number, along = [], [], []
        narrow = rng.random() < 0.4
        for significant, length in parts:
            peak = np.sqrt(2 * np.pi * GRAVITY / length)
            omega = peak * (rng.normal(1, 0.05, 70) if narrow else rng.uniform(0.75, 2.2, 70))
            density = np.ones(70) if narrow else omega**-5 * np.exp(-1.25 * (peak / omega) ** 4)
            amplitude = np.sqrt(density) * rng.rayleigh(1, 70)
            height.append(amplitude * significant / 4 / np.sqrt((amplitude**2).sum() / 2))
            number.append(omega**2 / GRAVITY)
            along.append(rng.uniform(0, 2 * np.pi) + rng.normal(0, rng.uniform(0.1, 0.6), 70))
        size = 70 * len(parts)
        return cls(*(np.concatenate(one) for one in (height, number, along)), rng.uniform(0, 2 * np.pi, size))

    def at(self, x: Map, y: Map, time_s: float) -> Map:
        """Return the elevation on a coarse net of positions, as crests of second order."""
        total, steep = np.zeros(x.shape), np.zeros(x.shape)
        for a, k, way, phase in zip(self.height, self.number, self.along, self.phase, strict=True):
            angle = k * (np.cos(way) * x + np.sin(way) * y) - np.sqrt(GRAVITY * k) * time_s + phase
            total += a * np.cos(angle)
            steep += a * k * np.cos(angle)
        return total * (1 + 0.5 * np.clip(steep, -0.5, 0.5))


def noise(rng: np.random.Generator, shape: tuple[int, int], length: float, deviation: float) -> Map:
    """Return smooth noise of about one length."""
    white = np.fft.fft2(rng.standard_normal(shape))
    k = np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.fftfreq(shape[1]))
    field = np.fft.ifft2(white * np.exp(-((k * length) ** 2))).real
    return np.asarray(field * deviation / max(float(field.std()), 1e-9))


def _distance(rng: np.random.Generator, shape: tuple[int, int], ragged: float) -> Map:
    """Return the distance to a random line through the tile, positive on one side."""
    way, share = rng.uniform(0, 2 * np.pi), rng.uniform(0.25, 0.75)
    x, y = np.mgrid[: shape[0], : shape[1]] - np.array(shape)[:, None, None] / 2
    along = np.cos(way) * x + np.sin(way) * y
    return np.asarray(along - np.quantile(along, share) + noise(rng, shape, rng.uniform(20, 80), ragged))


def _plant(world: World, rng: np.random.Generator, share: float, low: float = 3, high: float = 18) -> None:
    """Put trees where a noise is high on dry ground."""
    if share <= 0:
        return
    where = noise(rng, world.ground.shape, rng.uniform(4, 25), 1)
    where = (where > np.quantile(where, 1 - share)) & world.dry & (world.code == 0)
    crown = rng.uniform(low, high) * (0.7 + 0.3 * noise(rng, world.ground.shape, 3, 0.5))
    world.canopy[where] = (world.ground + np.maximum(crown, 1.5))[where]


def _box(
    world: World, rng: np.random.Generator, size: tuple[float, float], height: float, code: int, *, wet: bool
) -> None:
    """Put a turned box at a random place on land or water."""
    where = np.argwhere(~world.dry if wet else world.dry)
    if not len(where):
        return
    (i, j), way = where[rng.integers(len(where))], rng.uniform(0, np.pi)
    reach = int(np.hypot(*size) / 2) + 2
    part = tuple(
        slice(max(at - reach, 0), min(at + reach, side)) for at, side in zip((i, j), world.code.shape, strict=True)
    )
    x, y = np.mgrid[part]
    u, v = (x - i) * np.cos(way) + (y - j) * np.sin(way), (y - j) * np.cos(way) - (x - i) * np.sin(way)
    inside = (np.abs(u) <= size[0] / 2) & (np.abs(v) <= size[1] / 2)
    base = world.level[i, j] if wet else world.ground[i, j]
    inside &= ~world.dry[part] if wet else world.dry[part]
    world.top[part] = np.where(inside, base + height, world.top[part])
    world.code[part][inside] = code


def _town(world: World, rng: np.random.Generator, density: float) -> None:
    for _ in range(int(density * world.dry.sum() / 400)):
        _box(world, rng, (rng.uniform(8, 30), rng.uniform(7, 16)), rng.uniform(3, 14), BUILDING, wet=False)


def _ships(world: World, rng: np.random.Generator, most: int) -> None:
    for _ in range(int(rng.integers(0, most + 1))):
        length = rng.uniform(5, 60)
        _box(world, rng, (length, max(2.5, length / rng.uniform(3, 6))), rng.uniform(0.7, 9), OTHER, wet=True)


def _open_sea(rng: np.random.Generator, shape: tuple[int, int]) -> World:
    world = World.of(np.full(shape, -20.0), 0.0)
    _ships(world, rng, 12)
    return world


def _beach(rng: np.random.Generator, shape: tuple[int, int]) -> World:
    distance = _distance(rng, shape, rng.uniform(0, 10))
    ground = np.minimum(distance * rng.uniform(0.01, 0.12), rng.uniform(1, 8))
    ground += noise(rng, shape, 30, 0.15) * (distance > 5)
    world = World.of(ground, 0.0)
    _plant(world, rng, rng.choice([0, 0.1, 0.4]))
    _town(world, rng, rng.choice([0, 0.05, 0.3]))
    _ships(world, rng, 6)
    return world


def _quay(rng: np.random.Generator, shape: tuple[int, int]) -> World:
    height = rng.uniform(0.5, 4)
    ground = np.where(_distance(rng, shape, 0) > 0, height + noise(rng, shape, 60, rng.uniform(0.01, 0.1)), -8.0)
    for _ in range(rng.integers(0, 3)):  # basins
        i, j = (int(rng.integers(0, side)) for side in shape)
        ground[i : i + int(rng.uniform(30, 120)), j : j + int(rng.uniform(30, 120))] = -8
    world = World.of(ground, 0.0)
    _town(world, rng, rng.choice([0, 0.2, 0.6]))
    _ships(world, rng, 8)
    return world


def _cliff(rng: np.random.Generator, shape: tuple[int, int]) -> World:
    inland = noise(rng, shape, rng.uniform(30, 120), rng.uniform(0.3, 4))
    ground = np.where(_distance(rng, shape, 6) > 0, rng.uniform(4, 30) + inland, -15.0)
    world = World.of(ground, 0.0)
    _plant(world, rng, rng.choice([0, 0.3, 0.8]))
    _ships(world, rng, 6)
    return world


def _polder(rng: np.random.Generator, shape: tuple[int, int]) -> World:
    distance = _distance(rng, shape, 0)
    crest, field = rng.uniform(1.5, 5), rng.choice([rng.uniform(-4, -0.4), rng.uniform(0.1, 1.4)])
    inside = np.maximum(crest - (distance - 3 * crest - 4) / 3, field)
    ground = np.minimum(np.minimum(distance / 3, crest), inside)
    ground += noise(rng, shape, rng.uniform(20, 120), rng.uniform(0.02, 0.12)) * (distance > 5)
    level: Map = np.where(distance > 3 * crest, -np.inf, 0.0)
    if rng.random() < 0.6:
        ditch = np.abs((np.arange(shape[1]) % int(rng.uniform(30, 90))) - 8) < rng.uniform(2, 6)
        wet = (distance > 7 * crest + 12) & ditch[None, :]
        ground[wet], level[wet] = field - 1.2, field - rng.uniform(0.4, 0.9)
    world = World.of(ground, level)
    _plant(world, rng, rng.choice([0, 0.03]))
    _town(world, rng, rng.choice([0, 0.03]))
    return world


def _island(rng: np.random.Generator, shape: tuple[int, int]) -> World:
    x, y = np.mgrid[: shape[0], : shape[1]]
    ground = np.full(shape, -6.0)
    for _ in range(rng.integers(1, 5)):
        place, radius = rng.uniform(0, 1, 2) * shape, rng.uniform(15, 120)
        far = radius - np.hypot(x - place[0], y - place[1]) + noise(rng, shape, 25, radius / 12)
        ground = np.maximum(ground, np.minimum(far * rng.uniform(0.02, 0.3), rng.uniform(0.5, 6)))
    world = World.of(ground + noise(rng, shape, 20, 0.05), 0.0)
    _plant(world, rng, rng.choice([0, 0.2, 0.6]))
    _ships(world, rng, 6)
    return world


def _flats(rng: np.random.Generator, shape: tuple[int, int]) -> World:
    ground = _distance(rng, shape, 20) * rng.uniform(0.002, 0.01) + noise(rng, shape, 40, 0.08)
    creek = np.abs(noise(rng, shape, 50, 1)) < rng.uniform(0.03, 0.12)
    return World.of(np.where(creek, np.minimum(ground, -0.6), ground), 0.0)


def _river(rng: np.random.Generator, shape: tuple[int, int]) -> World:
    plain = rng.uniform(0.6, 4) + noise(rng, shape, rng.uniform(40, 150), rng.uniform(0.05, 1.2))
    far = np.abs(_distance(rng, shape, rng.uniform(3, 25))) - rng.uniform(6, 60)
    world = World.of(np.maximum(np.minimum(plain, far * rng.uniform(0.1, 1.5)), -3), 0.0)
    _plant(world, rng, rng.choice([0, 0.15, 0.6]))
    _town(world, rng, rng.choice([0, 0.1, 0.5]))
    return world


def _lake(rng: np.random.Generator, shape: tuple[int, int]) -> World:
    hills = noise(rng, shape, rng.uniform(60, 160), rng.uniform(2, 15)) + noise(rng, shape, 15, 0.3)
    world = World.of(hills, float(np.quantile(hills, rng.uniform(0.08, 0.5))))
    _plant(world, rng, rng.choice([0.1, 0.5, 0.9]))
    return world


def _lock(rng: np.random.Generator, shape: tuple[int, int]) -> World:
    distance = _distance(rng, shape, 0)
    width, step = rng.uniform(4, 40), rng.uniform(0.25, 3)
    ground = np.where(np.abs(distance) < width / 2, step + rng.uniform(0.5, 3) + noise(rng, shape, 20, 0.05), -8.0)
    return World.of(ground, np.where(distance > 0, step, 0.0))


def _fields(rng: np.random.Generator, shape: tuple[int, int]) -> World:
    slope = np.mgrid[: shape[0], : shape[1]][int(rng.integers(2))] * rng.choice([0, rng.uniform(0, 0.01)])
    ground = noise(rng, shape, rng.uniform(40, 200), rng.uniform(0.03, 0.8)) + noise(rng, shape, 4, 0.03) + slope
    if rng.random() < 0.6:
        ground += 0.1 * np.sin(np.arange(shape[1]) / rng.uniform(0.5, 8))  # furrows
    world = World.of(ground, -np.inf)
    _plant(world, rng, rng.choice([0, 0, 0.03, 0.15]))
    _town(world, rng, rng.choice([0, 0, 0.05]))
    return world


def _hills(rng: np.random.Generator, shape: tuple[int, int]) -> World:
    ground = noise(rng, shape, rng.uniform(60, 200), rng.uniform(2, 25)) + noise(rng, shape, 12, rng.uniform(0.1, 0.6))
    world = World.of(ground, -np.inf)
    _plant(world, rng, rng.choice([0, 0.3, 0.9]))
    return world


def _street(rng: np.random.Generator, shape: tuple[int, int]) -> World:
    world = World.of(noise(rng, shape, 150, rng.uniform(0.05, 2)) + noise(rng, shape, 8, 0.02), -np.inf)
    _town(world, rng, rng.uniform(0.3, 1.5))
    _plant(world, rng, rng.choice([0, 0.1, 0.3]))
    return world


WORLDS: Mapping[str, Callable[[np.random.Generator, tuple[int, int]], World]] = {
    "open sea": _open_sea,
    "beach": _beach,
    "quay": _quay,
    "cliff": _cliff,
    "polder": _polder,
    "islands": _island,
    "flats": _flats,
    "river": _river,
    "lake": _lake,
    "lock": _lock,
    "fields": _fields,
    "hills": _hills,
    "town": _street,
}
STILL = ("river", "lake", "fields", "hills", "town")


def _sea(rng: np.random.Generator, kind: str) -> Sea:
    if kind in STILL or rng.random() < 0.2:
        return Sea.of(rng, [(rng.uniform(0.01, 0.12), rng.uniform(1.5, 6))])
    length = rng.uniform(8, 45)
    wind = (min(rng.uniform(0.15, 1.6), length / 18), length)
    swell = (rng.uniform(0.3, 1.6), rng.uniform(30, 110))
    return Sea.of(rng, [[wind], [swell, (0.15, 8)], [wind, swell]][rng.integers(3)])


def _pulses(rng: np.random.Generator, shape: tuple[int, int], across: int) -> list[tuple[Map, Map, Map, float]]:
    """Return position, tangent of the incidence and time of the pulses of each strip, or of each look of a cone."""
    density, height = rng.uniform(0.8, 6), rng.uniform(300, 1500)
    strips = int(rng.choice([1, 1, 2, 3]))
    width = shape[across] / strips * (1 + rng.choice([0.1, 0.4, 1.0]) * (strips > 1))
    found = []
    for number in range(strips):
        middle = shape[across] * (number + 0.5) / strips
        low, high = max(middle - width / 2, 0), min(middle + width / 2, shape[across])
        count = int(density * (high - low) * shape[1 - across])
        own = np.empty((2, count))
        if rng.random() < 0.5:
            own[across], own[1 - across] = rng.uniform(low, high, count), rng.uniform(0, shape[1 - across], count)
        else:  # lines
            step = 1 / np.sqrt(density)
            line, place = np.divmod(np.arange(count), max(int((high - low) / step), 1))
            own[across] = low + (place + 0.5) * step + rng.normal(0, 0.05, count)
            own[1 - across] = (line * step + rng.normal(0, 0.05, count)) % shape[1 - across]
        tangent = np.abs(own[across] - middle) / height * rng.choice([1, 3])
        inside = ((own >= 0) & (own < np.array(shape)[:, None])).all(axis=0)
        found.append((own[0][inside], own[1][inside], tangent[inside], number * rng.uniform(200, 900)))
    return found


def _reflected(rng: np.random.Generator, code: Map, tangent: Map, x: Map, y: Map, shape: tuple[int, int]) -> Map:
    """Return intensities before the sensor records them: speckle from facets of the water, texture of the ground."""
    size = len(code)
    slope = rng.uniform(0.08, 0.3)
    facets = rng.exponential(1, size) if rng.random() < 0.75 else rng.gamma(rng.uniform(2, 8), 0.3, size)
    water = rng.uniform(0.02, 0.5) * facets * np.exp(-((tangent / slope) ** 2))
    texture = np.exp(noise(rng, shape, rng.uniform(5, 60), rng.uniform(0.05, 0.5)))[x.astype(int), y.astype(int)]
    ground = rng.uniform(0.1, 0.5) * texture * rng.normal(1, rng.uniform(0.05, 0.25), size).clip(0.1)
    built = rng.uniform(0.1, 0.6) * rng.normal(1, 0.2, size).clip(0.1)
    return np.where(code == WATER, water, np.where(code == GROUND, ground, built))


def _recorded(rng: np.random.Generator, light: Map) -> Map | None:
    """Return intensities as one of several sensors records them; None if it does not."""
    form = rng.choice(["linear", "root", "log", "saturated", "constant", "none"], p=[0.5, 0.1, 0.05, 0.1, 0.1, 0.15])
    if form == "none":
        return None
    scaled = {
        "linear": 4000 * light,
        "root": 255 * np.sqrt(light.clip(0, 1)),
        "log": 40 * np.log1p(200 * light),
        "saturated": np.minimum(600 * light, 255),
        "constant": np.zeros(light.shape),
    }[form]
    return np.asarray(np.clip(scaled, 0, 65535))


def make(kind: str, seed: int, size: tuple[int, int] | None = None) -> dict[str, Any]:
    """Return a tile: ``xyz`` (3, N) in metres, LAS attributes (N,) and ``classification``, its truth."""
    rng = np.random.default_rng([seed, sorted(WORLDS).index(kind)])
    sides = rng.integers(160, 420, 2)
    shape = size or (int(sides[0]), int(sides[1]))
    world, sea = WORLDS[kind](rng, shape), _sea(rng, kind)
    drop = rng.choice([0, 0, rng.uniform(0.05, 0.3)])
    looks, tide = [], rng.choice([0, 0, 0.3])
    for strip, (x, y, tangent, time_s) in enumerate(_pulses(rng, shape, int(rng.integers(2)))):
        looks.append(_strip(rng, (world, sea), (x, y, tangent), time_s, (drop, tide * strip)))
        looks[-1]["point_source_id"] = np.full(len(looks[-1]["x"]), strip + 1, np.uint16)
    points = {name: np.concatenate([look[name] for look in looks]) for name in looks[0]}
    has_ids = rng.random() < 0.85
    out: dict[str, Any] = {"xyz": np.stack([points.pop(axis) for axis in "xyz"])}
    light = _reflected(rng, points["classification"], points.pop("tangent"), *out["xyz"][:2], shape)
    recorded = _recorded(rng, light)
    if recorded is not None:
        out["intensity"] = recorded.astype(np.uint16)
    out["xyz"][2] += rng.choice([0, 40, -30])
    if not has_ids:
        points.pop("point_source_id")
    if rng.random() < 0.2:
        points.pop("return_number"), points.pop("number_of_returns")
    return out | points


def _strip(
    rng: np.random.Generator,
    seen: tuple[World, Sea],
    rays: tuple[Map, Map, Map],
    time_s: float,
    flaws: tuple[float, float],
) -> dict[str, Any]:
    """Return the echoes of one strip: one or two for each pulse that comes back."""
    (world, sea), (drop, tide) = seen, flaws
    shape = world.ground.shape
    net = np.meshgrid(*(np.arange(side) for side in shape), indexing="ij")
    waves = sea.at(net[0], net[1], time_s).astype(np.float32)
    x, y, tangent = rays
    i, j = x.astype(int), y.astype(int)
    ground, level = world.ground[i, j], world.level[i, j] + waves[i, j] + tide
    wet = np.isfinite(level) & (level > ground) & (world.level[i, j] > -np.inf)
    z = np.where(wet, level + rng.normal(0, 0.02, len(x)), ground)
    code = np.where(wet, WATER, GROUND).astype(np.uint8)
    solid = world.code[i, j] > 0
    z = np.where(solid, np.maximum(world.top[i, j], z), z)
    code = np.where(solid, world.code[i, j], code)
    covered = np.isfinite(world.canopy[i, j]) & ~solid
    first = covered & (rng.random(len(x)) < 0.8)
    through = first & (rng.random(len(x)) < 0.35)
    back = ~wet | (rng.random(len(x)) < (1 - drop) * np.exp(-((tangent / rng.uniform(0.3, 2)) ** 2)))
    crown = world.canopy[i, j] - rng.exponential(0.6, len(x))
    leaf = np.where(covered, np.maximum(crown, ground + 0.5), 0)
    each = {"x": x, "y": y, "tangent": tangent}
    main = {**each, "z": np.where(first, leaf, z), "classification": np.where(first, VEGETATION, code)}
    main |= {"return_number": np.ones(len(x), np.uint8), "number_of_returns": 1 + through.astype(np.uint8)}
    every = {**each, "z": z, "classification": code}
    later = {name: values[through] for name, values in every.items()}
    later |= {name: np.full(through.sum(), 2, np.uint8) for name in ("return_number", "number_of_returns")}
    out = {name: np.concatenate((main[name][back], later[name])) for name in main}
    out["z"] = out["z"] + rng.normal(0, rng.uniform(0.01, 0.04), len(out["z"]))
    stray = rng.random(len(out["z"])) < rng.choice([0, 1e-4, 3e-3])
    out["z"][stray & (out["classification"] == WATER)] -= rng.uniform(0.5, 6)
    out["gps_time"] = time_s + out["x"] / 60
    out["classification"] = out["classification"].astype(np.uint8)
    return out
