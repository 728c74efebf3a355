"""The sea of `mesh_sea`: heights, slopes and foam of wind waves, swell, wakes and surf."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from mesh_parts import Array, Random
from mesh_waves import GRAVITY, Craft, Tile, Wake, World, swell, wind_sea

TEXELS = 512


def smoothed(scale: float, rng: Random) -> Array:
    """Return noise over so many texels."""
    k = np.fft.fftfreq(TEXELS)
    kept = np.exp(-2 * (np.pi * scale) ** 2 * (k[:, None] ** 2 + k**2))
    noise = np.fft.ifft2(np.fft.fft2(rng.normal(size=(TEXELS, TEXELS))) * kept).real
    return np.asarray(noise / np.sqrt(np.pi) * scale)


def texels(table: Array, x: Array, y: Array) -> Array:
    return np.asarray(table[np.floor(x).astype(np.int32) % TEXELS, np.floor(y).astype(np.int32) % TEXELS])


class Sea:
    """Water over the time of a frame; shares of it are between 0 and 1."""

    def __init__(self, world: World, rng: Random, wakes: Sequence[Wake]) -> None:
        self.world, self.wakes, self.wind = world, wakes, world["wind"]
        self.to = np.array([np.cos(world["wind_to"]), np.sin(world["wind_to"])])
        base, long, depth = wind_sea(world), swell(world), world["depth"]
        cut, fine = 2 * np.pi / 11.0, 2 * np.pi / 0.45
        self.small = Tile(38.0, 0.4, lambda k, a, w: base(k, a, w) * (k >= cut) * (k < fine), depth, rng)
        self.large = Tile(288.0, -0.3, lambda k, a, w: base(k, a, w) * (k < cut) + long(k, a, w), depth, rng)
        self.height_m = 4 * np.hypot(self.small.sigma, self.large.sigma)
        grains = [smoothed(scale, rng) for scale in (1.5, 6.0)]
        mixed = (grains[0] + 0.9 * grains[1]).ravel()
        self.grain = (np.argsort(np.argsort(mixed)) / mixed.size).reshape(TEXELS, TEXELS).astype(np.float32)
        soft = smoothed(25.0, rng)
        self.patch = np.exp(0.8 * soft / soft.std()).astype(np.float32)
        self._begin()

    def _begin(self) -> None:
        """Let waves break for nine seconds; whitecaps cover as much as Monahan and O'Muircheartaigh (1980) say."""
        cover = min(3.84e-6 * self.wind**3.41, 0.08) * self.world["caps"]
        self.breaking, self.froth = cover > 2e-4 and self.small.sigma > 0.01, np.zeros((256, 256), np.float32)
        if self.breaking:
            heights = self.small.heights(-9)
            front = self._front(heights, *self.small.slopes(heights))
            self.limit = np.quantile(front, 1 - min(0.25 * cover, 0.02))
            for time in np.arange(-9, 0, 0.25):
                heights = self.small.heights(time)
                self._break(self._front(heights, *self.small.slopes(heights)), 0.25)
        self.time, self.fine, self.long = -0.001, self.small.heights(-0.001), self.large.heights(-0.001)
        for time in (-0.001, 0.0):
            self.step(time, 0.1)

    def _front(self, heights: Array, slope_x: Array, slope_y: Array) -> Array:
        """Return how steep the fronts of crests are."""
        return np.where(heights > 0.2 * self.small.sigma, -(self.to[0] * slope_x + self.to[1] * slope_y), 0)

    def _break(self, front: Array, seconds: float) -> None:
        self.froth *= np.float32(np.exp(-seconds / 2.5))
        self.froth[front > self.limit] = 1

    def step(self, time: float, seconds: float) -> None:
        """Go on to a time."""
        (before_fine, before_long), self.start = (self.fine, self.long), self.time
        self.fine, self.long, self.time = self.small.heights(time), self.large.heights(time), time
        self.fine_slopes, self.long_slopes = self.small.slopes(self.fine), self.large.slopes(self.long)
        if self.breaking:
            self._break(self._front(self.fine, *self.fine_slopes), seconds)
        self.fine_pair = (before_fine + 1j * self.fine).astype(np.complex64)
        self.long_pair = (before_long + 1j * self.long).astype(np.complex64)

    def long_height(self, x: Array, y: Array, share: Array) -> Array:
        pair = self.large.between(self.long_pair, x, y)
        return np.asarray(pair.real + (pair.imag - pair.real) * share)

    def height(self, x: Array, y: Array, share: Any, *, wakes: bool = True, long: Any = None) -> Array:
        """Return the heights at some places at a share of the step; those of long waves may be known."""
        x, y, share = x.astype(np.float32), y.astype(np.float32), np.asarray(share, np.float32)
        pair = self.fine_pair.take(self.small.cell(x, y))
        height = pair.real + (pair.imag - pair.real) * share
        if self.large.sigma > 1e-3:
            height = height + (self.long_height(x, y, share) if long is None else long)
        for wake in self.wakes if wakes else ():
            height = height + wake.height(x, y)
        if self.world["shore"] is not None:
            surf, _ = self.surf(x, y, self.start + (self.time - self.start) * share)
            height = surf + height * np.clip(self.to_shore(x, y) / 30, 0.15, 1)
        return np.asarray(height)

    def under(self, craft: Sequence[Craft], x: Array, y: Array) -> Array:
        """Return the heights below craft, shape (craft, places); none is lifted by its own wake."""
        height = self.height(x, y, 1.0, wakes=False)
        for wake in self.wakes:
            own = np.array([each is wake.craft for each in craft])
            height = height + np.where(own[:, None], 0, wake.height(x.astype(np.float32), y.astype(np.float32)))
        return height

    def to_shore(self, x: Array, y: Array) -> Array:
        origin, inland = self.world["shore"]
        return np.asarray(-((x - origin[0]) * inland[0] + (y - origin[1]) * inland[1]))

    def surf(self, x: Array, y: Array, time: Any) -> tuple[Array, Array]:
        """Return heights, and shares of foam, of waves that run up a beach: bores as high as 0.7 of the depth."""
        (origin, inland), slope = self.world["shore"], self.world["shore_slope"]
        away, omega = self.to_shore(x, y), 2 * np.pi / self.world["surf_s"]
        along = (x - origin[0]) * -inland[1] + (y - origin[1]) * inland[0]
        near = np.maximum(away, 0.3)
        depth = np.maximum(slope * near, 0.03)
        arrival = omega * 2 * np.sqrt(near / (GRAVITY * slope))
        phase = omega * time + arrival + 0.8 * np.sin(along * 0.045) + 0.3 * np.sin(along * 0.17 + 1)
        group = 0.7 + 0.3 * np.sin(along * 0.06 + np.round(phase / (2 * np.pi)) * 2.4)
        free = self.world["surf_m"] * group * np.minimum((2.5 / np.maximum(depth, 0.3)) ** 0.25, 1.6)
        shape = np.exp(3.0 * (np.cos(phase - 0.55 * np.sin(phase)) - 1)) - 0.28
        height = np.minimum(free, 0.7 * depth) * shape + 0.05 * (1 - np.clip(depth / 1.5, 0, 1))
        broken, since = np.clip((free / depth - 0.62) / 0.12, 0, 1), np.mod(phase, 2 * np.pi)
        crest = (since < 0.35) | (since > 2 * np.pi - 0.5)
        foam = broken * np.maximum(0.95 * crest, 0.75 * np.exp(-since / 1.3))
        height = np.where(away < 0, np.minimum(height, 0.06) + 0.4 * slope * away, height)
        return np.where(away < -2, -3, height).astype(np.float32), foam

    def slopes(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Return the slopes of wind waves and swell at the end of the step."""
        fine, long = self.small.cell(x, y), self.large.cell(x, y)
        slope_x, slope_y = (
            a.take(fine) + b.take(long) for a, b in zip(self.fine_slopes, self.long_slopes, strict=True)
        )
        return slope_x, slope_y

    def patches(self, x: Array, y: Array, cell: float, drift: float = 0.0) -> Array:
        """Return a field of median 1, of patches that have gone some way with the wind."""
        return texels(self.patch, (x - self.to[0] * drift) / cell, (y - self.to[1] * drift) / cell)

    def foam(self, x: Array, y: Array) -> Array:
        """Return the reflectivity of foam where there is any."""
        drift = 0.02 * self.wind * self.time
        grain = texels(self.grain, (x - self.to[0] * drift) / 0.1, (y - self.to[1] * drift) / 0.1)
        rho = np.zeros(x.shape, np.float32)
        if self.breaking:
            lift = 0.8 * self.long.take(self.large.cell(x, y)) / max(self.large.sigma, 0.05)
            share = self.froth.take(self.small.cell(x, y)) * np.clip(0.8 + lift, 0, 1.2)
            rho = np.where(grain < share, 0.05 + 0.3 * share, rho)
        for wake in self.wakes:
            share = wake.foam(x, y)
            rho = np.where(grain < share, np.maximum(rho, 0.02 + 0.2 * share), rho)
        if self.world["shore"] is not None:
            _, share = self.surf(x, y, self.time)
            rho = np.where(grain < share, np.maximum(rho, 0.06 + 0.3 * share), rho)
        if self.wind > 3.5:
            rho = np.where(self._windrows(x, y) & (grain < 0.4), np.maximum(rho, 0.02), rho)
        return rho

    def _windrows(self, x: Array, y: Array) -> Array:
        """Return where foam is in streaks along the wind (Langmuir 1938)."""
        along, across = x * self.to[0] + y * self.to[1], y * self.to[0] - x * self.to[1]
        streak = np.exp(-(((np.mod(across + 0.6 * np.sin(along * 0.15), 7.0) - 3.5) / 0.5) ** 2))
        return texels(self.grain, along / 2.0, across / 0.35) < 0.06 * streak
