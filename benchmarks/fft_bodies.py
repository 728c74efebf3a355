"""Waves and bodies of `fft_sea`. Bodies consist of convex parts; rays meet these and the waves."""

from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Random = np.random.Generator
Pair = tuple[float, float]
Triple = tuple[float, float, float]

GRAVITY = 9.81
REACH_M = 110.0
"""Range up to which a surface of 10 % reflectivity is seen."""
FARTHEST_M = 130.0


class Source(IntEnum):
    """What sent a point back."""

    WATER = 0
    TARGET = 1
    FIXED = 2
    WAKE = 3
    FOAM = 4
    SPRAY = 5
    RAIN = 6
    GLINT = 7
    MIRROR = 8
    OWN = 9


def signal(rho: Any, cosine: Any, range_m: Array, reach_m: float = REACH_M) -> Array:
    """Return the power of echoes of diffuse surfaces, relative to the weakest that is seen."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(rho * cosine / 0.1 * (reach_m / range_m) ** 2)


def fade(range_m: Array) -> Array:
    """Return the factor by which intensities, partly corrected for range, fall with it."""
    return np.asarray(np.sqrt(np.minimum(1, 25 / range_m)))


def speckle(rng: Random, sigma: float, shape: Any) -> Array:
    """Return log-normal factors."""
    return np.asarray(np.exp(sigma * rng.normal(size=shape)))


def shifted(at: Sequence[Any], yaw: Any, ahead: Any, port: Any) -> tuple[Any, Any]:
    """Return the places ahead and to port of a place."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    return at[0] + cos * ahead - sin * port, at[1] + sin * ahead + cos * port


def rotation(roll: Any, pitch: Any, yaw: Any) -> Array:
    """Return matrices, shape (..., 3, 3), from body to world; bow up and port up are positive."""
    cr, sr, cp, sp, cy, sy = np.cos(roll), np.sin(roll), np.cos(-pitch), np.sin(-pitch), np.cos(yaw), np.sin(yaw)
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.stack([np.stack(row, -1) for row in rows], -2)


class Waves:
    """Periodic waves of a JONSWAP spectrum on a square, with sharpened crests."""

    CELLS = 512

    def __init__(  # noqa: PLR0913 - what makes a spectrum
        self,
        rng: Random,
        side_m: float,
        height_m: float,
        period_s: float,
        heading: float,
        *,
        spread: int = 6,
        sharp: float = 0.6,
    ) -> None:
        self.cell_m, self.sharp = side_m / self.CELLS, sharp
        line = 2 * np.pi * np.fft.fftfreq(self.CELLS, self.cell_m)
        kx, ky = np.meshgrid(line, line, indexing="ij")
        k = np.hypot(kx, ky)
        k[0, 0] = 1e-9
        self.omega = np.sqrt(GRAVITY * k)
        peak = 2 * np.pi / period_s
        density = self._jonswap(peak) * np.sqrt(GRAVITY / k) / 2 / k  # of frequency, to that of wave vectors
        density *= np.maximum(np.cos((np.arctan2(ky, kx) - heading) / 2), 0) ** (2 * spread)
        density *= np.exp(-((k * self.cell_m / 1.5) ** 2))
        self.amplitude = np.sqrt(density) * (rng.normal(size=k.shape) + 1j * rng.normal(size=k.shape))
        self.amplitude *= (height_m / 4) / max(np.fft.ifft2(self.amplitude).real.std(), 1e-12)
        self.peak_k, self.speed_ms = peak**2 / GRAVITY, GRAVITY / peak

    def _jonswap(self, peak: float) -> Array:
        omega, width = self.omega, np.where(self.omega <= peak, 0.07, 0.09)
        growth = np.exp(-((omega - peak) ** 2) / (2 * width**2 * peak**2))
        return np.asarray(omega**-5 * np.exp(-1.25 * (peak / omega) ** 4) * 3.3**growth)

    def update(self, time: float) -> None:
        h = np.fft.ifft2(self.amplitude * np.exp(-1j * self.omega * time)).real
        h = h + self.sharp * 0.5 * self.peak_k * (h * h - (h * h).mean())
        self.height = h.astype(np.float32)
        self.slopes = [
            ((np.roll(h, -1, axis) - np.roll(h, 1, axis)) / (2 * self.cell_m)).astype(np.float32) for axis in (0, 1)
        ]

    def nearest(self, x: Array, y: Array) -> Array:
        """Return heights without interpolation."""
        i = np.floor(x / self.cell_m + 0.5).astype(np.int32) % self.CELLS
        j = np.floor(y / self.cell_m + 0.5).astype(np.int32) % self.CELLS
        return np.asarray(self.height[i, j])

    def linear(self, f: Array, x: Array, y: Array) -> Array:
        """Return values of a raster, interpolated."""
        u, v = x / self.cell_m, y / self.cell_m
        i, j = np.floor(u), np.floor(v)
        a, b = u - i, v - j
        i, j = i.astype(np.int64) % self.CELLS, j.astype(np.int64) % self.CELLS
        i1, j1 = (i + 1) % self.CELLS, (j + 1) % self.CELLS
        return np.asarray((f[i, j] * (1 - a) + f[i1, j] * a) * (1 - b) + (f[i, j1] * (1 - a) + f[i1, j1] * a) * b)


