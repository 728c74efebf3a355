"""Worlds of `facet_sea`: lidar, water, weather, own ship and all bodies, drawn for a family."""

import math
from typing import Any, NamedTuple

import numpy as np
from facet_bodies import (
    GRAVITY,
    KINDS,
    Array,
    Body,
    Ellipsoid,
    Part,
    Random,
    Sea,
    Shape,
    Span,
    Wake,
    box,
    log_uniform,
    pillar,
    rotation,
    unit,
)
from facet_lidars import Lidar
from scipy.special import ndtr
from scipy.stats import gamma

FAMILIES = [
    "wake", "swell", "chop", "port", "spray", "turning", "rainfog", "glint", "small", "mirrors", "sparse", "open",
]  # fmt: skip
SHELTERED = ("mirrors", "port")


HEIGHTS = {  # significant height of the waves in metres
    "wake": (0.05, 0.5), "swell": (1.0, 2.5), "chop": (0.35, 1.1), "port": (0.05, 0.2), "spray": (0.5, 1.8),
    "turning": (0.15, 1.4), "rainfog": (0.1, 1.2), "glint": (0.25, 0.9), "small": (0.08, 0.6), "mirrors": (0.05, 0.12),
    "sparse": (0.08, 1.0), "open": (0.1, 2.5),
}  # fmt: skip
FOAM = {"swell": 0.3, "chop": 1, "spray": 1.5, "glint": 0.6, "open": 1.0, "turning": 0.7, "wake": 0.3}  # else 0.4
BREAKERS = {"chop": 1, "spray": 2.0, "swell": 0.35, "glint": 0.4, "open": 0.8, "turning": 0.6}  # else 0.25
MENU = {
    "wake": ["speedboat", "speedboat", "rhib", "fishing", "yacht"],
    "swell": ["speedboat", "fishing", "sail", "buoy", "marker", "rhib", "ship", "kayak"],
    "chop": ["speedboat", "fishing", "sail", "buoy", "marker", "rhib", "kayak", "yacht"],
    "port": ["yacht", "sail", "pile", "pile", "buoy", "ship", "rhib", "kayak", "marker", "fishing"],
    "spray": ["speedboat", "fishing", "buoy", "marker", "sail", "rhib"],
    "turning": ["speedboat", "fishing", "sail", "buoy", "marker", "rhib", "yacht", "pile"],
    "rainfog": ["speedboat", "fishing", "sail", "buoy", "marker", "yacht", "pile"],
    "glint": ["speedboat", "fishing", "sail", "buoy", "rhib", "kayak"],
    "small": ["small_buoy", "small_buoy", "kayak", "swimmer", "buoy", "rhib", "pile"],
    "mirrors": ["sail", "pile", "yacht", "marker", "buoy", "fishing", "rhib", "ship", "kayak"],
    "sparse": ["speedboat", "fishing", "sail", "buoy", "marker", "rhib", "kayak", "yacht"],
}
DISTANCES: dict[str, Span] = {
    "swimmer": (5, 20), "small_buoy": (5, 28), "buoy": (6, 45), "kayak": (6, 40), "rhib": (7, 60), "pile": (6, 50),
    "marker": (10, 70), "speedboat": (9, 70), "fishing": (10, 75), "sail": (10, 75), "yacht": (16, 80),
    "ship": (30, 85),
}  # fmt: skip


class Texture:
    """Gamma-distributed mean of echoes of K distribution, over patches that move."""

    WAVES = 12

    def __init__(self, rng: Random, shape: float, lengths: Span, velocity: Array) -> None:
        k = 2 * np.pi / np.exp(rng.uniform(math.log(lengths[0]), math.log(lengths[1]), self.WAVES))
        towards = rng.uniform(0, 2 * np.pi, self.WAVES)
        self.k = np.c_[k * np.cos(towards), k * np.sin(towards)].astype(np.float32)
        self.omega = (self.k @ velocity + rng.normal(0, 0.6, self.WAVES)).astype(np.float32)
        self.phase = rng.uniform(0, 2 * np.pi, self.WAVES).astype(np.float32)
        self.share = np.linspace(0.0005, 0.9995, 1500)
        self.mean = gamma.ppf(self.share, shape) / shape

    def normal(self, x: Array, y: Array, time: float) -> Array:
        """Return a field of standard normal distribution."""
        phase = np.outer(x.astype(np.float32), self.k[:, 0]) + np.outer(y.astype(np.float32), self.k[:, 1])
        phase += self.phase - (self.omega * time).astype(np.float32)
        return np.asarray(np.cos(phase).sum(1) * math.sqrt(2 / self.WAVES))

    def at(self, x: Array, y: Array, time: float) -> Array:
        return np.asarray(np.interp(ndtr(self.normal(x, y, time)), self.share, self.mean))


