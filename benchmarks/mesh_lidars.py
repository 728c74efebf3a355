"""Lidars of `mesh_sea`: models, the rays of one, and what these meet of triangles."""

from typing import Any, NamedTuple

import numpy as np
from mesh_parts import Array, Random

NARROW = [
    -25, -15.639, -11.31, -8.843, -7.254, -6.148, -5.333, -4.667, -4, -3.667, -3.333, -3, -2.667, -2.333, -2, -1.667,
    -1.333, -1, -0.667, -0.333, 0, 0.333, 0.667, 1, 1.333, 1.667, 2.333, 3.333, 4.667, 7, 10.333, 15,
]  # fmt: skip
ROBO = [
    -25, -14.638, -10.281, -7.97, -6.5, -5.407, -4.667, -4, -3.667, -3.333, -3, -2.667, -2.333, -2, -1.667, -1.333, -1,
    -0.667, -0.333, 0, 0.333, 0.667, 1, 1.333, 1.667, 2.333, 3.333, 4.667, 7, 9.4, 12.2, 15,
]  # fmt: skip
PANDAR64 = [-25, -19, -14, -13, -12, -11, -10, -9, -8, -7, *np.linspace(-6, 2, 49), 3, 5, 8, 11, 15]


class Model(NamedTuple):
    """Beams, offsets of their azimuths, columns, range at 10 %, divergence, noise, nearest range, intensities."""

    elevations_deg: Any
    offsets_deg: list[float]
    columns: int
    reach_m: float
    divergence_mrad: float
    noise_m: float
    blind_m: float
    scale: str


LIDARS = {
    "VLP-16": Model(np.linspace(-15, 15, 16), [0], 900, 45, 2.4, 0.014, 0.5, "calibrated"),
    "VLP-32C": Model(NARROW, [1.4, -4.2, 1.4, -1.4, 1.4, -1.4, 4.2, -1.4], 900, 80, 2.2, 0.015, 0.6, "calibrated"),
    "RS-LiDAR-32": Model(ROBO, [8, -8, 2.7, -2.7], 900, 70, 2.4, 0.018, 0.5, "calibrated"),
    "XT32": Model(np.linspace(-16, 15, 32), [0], 1000, 80, 1.5, 0.007, 0.3, "reflectivity"),
    "OS1-64": Model(np.linspace(-22.3, 22.3, 64), [4.2, 1.4, -1.4, -4.2], 720, 55, 3.0, 0.012, 0.4, "signal"),
    "OS1-64 gen 1": Model(np.linspace(-16.6, 16.6, 64), [3.2, 1.0, -1.0, -3.2], 720, 42, 3.0, 0.02, 0.7, "signal"),
    "Pandar64": Model(PANDAR64, [-1.04, 1.04], 720, 90, 2.0, 0.01, 0.4, "reflectivity"),
    "OS1-128": Model(np.linspace(-22.4, 22.4, 128), [4.2, 1.4, -1.4, -4.2], 600, 75, 2.8, 0.011, 0.4, "signal"),
}


def wrapped(angle: Any) -> Any:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def counted(counts: Array) -> tuple[Array, Array]:
    """Return, for each count, its index so many times, and 0, 1, 2 ... up to it."""
    index = np.repeat(np.arange(len(counts)), counts)
    return index, np.arange(len(index)) - np.repeat(np.cumsum(counts) - counts, counts)


def directions(azimuth: Array, elevation: Array) -> Array:
    level = np.cos(elevation)
    rays = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], -1)
    return rays.reshape(-1, 3).astype(np.float32)