class Sea:
    """Sum of waves at a time."""

    STEPS = 40

    def __init__(self, waves: Sequence[Waves]) -> None:
        self.waves = waves

    def update(self, time: float) -> None:
        for waves in self.waves:
            waves.update(time)
        self.top = sum(float(waves.height.max()) for waves in self.waves)
        self.low = sum(float(waves.height.min()) for waves in self.waves)

    def coarse(self, x: Array, y: Array) -> Any:
        return sum(waves.nearest(x, y) for waves in self.waves)

    def height(self, x: Array, y: Array) -> Any:
        return sum(waves.linear(waves.height, x, y) for waves in self.waves)

    def slope(self, x: Array, y: Array) -> tuple[Any, Any]:
        along_x, along_y = (sum(waves.linear(waves.slopes[axis], x, y) for waves in self.waves) for axis in (0, 1))
        return along_x, along_y

    def attitude(self, x: float, y: float, yaw: float, length: float, width: float) -> Triple:
        """Return the mean height, and the slopes ahead and to port, of the water under a body."""
        u, v = np.meshgrid(np.linspace(-0.5, 0.5, 7) * length, np.linspace(-0.5, 0.5, 5) * width, indexing="ij")
        h = self.height(*shifted((x, y), yaw, u, v))
        return h.mean(), (h * u).sum() / (u * u).sum(), (h * v).sum() / (v * v).sum()

    def cast(self, o: Array, d: Array) -> Array:
        """Return the range at which rays, shape (N, 3), first meet the sea; infinite if they do not."""
        start, stop = self._between_crests(o, d)
        near = np.flatnonzero(stop > start)
        rays, above, below, high, deep = self._bracket(o[near], d[near], start[near], stop[near])
        met = near[rays]
        for _ in range(3):  # regula falsi, kept from stalling at one end
            share = np.clip(high / np.where(high - deep == 0, 1, high - deep), 0.1, 0.9)
            t = above + share * (below - above)
            gap = self._gap(self.height, o[met], d[met], t)
            under = gap <= 0
            below, deep = np.where(under, t, below), np.where(under, gap, deep)
            above, high = np.where(under, above, t), np.where(under, high, gap)
        share = np.clip(high / np.where(high - deep == 0, 1, high - deep), 0, 1)
        range_m = np.full(len(d), np.inf)
        range_m[met] = above + share * (below - above)
        return range_m

    def _between_crests(self, o: Array, d: Array) -> tuple[Array, Array]:
        """Return the ranges between which rays are in the layer between the lowest trough and the highest crest."""
        level = np.abs(d[:, 2]) < 1e-9
        with np.errstate(divide="ignore", invalid="ignore"):
            top, low = (self.top + 0.01 - o[:, 2]) / d[:, 2], (self.low - 0.01 - o[:, 2]) / d[:, 2]
        start = np.where(level, 0.5, np.minimum(top, low))
        stop = np.where(level, FARTHEST_M, np.maximum(top, low))
        return np.maximum(start, 0.5), np.minimum(stop, FARTHEST_M)

    def _gap(self, height: Callable[[Array, Array], Any], o: Array, d: Array, t: Array) -> Array:
        """Return how far above the sea rays are."""
        return np.asarray(o[:, 2] + t * d[:, 2] - height(o[:, 0] + t * d[:, 0], o[:, 1] + t * d[:, 1]))

    def _bracket(self, o: Array, d: Array, start: Array, stop: Array) -> list[Array]:
        """Return the rays that enter the sea, their ranges before and behind that, and their heights above it there."""
        before, gap_before, live = start, self._gap(self.coarse, o, d, start), np.arange(len(d))
        entries = []
        for step in range(1, self.STEPS + 1):
            t = start[live] + (stop[live] - start[live]) * (step / self.STEPS)
            gap = self._gap(self.coarse, o[live], d[live], t)
            hit = gap <= 0
            entries.append((live[hit], before[hit], t[hit], gap_before[hit], gap[hit]))
            live, before, gap_before = live[~hit], t[~hit], gap[~hit]
        return [np.concatenate(column) for column in zip(*entries, strict=True)]