def sea_and_wind(rng: Random, family: str) -> tuple[Sea, float]:
    height_m = log_uniform(rng, *HEIGHTS[family])
    if family == "swell" or (family == "open" and rng.random() < 0.3):
        period_s, spread, peak = rng.uniform(7, 12.5), rng.uniform(8, 30), rng.uniform(1, 5)
        wind_ms = rng.uniform(2, 10)
    else:
        steepness = log_uniform(rng, *((0.012, 0.03) if family in SHELTERED else (0.025, 0.055)))
        period_s = max(1.6, math.sqrt(2 * np.pi * height_m / GRAVITY / steepness))
        spread, peak = rng.uniform(1.5, 12), float(rng.choice([1.0, rng.uniform(1.5, 4)]))
        wind_ms = float(np.clip(math.sqrt(height_m * GRAVITY / 0.24) * rng.uniform(0.8, 1.4), 0.8, 16))
        if family in SHELTERED:
            wind_ms = rng.uniform(0.5, 3)
        if family in ("chop", "spray", "glint"):
            wind_ms = max(wind_ms, 5)
    return Sea(rng, height_m, period_s, spread, peak), wind_ms


class Water:
    """Sea, wind, and reflectivity of the water: such that it is seen up to a range."""

    def __init__(self, rng: Random, family: str, lidar: Lidar) -> None:
        self.sea, self.wind_ms = sea_and_wind(rng, family)
        self.heading = self.sea.heading + rng.normal(0, 0.4)
        self.wind = self.wind_ms * unit(self.heading)
        self.sheltered = family in SHELTERED
        self.slopes = 0.003 + 0.00512 * self.wind_ms  # mean square
        if self.sheltered:
            self.slopes *= rng.uniform(0.2, 0.6)
        far = 17 * (lidar.height_m / 1.2) ** 0.6 * log_uniform(rng, 0.7, 1.5) * (lidar.reach_m / 80) ** 0.35
        far *= (self.slopes / 0.03) ** 0.12
        far *= 0.75 if self.sheltered else 1
        far = float(np.clip(min(far, 0.55 * lidar.reach_m), 13, 80))
        self.exponent = rng.uniform(0.6, 1.3)
        shape = log_uniform(rng, *((0.1, 0.35) if family == "glint" else (0.15, 1.2)))
        self.looks, self.cover = rng.uniform(1, 4), log_uniform(rng, 0.12, 1.0)
        least = 0.1 * (far / lidar.reach_m) ** 2
        self.rho = least * 0.45 / (math.sin(math.atan(lidar.height_m / far)) ** self.exponent + 0.02)
        self.most = max(log_uniform(rng, 0.025, 0.07), 1.4 * 0.1 * (far / lidar.reach_m) ** 2)
        self.least = log_uniform(rng, 0.001, 0.006)
        drift = self.sea.along * self.sea.speed * (0.6 if family == "glint" else 0.3) + 0.02 * self.wind
        self.texture = Texture(rng, shape, (0.5, 6), drift)
        self.clumps = Texture(rng, rng.uniform(0.4, 1.2), (0.8, 5), 0.02 * self.wind)


