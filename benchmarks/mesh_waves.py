"""Waves of `mesh_sea`: spectra, patches of random sea, and wakes."""

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from mesh_lidars import wrapped
from mesh_parts import Array, Random

GRAVITY = 9.81
Density = Callable[[Array, Array, Array], Array]  # of energy, by wave number, direction and frequency
World = dict[str, Any]


class Craft(Protocol):
    """What makes a wake."""

    @property
    def length(self) -> float: ...

    @property
    def beam(self) -> float: ...

    def path(self, time: float) -> tuple[float, float, float]: ...


def wind_sea(world: World) -> Density:
    """Return a TMA spectrum (Bouws et al. 1985) with the spreading of Donelan et al. (1985)."""
    wind, depth = max(world["wind"], 0.3), world["depth"]
    fetch = GRAVITY * world["fetch"] / wind**2
    peak = max(2 * np.pi * 3.5 * GRAVITY / wind * fetch**-0.33, 0.88 * GRAVITY / wind)
    alpha = min(0.076 * fetch**-0.22, 0.03)

    def density(k: Array, theta: Array, omega: Array) -> Array:
        w = np.maximum(omega, 1e-3)
        width = 2 * np.where(w < peak, 0.07, 0.09) ** 2
        energy = alpha * GRAVITY**2 * w**-5 * np.exp(-1.25 * (peak / w) ** 4)
        energy = energy * 3.3 ** np.exp(-((w / peak - 1) ** 2) / width)  # JONSWAP (Hasselmann et al. 1973)
        shallow = w * np.sqrt(depth / GRAVITY)
        energy *= np.where(shallow < 1, shallow**2 / 2, np.where(shallow < 2, 1 - (2 - shallow) ** 2 / 2, 1))
        r = w / peak
        beta = np.where(r < 0.95, 2.61 * np.maximum(r, 0.56) ** 1.3, np.where(r < 1.6, 2.28 * r**-1.3, 1.24))
        spread = 0.5 * beta / np.cosh(np.clip(beta * wrapped(theta - world["wind_to"]), -20, 20)) ** 2
        kh = np.minimum(k * depth, 20)
        speed = GRAVITY / (2 * w) * (np.tanh(kh) + kh / np.cosh(kh) ** 2)  # of groups
        return np.asarray(energy * spread * speed / k)

    return density


def swell(world: World) -> Density:
    peak, height, towards = 2 * np.pi / world["swell_s"], world["swell"], world["swell_to"]

    def density(k: Array, theta: Array, omega: Array) -> Array:
        w = np.maximum(omega, 1e-3)
        energy = np.exp(-0.5 * ((w - peak) / (0.09 * peak)) ** 2) / (0.09 * peak * np.sqrt(2 * np.pi))
        spread = np.exp(-0.5 * (wrapped(theta - towards) / 0.2) ** 2) / (0.2 * np.sqrt(2 * np.pi))
        return np.asarray((height / 4) ** 2 * energy * spread * GRAVITY / (2 * w) / k)

    return density


class Tile:
    """Periodic patch of a random sea, rotated by an angle, with crests of second order (Tayfun 1980)."""

    CELLS = 256

    def __init__(self, size: float, angle: float, density: Density, depth: float, rng: Random) -> None:
        self.per_m, self.cos, self.sin = self.CELLS / size, np.cos(angle), np.sin(angle)
        k = np.fft.fftfreq(self.CELLS, size / self.CELLS) * 2 * np.pi
        kx, ky = np.meshgrid(k, k, indexing="ij")
        k = np.hypot(kx, ky)
        k[0, 0] = 1e-6
        self.omega = np.sqrt(GRAVITY * k * np.tanh(np.minimum(k * depth, 20)))
        energy = density(k, np.arctan2(ky, kx) + angle, self.omega) * (2 * np.pi / size) ** 2
        energy[0, 0] = 0
        noise = rng.normal(size=(2, self.CELLS, self.CELLS))
        self.parts = (np.sqrt(energy) * (noise[0] + 1j * noise[1])).astype(np.complex64) * self.CELLS * self.CELLS
        self.sigma = float(np.sqrt(energy.sum()))
        self.k = float((energy * k).sum() / max(energy.sum(), 1e-12))

    def heights(self, time: float) -> Array:
        if self.sigma < 1e-4:
            return np.zeros((self.CELLS, self.CELLS), np.float32)
        a = np.fft.ifft2(self.parts * np.exp(-1j * (self.omega * time)).astype(np.complex64))
        return np.asarray(a.real + 0.5 * self.k * (a.real**2 - a.imag**2), np.float32)

    def slopes(self, heights: Array) -> tuple[Array, Array]:
        """Return the slopes in the axes of the world."""
        x, y = (
            (np.roll(heights, -1, axis) - np.roll(heights, 1, axis)) * np.float32(self.per_m / 2) for axis in (0, 1)
        )
        return self.cos * x - self.sin * y, self.sin * x + self.cos * y

    def place(self, x: Array, y: Array) -> tuple[Array, Array]:
        scale = np.float32(self.per_m)
        along, across = (self.cos * x + self.sin * y) * scale, (self.cos * y - self.sin * x) * scale
        return along.astype(np.float32), across.astype(np.float32)

    def cell(self, x: Array, y: Array) -> Array:
        """Return the numbers of the cells at some places."""
        row, column = (np.floor(each).astype(np.int32) % self.CELLS for each in self.place(x, y))
        return row * self.CELLS + column

    def between(self, values: Array, x: Array, y: Array) -> Array:
        """Return values, of which there is one for each cell, interpolated at some places."""
        u, v = self.place(x, y)
        row, column = np.floor(u), np.floor(v)
        u, v = u - row, v - column
        i, j = row.astype(np.int32), column.astype(np.int32)
        next_i, next_j = (i + 1) % self.CELLS * self.CELLS, (j + 1) % self.CELLS
        i, j = i % self.CELLS * self.CELLS, j % self.CELLS
        low = values.take(i + j) * (1 - v) + values.take(i + next_j) * v
        return np.asarray(low * (1 - u) + (values.take(next_i + j) * (1 - v) + values.take(next_i + next_j) * v) * u)


