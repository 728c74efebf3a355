"""Lidars of `facet_sea`: models, and the rays of one."""

from typing import Any, NamedTuple

import numpy as np
from facet_bodies import Random, log_uniform


class Table(NamedTuple):
    """Elevations of the beams, columns at 10 Hz, range at 10 %, beam divergence, noise, gain of diffuse echoes."""

    elevations_deg: Any
    columns: int
    reach_m: float
    divergence_mrad: float
    noise_m: float
    gain: float
    offsets: int  # number of the entry in OFFSETS


OFFSETS = [0.0], [0.0, 0.4], [3.0, 1, -1, -3], [1.4, -4.2, 1.4, -1.4, 4.2, -1.4]  # of azimuth, in degrees, by beam
VLP32C = [
    -25, -15.639, -11.31, -8.843, -7.254, -6.148, -5.333, -4.667, -4, -3.667, -3.333, -3, -2.667, -2.333, -2, -1.667,
    -1.333, -1, -0.667, -0.333, 0, 0.333, 0.667, 1, 1.333, 1.667, 2.333, 3.333, 4.667, 7, 10.333, 15,
]  # fmt: skip
RS32 = [
    -25, -14.638, -10.281, -7.91, -6.424, -5.407, -4.667, -4, -3.667, -3.333, -3, -2.667, -2.333, -2, -1.667, -1.333,
    -1, -0.667, -0.333, 0, 0.333, 0.667, 1, 1.333, 1.667, 2.333, 3.333, 4.667, 7, 9, 11.5, 15,
]  # fmt: skip
HELIOS = [
    15, 13, 11, 9, 7, 5.5, 4, 2.67, 1.33, 0, -1.33, -2.67, -4, -5.33, -6.67, -8, -10, -13, -16, -19, -22, -25, -28,
    -31, -34, -37, -40, -43, -46, -49, -52, -55,
]  # fmt: skip
LOW = [-7, -8, -9, -10, -11, -12, -13, -14, -19, -25]
PANDAR40P = [15, 11, 8, 5, 3, 2, *np.linspace(1.667, -6, 24), *LOW]
PANDAR64 = [15, 11, 8, 5, 3, *np.linspace(2, -6, 49), *LOW]
PANDAR128 = [*np.arange(14.5, 1.99, -0.5), *np.arange(1.875, -6.01, -0.125), *np.arange(-6.5, -25.01, -0.5)]
RUBY = [
    15, 13.5, 12, 10.5, 9.5, 8.5, 7.5, 6.7, 6, 5.3, 4.7, 4.2, *np.arange(3.8, -6.21, -0.1), -6.7, -7.3, -8, -8.8,
    -9.7, -10.7, -11.8, -13, -14.3, -15.8, -17.5, -19.4, -21.5, -23.2, -25,
]  # fmt: skip
LIDARS = {
    "VLP-16": Table(np.linspace(-15, 15, 16), 1800, 60, 3.0, 0.02, 110, 0),
    "RS-LiDAR-16": Table(np.linspace(-15, 15, 16), 1800, 70, 3.0, 0.02, 160, 0),
    "PandarXT-16": Table(np.linspace(15, -15, 16), 2000, 80, 1.8, 0.01, 200, 0),
    "VLP-32C": Table(VLP32C, 1800, 100, 3.0, 0.025, 110, 3),
    "HDL-32E": Table(np.linspace(-30.67, 10.67, 32), 1800, 65, 2.8, 0.02, 140, 0),
    "RS-LiDAR-32": Table(RS32, 1800, 95, 3.0, 0.025, 200, 3),
    "RS-Helios": Table(HELIOS, 1800, 90, 3.0, 0.02, 200, 1),
    "PandarXT-32": Table(np.linspace(15, -16, 32), 2000, 80, 1.8, 0.01, 220, 0),
    "Pandar40P": Table(PANDAR40P, 1800, 130, 2.0, 0.02, 220, 2),
    "OS0-32": Table(np.linspace(45, -45, 32), 1024, 30, 6.1, 0.03, 230, 2),
    "OS1-32": Table(np.linspace(21.2, -21.2, 32), 1024, 70, 3.1, 0.02, 230, 2),
    "OS1-64": Table(np.linspace(16.6, -16.6, 64), 1024, 70, 3.1, 0.02, 230, 2),
    "OS2-64": Table(np.linspace(11.25, -11.25, 64), 1024, 160, 1.6, 0.03, 230, 2),
    "OS0-64": Table(np.linspace(45, -45, 64), 1024, 32, 6.1, 0.03, 230, 2),
    "Pandar64": Table(PANDAR64, 1800, 130, 2.0, 0.02, 220, 2),
    "OS0-128": Table(np.linspace(45, -45, 128), 1024, 33, 6.1, 0.03, 230, 2),
    "OS1-128": Table(np.linspace(21.2, -21.2, 128), 1024, 75, 3.1, 0.02, 230, 2),
    "OS2-128": Table(np.linspace(11.25, -11.25, 128), 1024, 180, 1.6, 0.03, 230, 2),
    "Pandar128": Table(PANDAR128, 1200, 160, 2.0, 0.02, 220, 2),
    "RS-Ruby": Table(RUBY, 1200, 160, 1.8, 0.02, 220, 1),
}
SPARSE = ["VLP-16", "RS-LiDAR-16", "PandarXT-16", "OS0-32", "HDL-32E", "VLP-16"]