class Lidar:
    """Lidar of a model: rays, shape (beams * columns, 3), clockwise, and sets of three in the footprint of each."""

    FIRST = np.pi - 1e-3  # azimuth of the first column

    def __init__(self, name: str, rng: Random) -> None:
        self.model = LIDARS[name]
        self.columns, self.divergence = self.model.columns, self.model.divergence_mrad * 1e-3
        self.beams = np.radians(np.sort(np.asarray(self.model.elevations_deg, float)))
        self.offsets = np.radians(np.resize(self.model.offsets_deg, len(self.beams)).astype(float))
        self.step, self.number = 2 * np.pi / self.columns, len(self.beams) * self.columns
        azimuth = self.FIRST - np.arange(self.columns) * self.step + self.offsets[:, None]
        elevation, sigma = self.beams[:, None] + 0 * azimuth, self.divergence / 3.2
        self.rays = directions(azimuth, elevation)
        self.footprints = [
            [
                directions(
                    azimuth + rng.normal(0, sigma, azimuth.shape) / np.cos(elevation),
                    elevation + rng.normal(0, sigma * 0.8, azimuth.shape),
                )
                for _ in range(3)
            ]
            for _ in range(2)
        ]
        self.beam, self.column = np.divmod(np.arange(self.number), self.columns)
        self.least = 0.1 / self.model.reach_m**2  # power of the faintest echo

    def nearest(self, rays: Array) -> Array:
        """Return the numbers of the rays next to some directions."""
        middles = (self.beams[1:] + self.beams[:-1]) / 2
        beam = np.searchsorted(middles, np.arctan2(rays[:, 2], np.hypot(rays[:, 0], rays[:, 1])))
        column = np.round((self.FIRST + self.offsets[beam] - np.arctan2(rays[:, 1], rays[:, 0])) / self.step)
        return np.asarray(beam * self.columns + column.astype(np.int64) % self.columns)

    def within(self, azimuth: tuple[Array, Array], elevation: tuple[Array, Array]) -> tuple[Array, Array]:
        """Return the numbers of windows, and those of the rays in them; windows over half a turn have none."""
        (left, right), (first, last) = azimuth, (np.searchsorted(self.beams, end) for end in elevation)
        window, beam = counted(np.where(right - left > 3.0, 0, np.maximum(last - first, 0)))
        beam += first[window]
        low, high = ((self.FIRST + self.offsets[beam] - end[window]) / self.step for end in (right, left))
        column = np.ceil(low).astype(np.int64)
        row, more = counted(np.maximum(np.floor(high).astype(np.int64) - column + 1, 0))
        return window[row], beam[row] * self.columns + (column[row] + more) % self.columns

    def meet(self, triangles: Array, footprints: list[Array]) -> tuple[Array, Array]:
        """Return range and number of the nearest triangle of each ray, shape (footprints, rays); none: infinity, -1."""
        shape = len(footprints), self.number
        range_m, number = np.full(shape, np.inf, np.float32), np.full(shape, -1, np.int32)
        if not len(triangles):
            return range_m, number
        triangle, ray = self._candidates(triangles)
        a, b, c = triangles.swapaxes(0, 1)
        normals = np.stack([np.cross(a, b), np.cross(b, c), np.cross(c, a)], 1).astype(np.float32)
        volume = np.einsum("ij,ij->i", a, normals[:, 1])
        volume = np.where(abs(volume) < 1e-12, 1e-12, volume)
        for start in range(0, len(triangle), 700_000):
            tried, rays = triangle[start : start + 700_000], ray[start : start + 700_000]
            sides = [[np.ascontiguousarray(normals[:, i, j])[tried] for j in range(3)] for i in range(3)]
            for k, footprint in enumerate(footprints):
                x, y, z = (footprint[rays, j] for j in range(3))
                w = [side[0] * x + side[1] * y + side[2] * z for side in sides]
                low, high = np.minimum(np.minimum(w[0], w[1]), w[2]), np.maximum(np.maximum(w[0], w[1]), w[2])
                hit = np.flatnonzero((low >= 0) | (high <= 0))
                with np.errstate(divide="ignore", invalid="ignore"):
                    r = volume[tried[hit]] / (w[0][hit] + w[1][hit] + w[2][hit])
                good = (r > 0.15) & np.isfinite(r) & (r < range_m[k, rays[hit]])
                hit, r = hit[good], r[good]
                order = np.argsort(-r, kind="stable")  # the nearest is the last to be set
                hit, r = hit[order], r[order]
                range_m[k, rays[hit]], number[k, rays[hit]] = r, tried[hit]
        return range_m, number

    def _candidates(self, triangles: Array) -> tuple[Array, Array]:
        """Return triangles and rays that may meet; the edge of a triangle is bent in angles."""
        azimuth, level = (
            np.arctan2(triangles[..., 1], triangles[..., 0]),
            np.hypot(triangles[..., 0], triangles[..., 1]),
        )
        elevation, margin = np.arctan2(triangles[..., 2], level), 0.6 * self.divergence
        around = wrapped(azimuth - azimuth[:, :1])
        left, right = azimuth[:, 0] + around.min(1), azimuth[:, 0] + around.max(1)
        bend = 1 / np.cos(np.minimum((right - left) / 2, 1.3)) - 1
        bend = abs(np.tan(np.clip(elevation, -1.4, 1.4))).max(1) * bend + margin
        near = np.flatnonzero((level.min(1) < 180) & (level.min(1) > 0.05))
        window = (left[near] - margin, right[near] + margin)
        number, ray = self.within(window, ((elevation.min(1) - bend)[near], (elevation.max(1) + bend)[near]))
        return near[number], ray
