"""The water of a tile: wind sea and swell, without repetition within the tile."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from seaclutter_cli.simulation.airborne.scene import WaterParams
from seaclutter_cli.simulation.marine.sea import GRAVITY, jonswap

_SPREAD = {"wave": 4, "swell": 40}
_ENHANCEMENT = {"wave": 3.3, "swell": 6.0}


@dataclass(frozen=True)
class TileWater:
    """The surface at one moment.

    Parameters
    ----------
    heights : ndarray, shape (M, M), float64
        Elevation in metres by x and y in steps of a metre.
    swell : ndarray, shape (M, M), float64
        Elevation of the swell alone, which moves ships.
    """

    heights: NDArray[np.float64]
    swell: NDArray[np.float64]

    def height(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return elevations at given positions by linear interpolation, shape (N,)."""
        return np.asarray(ndimage.map_coordinates(self.heights, (x, y), order=1, mode="grid-wrap"))

    def heave(self, x: float, y: float) -> float:
        """Return the elevation of the swell at a position."""
        return float(ndimage.map_coordinates(self.swell, ([x], [y]), order=1, mode="grid-wrap")[0])

    def slope(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return slopes along x and y at given positions, as differences over a metre to both sides."""
        along = self.height(x + 1, y) - self.height(x - 1, y)
        return along / 2, (self.height(x, y + 1) - self.height(x, y - 1)) / 2


def water(params: WaterParams, size_m: float, rng: np.random.Generator) -> TileWater:
    """Return a random surface, at least ``size_m`` wide.

    Notes
    -----
    Wind sea and swell each have a JONSWAP spectrum with their own height and peak period, and a directional spread;
    their sum is the inverse Fourier transform of random amplitudes. Waves shorter than 2 m are left out.
    """
    cells = int(fft.next_fast_len(int(size_m) + 64))
    wind = _field(cells, params.wave_m, params.wave_period_s, params.direction_deg, "wave", rng)
    swell = _field(cells, params.swell_m, params.swell_period_s, params.direction_deg, "swell", rng)
    return TileWater(wind + swell, swell)


def _field(
    cells: int, height_m: float, period_s: float, direction_deg: float, kind: str, rng: np.random.Generator
) -> NDArray[np.float64]:
    wave = 2 * np.pi * fft.fftfreq(cells)
    kx, ky = wave[:, None], wave[None, :]
    k = np.hypot(kx, ky)
    noise = rng.standard_normal((2, cells, cells))
    if not height_m:
        return np.zeros((cells, cells))
    some = k > 0
    omega = np.sqrt(GRAVITY * k[some])
    theta = np.arctan2(*np.broadcast_arrays(ky, kx))[some] - np.radians(direction_deg)
    spread = np.cos(theta / 2) ** (2 * _SPREAD[kind])
    density = jonswap(omega, height_m, 2 * np.pi / period_s, _ENHANCEMENT[kind]) * spread * GRAVITY / (2 * omega)
    variance = np.zeros_like(k)
    variance[some] = density / k[some]
    heights = fft.ifft2(np.sqrt(variance) * (noise[0] + 1j * noise[1]), workers=1).real
    # The grid truncates the spectrum, so the remainder is scaled to the wave height.
    return np.asarray(heights * (height_m / 4) / max(float(heights.std()), 1e-12))