class Weather:
    """Rain, fog, foam, breakers, spray, mirrored echoes and sunlight."""

    def __init__(self, rng: Random, family: str, water: Water) -> None:
        self.rain = self.fog = self.fog_m = 0.0
        self.extinction = 1e-4
        if family == "rainfog" or rng.random() < 0.06:
            self._rain_and_fog(rng, int(rng.integers(3)))
        wind_ms = water.wind_ms
        self.foam_rate = FOAM.get(family, 0.4) * 3.8e-6 * wind_ms**3.41 * log_uniform(rng, 0.4, 2.5)
        self.foam_life_s, self.foam_rho = rng.uniform(1.0, 6.0), rng.uniform(0.06, 0.24)
        self.break_rate = BREAKERS.get(family, 0.25) * (wind_ms > 4.5) * log_uniform(rng, 0.5, 3)
        self.sheets = family == "spray"
        self.bow_spray = self.sheets or (family in ("open", "chop", "turning") and rng.random() < 0.2)
        self.spray_rate = log_uniform(rng, 2, 10) if self.sheets else 0.5 * self.bow_spray
        self.spray_density = log_uniform(rng, 0.1, 0.9)
        mirror = {"mirrors": (0.5, 1.0), "port": (0.1, 0.9)}.get(family, (0, 0.6))
        self.mirror = rng.uniform(*mirror) if water.sheltered or water.sea.height_m < 0.2 else 0.0
        self.sun = log_uniform(rng, 2, 60) if family == "glint" and rng.random() < 0.6 else 0.0
        self.sun_rad = rng.uniform(-np.pi, np.pi)

    def _rain_and_fog(self, rng: Random, which: int) -> None:
        if which != 1:
            self.rain = log_uniform(rng, 0.001, 0.02)
            self.extinction += self.rain * 0.15
        if which != 0:
            sight_m = log_uniform(rng, 40, 600)
            self.fog = log_uniform(rng, 0.004, 0.12) * (200 / sight_m) ** 0.5
            self.extinction += 0.5 * 3.0 / sight_m
            self.fog_m = rng.uniform(4, 12)


class Own:
    """Own ship, which the waves lift, pitch and roll, and the lidar's place on it."""

    STEP_S = 0.005

    def __init__(self, rng: Random, family: str, sea: Sea, lidar: Lidar) -> None:
        self.turning, self.lidar = family == "turning", lidar
        speeds = {"port": (0, 2.5), "small": (0, 4), "mirrors": (0, 3)}.get(family, (0, 8))
        self.speed = 0.0 if rng.random() < 0.15 else rng.uniform(*speeds)
        rate = rng.uniform(10, 20) * rng.choice([-1, 1]) if self.turning else rng.normal(0, 0.8)
        roll = rng.uniform(6, 9) if self.turning else rng.uniform(0.2, 1.2) + 1.5 * sea.height_m * rng.uniform(0.3, 1)
        roll = roll if self.turning else min(5.0, roll)
        self.length = rng.uniform(4, 14)
        if self.turning:
            self.speed = max(self.speed, 1.0)
        self._steer(rng, math.radians(rate), roll)
        self._lean(rng, sea, rate, roll)
        roll, pitch = rng.normal(0, 1, 2) * math.radians(0.8)
        self.forward = rng.uniform(-1, 2)
        self.mount = 0.0
        if rng.random() >= 0.85:
            self.mount = float(rng.choice([np.pi / 2, np.pi, -np.pi / 2, rng.uniform(-0.4, 0.4)]))
        self.mounting = rotation(self.mount, pitch, roll)

    def _steer(self, rng: Random, rate: float, roll: float) -> None:
        """Set yaw and track."""
        seconds = self.lidar.seconds
        self.time = time = np.arange(-45, seconds + 1, self.STEP_S)
        rates = rate * (1 + 0.25 * np.sin(2 * np.pi * time / rng.uniform(3, 9) + rng.uniform(0, 6)))
        rates += math.radians(0.15 * roll) * np.sin(2 * np.pi * time / rng.uniform(2, 5))
        if self.turning and rng.random() < 0.3:
            rates *= np.sign(np.sin(2 * np.pi * time / rng.uniform(4, 8) + 1)) * 0.5 + 0.5
        self.yaw = np.cumsum(rates) * self.STEP_S
        self.yaw += rng.uniform(-np.pi, np.pi) - np.interp(0, time, self.yaw)
        self.track = np.cumsum(self.speed * np.c_[np.cos(self.yaw), np.sin(self.yaw)], 0) * self.STEP_S
        self.track -= self.track[np.searchsorted(time, seconds / 2)]

    def _lean(self, rng: Random, sea: Sea, rate: float, roll: float) -> None:
        """Set heave, pitch and roll."""
        self.slow = time = np.arange(-1, self.lidar.seconds + 1, 0.05)
        level = self._levels(sea)
        self.heave = level[:, 0]
        pitch = -np.arctan((level[:, 1] - level[:, 2]) / (0.7 * self.length)) * rng.uniform(0.6, 1)
        waves = np.arctan((level[:, 3] - level[:, 4]) / (0.3 * self.length)) * rng.uniform(0.5, 1.1)
        period = rng.uniform(2.5, 6)
        sway = math.radians(roll) * np.sin(2 * np.pi * time / period + rng.uniform(0, 6))
        sway = sway * (1 + 0.2 * np.sin(2 * np.pi * time / 11))
        if self.turning:
            sway += math.radians(2) * np.sign(rate)
            waves *= 0.3
        self.roll = np.clip(sway + waves, -0.2, 0.2)
        beat = math.radians(min(2, 0.25 * roll)) * np.sin(2 * np.pi * time / rng.uniform(2, 5))
        self.pitch = np.clip(pitch + beat, -0.2, 0.2)

    def _levels(self, sea: Sea) -> Array:
        """Return the heights of the water amidships, at bow, stern, port and starboard."""
        x, y = self.way(self.slow).T
        yaw, length, rows = np.interp(self.slow, self.time, self.yaw), self.length, []
        stations = (0.0, 0.0), (0.35 * length, 0.0), (-0.35 * length, 0.0), (0.0, 0.15 * length), (0.0, -0.15 * length)
        for at_x, at_y, time, turned in zip(x, y, self.slow, yaw, strict=True):
            cos, sin = math.cos(turned), math.sin(turned)
            places = [(at_x + a * cos - b * sin, at_y + a * sin + b * cos) for a, b in stations]
            rows.append([sea.height(*place, time, length_m=length) for place in places])
        return np.array(rows)

    def way(self, time: Any) -> Array:
        """Return places, shape (T, 2)."""
        return np.column_stack([np.interp(time, self.time, self.track[:, axis]) for axis in (0, 1)])

    def heading(self, time: float) -> float:
        return float(np.interp(time, self.time, self.yaw))

    def pose(self, time: Any) -> tuple[Array, Array]:
        """Return positions, shape (T, 3), and rotations, shape (T, 3, 3), of the lidar."""
        time = np.atleast_1d(np.asarray(time, float))
        pitch, roll = np.interp(time, self.slow, self.pitch), np.interp(time, self.slow, self.roll)
        turn = rotation(np.interp(time, self.time, self.yaw), pitch, roll)
        place = np.c_[self.way(time), np.interp(time, self.slow, self.heave)]
        return place + turn @ np.array([self.forward, 0, self.lidar.height_m]), turn @ self.mounting