class Prism:
    """Upright prism over a convex outline, counter-clockwise."""

    def __init__(self, outline: Any, z: Pair, rho: float) -> None:
        p = np.asarray(outline, float)
        e = np.roll(p, -1, 0) - p
        sides = np.column_stack([e[:, 1], -e[:, 0], 0 * e[:, 0]]) / np.hypot(*e.T)[:, None]
        self.normals = np.vstack([sides, [0, 0, 1], [0, 0, -1]])
        self.offsets = np.append((sides[:, :2] * p).sum(1), [z[1], -z[0]])
        self.rho = rho
        self.vertices = np.array([[x, y, height] for x, y in p for height in (max(z[0], 0.0), z[1])])

    def cast(self, o: Array, d: Array) -> tuple[Array, Array]:
        """Return the range at which rays, shape (N, 3), enter, and the cosine of incidence there."""
        enter, leave, cosine = np.full(len(d), -np.inf), np.full(len(d), np.inf), np.zeros(len(d))
        for normal, offset in zip(self.normals, self.offsets, strict=True):
            speed, gap = d @ normal, offset - o @ normal
            with np.errstate(divide="ignore", invalid="ignore"):
                t = gap / speed
            later = (speed < 0) & (t > enter)
            enter, cosine = np.where(later, t, enter), np.where(later, -speed, cosine)
            leave = np.where(speed > 0, np.minimum(leave, t), leave)
            leave = np.where((speed == 0) & (gap < 0), -np.inf, leave)
        return np.where((enter < leave) & (enter > 0.3), enter, np.inf), cosine


class Ellipsoid:
    """Ellipsoid with axes along those of its body."""

    def __init__(self, center: Triple, axes: Triple, rho: float) -> None:
        self.center, self.axes, self.rho = np.array(center, float), np.array(axes, float), rho
        corners = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
        self.vertices = self.center + corners * self.axes
        self.vertices[:, 2] = np.maximum(self.vertices[:, 2], 0)

    def cast(self, o: Array, d: Array) -> tuple[Array, Array]:
        """Return the range at which rays, shape (N, 3), enter, and the cosine of incidence there."""
        at, ray = (o - self.center) / self.axes, d / self.axes
        a, b, c = (ray * ray).sum(1), (at * ray).sum(1), (at * at).sum(1) - 1
        q = b * b - a * c
        t = (-b - np.sqrt(np.maximum(q, 0))) / a
        normal = (at + t[:, None] * ray) / self.axes
        cosine = np.abs((normal * d).sum(1)) / np.maximum(np.linalg.norm(normal, axis=1), 1e-9)
        return np.where((q > 0) & (t > 0.3), t, np.inf), cosine


Part = Prism | Ellipsoid


def box(low: Triple, high: Triple, rho: float) -> Prism:
    (x0, y0, z0), (x1, y1, z1) = low, high
    return Prism([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], (z0, z1), rho)


def pillar(x: float, y: float, radius: float, z: Pair, rho: float) -> Prism:
    angle = np.arange(12) * 2 * np.pi / 12
    return Prism(np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)]), z, rho)


def hull(length: float, beam: float, z: Pair, rho: float) -> Prism:
    starboard = [(-length / 2, -beam / 2), (0.15 * length, -beam / 2), (0.38 * length, -0.3 * beam)]
    return Prism([*starboard, (length / 2, 0), *((x, -y) for x, y in reversed(starboard))], z, rho)


class Body:
    """Parts that move together at a constant velocity; the sea carries those that are not fixed."""

    def __init__(
        self,
        kind: str,
        parts: Sequence[Part],
        start: Any,
        yaw: float = 0.0,
        speed: float = 0.0,
        *,
        fixed: bool = False,
    ) -> None:
        self.kind, self.parts, self.fixed = kind, parts, fixed
        self.start, self.yaw, self.speed = np.array(start, float), yaw, speed
        self.vertices = np.vstack([part.vertices for part in parts])
        x, y = self.vertices[:, 0], self.vertices[:, 1]
        self.length, self.width, self.radius = np.ptp(x), np.ptp(y), np.hypot(np.abs(x).max(), np.abs(y).max())
        self.z, self.roll, self.pitch = 0.0, 0.0, 0.0

    def way(self, time: Any) -> tuple[Array, Array]:
        """Return places, shape (..., 2), and headings at times."""
        time = np.asarray(time, float)
        along = np.array([np.cos(self.yaw), np.sin(self.yaw)])
        return self.start + self.speed * time[..., None] * along, np.full(time.shape, self.yaw)

    def settle(self, sea: Sea, time: float) -> None:
        """Follow the water, unless fixed."""
        if not self.fixed:
            x, y = self.way(time)[0]
            self.z, ahead, port = sea.attitude(x, y, self.yaw, max(self.length, 0.4), max(self.width, 0.4))
            self.pitch, self.roll = 0.8 * np.arctan(ahead), 0.8 * np.arctan(port)