class Wake:
    """Waves (Kelvin 1887, Havelock 1908) and froth behind a craft, on a raster astern and to port of it."""

    CELL = 0.35

    def __init__(self, craft: Craft, speed: float, rate: float, waves_m: float, froth: tuple[float, float]) -> None:
        self.craft, self.speed, self.curve, (self.froth, self.life_s) = craft, speed, rate / speed, froth
        reach = min(90.0, max(40.0, 12 * craft.length))
        self.half = reach * 0.42
        theta = np.linspace(-1.5, 1.5, 241)
        k = GRAVITY / speed**2 * (1 / np.cos(theta)) ** 2
        weight = (1 / np.cos(theta)) ** 3 * np.exp(-0.5 * (k * max(0.1 * craft.length, 0.35)) ** 2) * (k < 5)
        x, y = np.arange(0, reach, self.CELL), np.arange(-self.half, self.half, self.CELL)
        field = np.exp(1j * np.outer(x, k * np.cos(theta))) * weight @ np.exp(1j * np.outer(k * np.sin(theta), y))
        ends = (1 - np.exp(-x / (0.3 * craft.length))) * np.minimum(1, (reach - x) / 15)
        arms = np.maximum(0, 1 - np.maximum(0, abs(y) - 0.36 * (x[:, None] + craft.length)) / 3)
        height = field.imag * ends[:, None]
        waves_m = min(waves_m, 0.12 * speed**2 / GRAVITY)  # no steeper than ka = 0.12
        self.field = (waves_m * height * arms / max(np.quantile(abs(height), 0.998), 1e-9)).astype(np.float32)
        self.go(0.0)

    def go(self, time: float) -> None:
        self.x, self.y, self.yaw = self.craft.path(time)

    def _local(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Return the distances astern of the bow, and to port of the track."""
        dx, dy = x - np.float32(self.x), y - np.float32(self.y)
        cos, sin = np.float32(np.cos(self.yaw)), np.float32(np.sin(self.yaw))
        astern = np.float32(self.craft.length / 2) - (cos * dx + sin * dy)
        return astern, cos * dy - sin * dx - np.float32(self.curve / 2) * astern**2

    def height(self, x: Array, y: Array) -> Array:
        a, b = self._local(x, y)
        i, j = (a / self.CELL).astype(np.int32), ((b + self.half) / self.CELL).astype(np.int32)
        inside = (a > 0) & (i < self.field.shape[0]) & (b > -self.half) & (j < self.field.shape[1])
        return np.where(inside, self.field[np.where(inside, i, 0), np.where(inside, j, 0)], 0)

    def foam(self, x: Array, y: Array) -> Array:
        """Return the covered share."""
        (a, b), length, beam = self._local(x, y), self.craft.length, self.craft.beam
        behind = a - np.float32(length * 0.95)
        age = np.maximum(behind, 0) / self.speed
        wide = 0.3 * beam * (1 + 0.35 * np.sqrt(age))
        core = self.froth * np.exp(-age / self.life_s) * np.exp(-((b / wide) ** 4)) * (behind > 0)
        edge = np.exp(-(((abs(b) - 0.45 * beam - 0.25 * np.maximum(a, 0)) / (0.15 + 0.05 * abs(a))) ** 2))
        bow = 0.8 * min(1, self.speed / 8) * edge * (a > 0.1 * length) * np.exp(-np.maximum(a, 0) / (1.3 * length))
        return np.maximum(core, bow)