QUAY_M = 6.0  # width


class Quay(NamedTuple):
    """Quay and what is on it; its inner face is at y = 0, its body at the side away from own ship."""

    parts: list[Part]
    at: Array
    heading: float
    half: float
    height_m: float
    side: int

    @property
    def turn(self) -> Array:
        return rotation(self.heading)

    def local(self, places: Array) -> Array:
        return np.asarray((places - self.at[:2]) @ self.turn[:2, :2])


def across(side: int, inner: float) -> Span:
    """Return the extent in y of a quay from an inner face; it is away from own ship."""
    return (inner, QUAY_M) if side > 0 else (-QUAY_M, -inner)


class Bird(NamedTuple):
    at: Array
    velocity: Array
    height_m: float

    def place(self, time: float) -> Array:
        """Return its place at a time from the middle of the log."""
        return np.append(self.at + self.velocity * time, self.height_m)


class World:
    """All that is drawn before the first frame."""

    def __init__(self, family: str, seed: int) -> None:
        rng = np.random.default_rng([FAMILIES.index(family), seed, 4711])
        self.rng, self.family, self.lidar = rng, family, Lidar(rng, family)
        self.water = Water(rng, family, self.lidar)
        self.sea, self.weather = self.water.sea, Weather(rng, family, self.water)
        self.own = Own(rng, family, self.sea, self.lidar)
        self.lidar.aim(rng)
        self.skewed, self.dual = rng.random() < 0.5, rng.random() < 0.15
        self.imu = rng.random() < (0.6 if family == "turning" else 0.45)
        self.deck = deck(rng, self.lidar.height_m) if rng.random() < 0.6 else []
        self.times = np.linspace(0, self.lidar.seconds, 25)
        self.track = self.own.way(self.times)
        self.middle = self.track[12]
        number = self._number()
        self.quays = list(self._quays())
        self.bodies: list[Body] = []
        for index in range(number):
            self._add(leader=family == "wake" and index == 0)
        self.own_wake: Wake | None = None
        if self.own.speed > 1.5 and rng.random() < 0.45:
            self.own_wake = Wake(rng, rng.uniform(1.5, 3.5), self.own.speed, strong=False)
        self.passed = self._passed() if family == "open" and rng.random() < 0.35 else None
        self.birds: list[Bird] = []
        if rng.random() < 0.12 or (family == "open" and rng.random() < 0.2):
            self.birds = [self._bird() for _ in range(int(rng.integers(1, 5)))]

    def least(self, range_m: Array) -> Array:
        """Return the least reflectivity that is seen at ranges."""
        least = np.maximum(self.water.least, 0.1 * (range_m / self.lidar.reach_m) ** 2)
        return np.asarray(least * np.exp(2 * self.weather.extinction * range_m))

    def _number(self) -> int:
        """Return the number of targets."""
        if self.family == "open":
            return 0
        ends = {"wake": (1, 4), "port": (3, 9), "small": (3, 9), "mirrors": (3, 9)}.get(self.family, (1, 7))
        return int(self.rng.integers(*ends))

    def _quays(self) -> list[Quay]:
        """Return quays beside own ship, which keeps clear of them."""
        rng, quays = self.rng, list[Quay]()
        if self.family != "port" and not (self.family == "mirrors" and rng.random() < 0.5):
            return quays
        for side in rng.permutation([1, -1])[: int(rng.integers(1, 3))]:
            quay = self._quay(int(side))
            away = quay.local(self.track)
            beside = (np.abs(away[:, 0]) < quay.half + 6).any() and (away[:, 1] * side > -6).any()
            if not beside and all(np.linalg.norm(other.at - quay.at) >= 20 for other in quays):
                quays.append(quay)
        return quays

    def _quay(self, side: int) -> Quay:
        rng, course = self.rng, self.own.heading(self.lidar.seconds / 2)
        distance = rng.uniform(12, 45)
        heading = course + rng.uniform(-0.25, 0.25)
        at = self.middle + side * distance * np.array([-math.sin(course), math.cos(course)])
        top = rng.uniform(0.5, 3.0)
        half = rng.uniform(25, 70)
        parts: list[Part] = [box((-half, half), across(side, 0), (-3, top), log_uniform(rng, 0.06, 0.35))]
        for _ in range(int(rng.integers(0, 7))):
            x = rng.uniform(-half + 3, half - 3)
            ends = x - rng.uniform(0.3, 2.5), x + rng.uniform(0.3, 2.5)
            y, z = (side * 1.5 - 0.7, side * 1.5 + 0.7), (top, top + rng.uniform(0.5, 2.6))
            parts.append(box(ends, y, z, log_uniform(rng, 0.1, 0.6)))
        return Quay(parts, np.append(at, 0.0), heading, half, top, side)

    def _add(self, *, leader: bool) -> None:
        """Add a target, if one of 80 is clear of the others."""
        for _ in range(80):
            body = self._target(leader=leader)
            if self._clear(body):
                break
        else:
            return
        rng, afloat = self.rng, body.kind != "pile" and not body.moored
        body.sway = math.radians(rng.uniform(0.5, 4)) if afloat else 0.003
        body.sway *= 0.3 if body.kind in ("ship", "yacht") else 1
        body.sway_s, body.sway_phase = rng.uniform(1.5, 5), rng.uniform(0, 6)
        if body.speed > 5 and body.kind in ("speedboat", "rhib"):
            body.trim = -math.radians(rng.uniform(1, 4))
        if body.speed > 1.2:
            body.wake = Wake(rng, body.shape.beam, body.speed, strong=leader)
        self.bodies.append(body)

    def _target(self, *, leader: bool) -> Body:
        """Return a target at the middle of the log; the leader makes the strong wake of its family."""
        rng, family = self.rng, self.family
        kind = str(rng.choice(MENU[family]))
        low, high = DISTANCES[kind]
        high = max(min(high, self.lidar.reach_m * 0.95), low + 4)
        if self.lidar.beams <= 32:
            high = low + (high - low) * 0.6
        if leader:
            kind, low, high = "speedboat" if rng.random() < 0.7 else "yacht", 9, 22
        shape = make(rng, kind)
        distance = low + (high - low) * rng.random() ** 0.8 + (shape.length / 3 if kind in ("yacht", "ship") else 0)
        bearing = rng.uniform(-np.pi, np.pi)
        at = self.middle + distance * unit(bearing)
        speed = rng.uniform(*shape.speeds) if rng.random() < 0.75 else shape.speeds[0]
        heading = rng.uniform(-np.pi, np.pi)
        turn = rng.normal(0, 0.03) if speed > 1 else 0.0
        if leader:
            speed, heading = rng.uniform(3, 11), bearing + rng.choice([-1, 1]) * rng.uniform(0.3, 1.2)
            turn = rng.normal(0, 0.02)
        if kind == "ship":
            speed = 0 if rng.random() < 0.7 else speed
            heading = bearing + np.pi / 2 + rng.normal(0, 0.3)
        if family in ("port", "small") and kind not in ("rhib", "kayak", "swimmer"):
            speed = 0
        name = "buoy" if kind == "small_buoy" else kind
        body = Body(name, shape, at, heading, speed, turn, self.lidar.seconds / 2)
        if family == "port" and self.quays and kind in ("yacht", "ship", "sail", "fishing") and rng.random() < 0.8:
            self._moor(body)
        return body

    def _moor(self, body: Body) -> None:
        rng = self.rng
        quay = self.quays[int(rng.integers(len(self.quays)))]
        x = rng.uniform(-quay.half, quay.half)
        y = -quay.side * (body.shape.beam / 2 + rng.uniform(0.8, 1.6))
        body.at, body.heading = (quay.at + quay.turn @ np.array([x, y, 0]))[:2], quay.heading
        body.moored, body.speed = True, 0

    def _clear(self, body: Body) -> bool:
        """Return whether a body is clear of own ship, of the other targets and of the quays."""
        way, (length, beam) = body.way(self.times), body.shape[1:3]
        distance = np.linalg.norm(way - self.track, axis=1).min()
        if distance < length / 2 + 4.5:
            return False
        beside = np.abs((self.track - way) @ unit(body.heading)).min() < length / 2
        if body.kind == "ship" and beside and distance < beam / 2 + 9:
            return False
        gap = beam / 2 + 0.6 if body.moored else length / 2 + 2.5
        for quay in self.quays:
            x, y = quay.local(way).T
            if ((np.abs(x) < quay.half + length) & (y * quay.side > -gap)).any():
                return False
        return all(
            np.linalg.norm(other.way(self.times) - way, axis=1).min() > (length + other.shape.length) / 2 + 3
            for other in self.bodies
        )

    def _passed(self) -> Body:
        """Return a boat that has passed, far away, of which the wake is seen."""
        rng = self.rng
        speed, turn, bearing = rng.uniform(4, 9), rng.normal(0, 0.02), rng.uniform(-3, 3)
        at = self.middle + rng.uniform(120, 170) * unit(bearing)
        boat = Body("boat", Shape([], 8.0, 2.8, (4, 9)), at, bearing + rng.normal(0, 0.15), speed, turn, 0.0)
        boat.wake = Wake(rng, 2.8, speed, strong=True)
        boat.wake.life_s, boat.wake.youngest_s = 25.0, 3.0
        return boat

    def _bird(self) -> Bird:
        rng = self.rng
        return Bird(self.middle + rng.uniform(-30, 30, 2), rng.normal(0, 5, 2), rng.uniform(2, 9))