def ship(rng: Random) -> list[Part]:
    length, beam = rng.uniform(18, 35), rng.uniform(5, 7)
    board, rho = rng.uniform(1.5, 2.8), rng.uniform(0.1, 0.5)
    house = board + rng.uniform(2.5, 4.5)
    return [
        hull(length, beam, (-1.5, board), rho),
        box((-0.4 * length, -0.4 * beam, board), (-0.1 * length, 0.4 * beam, house), 0.6),
        pillar(-0.15 * length, 0, 0.15, (board + 2, board + 7), 0.4),
    ]


def speedboat(rng: Random) -> list[Part]:
    length = rng.uniform(5.5, 9)
    beam, rho = 0.32 * length, rng.uniform(0.15, 0.7)
    board, house = rng.uniform(0.7, 1.0), rng.uniform(1.5, 2.0)
    return [
        hull(length, beam, (-0.5, board), rho),
        box((-0.15 * length, -0.3 * beam, 0.6), (0.1 * length, 0.3 * beam, house), 0.4),
        pillar(-0.2 * length, 0.1, 0.22, (0.6, 1.7), 0.3),
    ]


def yacht(rng: Random) -> list[Part]:
    length = rng.uniform(8, 12)
    beam = 0.31 * length
    return [
        hull(length, beam, (-0.8, 1.0), rng.uniform(0.3, 0.7)),
        box((-0.2 * length, -0.3 * beam, 0.9), (0.15 * length, 0.3 * beam, 1.5), 0.6),
        pillar(0.08 * length, 0, 0.08, (0.8, 1.2 * length), 0.4),
    ]


def dinghy(rng: Random) -> list[Part]:
    return [hull(3.8, 1.5, (-0.2, 0.4), rng.uniform(0.15, 0.5)), pillar(-0.5, 0, 0.22, (0.1, 1.1), 0.3)]


def kayak(rng: Random) -> list[Part]:
    outline = [(-2.1, 0), (-0.8, -0.3), (0.8, -0.3), (2.1, 0), (0.8, 0.3), (-0.8, 0.3)]
    return [
        Prism(outline, (-0.1, 0.22), rng.uniform(0.2, 0.5)),
        pillar(-0.2, 0, 0.2, (0.1, 0.75), 0.25),
        Ellipsoid((-0.2, 0, 0.88), (0.11, 0.11, 0.14), 0.3),
    ]


def swimmer(_: Random) -> list[Part]:
    return [
        Ellipsoid((0, 0, 0.14), (0.11, 0.10, 0.15), 0.35),
        Ellipsoid((-0.25, 0, -0.02), (0.25, 0.22, 0.12), 0.3),
    ]


def buoy(rng: Random) -> list[Part]:
    if rng.random() < 0.5:
        return [Ellipsoid((0, 0, 0.12), (0.2, 0.2, 0.2), rng.uniform(0.2, 0.6))]
    return [pillar(0, 0, 0.2, (-0.2, 0.4), rng.uniform(0.2, 0.6))]


def navigation_buoy(rng: Random) -> list[Part]:
    size = rng.uniform(0.8, 1.2)
    return [
        pillar(0, 0, 0.9 * size, (-0.5, 0.6 * size), 0.4),
        pillar(0, 0, 0.3 * size, (0.5, 2.6 * size), 0.5),
        box((-0.3, -0.3, 2.5 * size), (0.3, 0.3, 3.0 * size), 0.7),
    ]


def pile(rng: Random) -> list[Part]:
    return [pillar(0, 0, rng.uniform(0.15, 0.3), (-2, rng.uniform(2, 3.5)), 0.25)]


KINDS: dict[str, Callable[[Random], list[Part]]] = {
    "ship": ship,
    "speedboat": speedboat,
    "yacht": yacht,
    "dinghy": dinghy,
    "kayak": kayak,
    "swimmer": swimmer,
    "buoy": buoy,
    "navbuoy": navigation_buoy,
}