class Lidar:
    """Lidar of a model and its rays, shape (beams * columns, 3)."""

    def __init__(self, rng: Random, family: str) -> None:
        names = SPARSE if family == "sparse" else list(LIDARS)
        name = str(rng.choice(names))
        if family == "wake":
            dense = [each for each in names if len(LIDARS[each][0]) >= (16 if rng.random() < 0.1 else 32)]
            name = str(rng.choice(dense))
        elevations, columns, reach_m, divergence, self.noise_m, gain, self.offsets = LIDARS[name]
        self.rate_hz = float(rng.choice([5, 5, 10] if family == "sparse" else [5, 10, 10, 10, 20]))
        self.beams = len(elevations)
        self.elevations = np.asarray(elevations, float) + rng.normal(0, 0.04, self.beams)
        if name.startswith("OS"):
            columns = 1024 if self.rate_hz > 5 else int(rng.choice([1024, 2048]))
        else:
            columns = int(columns * min(1.25, 10 / self.rate_hz))
        most = 1024 if family == "sparse" else 1200 if self.beams >= 64 else columns
        self.columns, self.frames = min(columns, most), int(rng.integers(40, 81))
        self.height_m = self._height(rng, family, low=self.beams == 16 or name.startswith("OS2"))
        self.reach_m, self.divergence = reach_m * rng.uniform(0.8, 1.15), divergence * 1e-3
        self.gain = gain * rng.uniform(0.85, 1.1)

    @staticmethod
    def _height(rng: Random, family: str, *, low: bool) -> float:
        height_m = log_uniform(rng, 1.0, 4.0 if family in ("sparse", "mirrors") else 8.0)
        if family == "wake":
            height_m = rng.uniform(2.0, 6.5)
        return min(height_m, 4.5) if low else height_m

    def aim(self, rng: Random) -> None:
        """Set the rays, column by column clockwise."""
        azimuth = (np.arange(self.columns) + 0.5) / self.columns * 2 * np.pi
        azimuth = (rng.uniform(-np.pi, np.pi) if rng.random() < 0.5 else np.pi) - azimuth
        offsets = np.resize(OFFSETS[self.offsets], self.beams)
        offsets = np.radians(offsets) * (1.04 if self.offsets == 2 else 1)
        around = azimuth + offsets[:, None]
        up = np.radians(self.elevations)[:, None] + 0 * around
        rays = np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], -1)
        self.rays = rays.reshape(-1, 3).astype(np.float32)
        self.ring, self.column = np.divmod(np.arange(len(self.rays)), self.columns)

    @property
    def seconds(self) -> float:
        return self.frames / self.rate_hz