def make(rng: Random, kind: str) -> Shape:
    """Return the shape of a body of a kind; some have a reflector."""
    shape = KINDS[kind](rng, log_uniform(rng, 0.06, 0.75))
    if kind != "swimmer" and rng.random() < 0.25:
        vertices = shape.parts[-1 if kind in ("pile", "buoy", "small_buoy") else 0].vertices
        at = vertices[:, 0].mean(), vertices[:, 1].mean(), vertices[:, 2].max()
        shape.parts.append(Ellipsoid(at, 0.12, rng.uniform(2, 10)))
    return shape


def deck(rng: Random, height_m: float) -> list[Part]:
    """Return own ship's deck and posts before the lidar, in its axes."""
    board = height_m - rng.uniform(0.4, 1.0) if height_m > 1.6 else rng.uniform(0.3, 0.7)
    length, width = rng.uniform(1, min(5, 1 + height_m * 0.9)), rng.uniform(0.5, 1.8)
    z = -height_m - 0.3, -height_m + max(0.25, board * 0.6)
    parts: list[Part] = [box((0.5, length), (-width / 2, width / 2), z, rng.uniform(0.15, 0.6), 0.2)]
    for _ in range(int(rng.integers(0, 5))):
        at = length * rng.uniform(0.5, 0.95), width * 0.45 * rng.choice([-1, 1])
        parts.append(pillar(at, 0.03, (-height_m + 0.2, -height_m + 0.6 * board + rng.uniform(0.4, 0.9)), 0.3))
    return parts
