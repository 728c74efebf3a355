"""The sea surface: random waves with a published spectrum."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Interval
from numpy.typing import NDArray
from scipy import fft

from seaclutter_cli.params import Positive, Share, key

GRAVITY = 9.81
_CELLS = 256
_SWELL_WAVES = 256
_TILE_WAVES = 12.0
_MIN_TILE_M, _MAX_TILE_M = 48.0, 160.0
_HEIGHTS_M = (0.0, 0.05, 0.3, 0.875, 1.875, 3.25, 5.0)


@dataclass(frozen=True, kw_only=True)
class SeaParams:
    """The sea of a scene."""

    sea_state: Annotated[float, Interval(ge=0, le=6)] = key(
        2.0, "Sea state on the WMO scale, 0 to 6; between whole numbers the wave height is interpolated."
    )
    peak_enhancement: Annotated[float, Interval(ge=1, le=10)] = key(
        3.3, "Peak enhancement of the JONSWAP spectrum; 1 gives the Pierson-Moskowitz spectrum."
    )
    direction_deg: float = key(0.0, "Direction in which the waves travel, counter-clockwise from the world's x.")
    spreading: Annotated[int, Interval(ge=1, le=50)] = key(
        4, "Exponent s of the directional spread, the cosine of half the angle to the power of 2s."
    )
    reflectivity: Share = key(0.002, "Mean reflectivity of water at normal incidence.")
    spikiness: Positive = key(
        0.2, "Shape of the texture that makes few facets bright and most dark; smaller values are spikier."
    )
    foam_reflectivity: Share = key(0.22, "Reflectivity of foam and spray at normal incidence.")
    foam_lifetime_s: Positive = key(8.0, "Time in which the foam of a wake decays to 1/e.", formerly="foam_life_s")
    visibility_km: Positive = key(10.0, "Meteorological visibility, which determines the extinction in air.")

    @property
    def significant_height_m(self) -> float:
        """Significant wave height of the sea state: the middle of the WMO's bounds."""
        return float(np.interp(self.sea_state, np.arange(len(_HEIGHTS_M)), _HEIGHTS_M))

    @property
    def wind_ms(self) -> float:
        """Wind speed that raises this sea if it is fully developed: :math:`H_s = 0.21 U^2 / g`."""
        return float(np.sqrt(self.significant_height_m * GRAVITY / 0.21))


def jonswap(omega: NDArray[np.float64], height_m: float, peak: float, enhancement: float) -> NDArray[np.float64]:
    r"""Return the JONSWAP spectrum of the surface elevation (Hasselmann et al. 1973, Dt. Hydrogr. Z. A8(12)).

    .. math:: S(\omega) = \frac{A}{\omega^5} \exp\!\left(-\tfrac54 \left(\tfrac{\omega_p}{\omega}\right)^4\right)
        \gamma^{\exp(-(\omega-\omega_p)^2 / (2 \sigma^2 \omega_p^2))}

    It is the variance density, in m² s / rad, at angular frequencies :math:`\omega > 0`, shape (N,), for a significant
    wave height in metres, the frequency of the peak, :math:`\omega_p`, and its enhancement :math:`\gamma`; 1 gives the
    Pierson-Moskowitz spectrum (1964, JGR 69(24)). A reproduces the height to within about 1 % (Goda's approximation).
    """
    sigma = np.where(omega <= peak, 0.07, 0.09)
    bump = enhancement ** np.exp(-((omega / peak - 1) ** 2) / (2 * sigma**2))
    scale = 5 / 16 * height_m**2 * peak**4 * (1 - 0.287 * np.log(enhancement))
    return np.asarray(scale / omega**5 * np.exp(-1.25 * (peak / omega) ** 4) * bump)


def directional_variance(
    wave: tuple[NDArray[np.float64], NDArray[np.float64]],
    spectrum: tuple[float, float, float],
    direction_deg: float,
    spreading: int,
    norm: float = 1.0,
) -> NDArray[np.float64]:
    """Return the density of the variance of each wave vector, with components that broadcast to (M, M); 0 at 0.

    ``spectrum`` is height, peak and enhancement of `jonswap`. The directional spread is divided by ``norm``.
    """
    kx, ky = np.broadcast_arrays(*wave)
    k = np.hypot(kx, ky)
    out: NDArray[np.float64] = np.zeros_like(k)
    some = k > 0
    omega = np.sqrt(GRAVITY * k[some])
    spread = np.cos((np.arctan2(ky, kx)[some] - np.radians(direction_deg)) / 2) ** (2 * spreading) / norm
    # S(omega) D(theta) d omega d theta by wave vector: d omega / d k = g / (2 omega), dk k dtheta = dkx dky.
    out[some] = jonswap(omega, *spectrum) * spread * GRAVITY / (2 * omega) / k[some]
    return out


@dataclass(frozen=True)
class WaveSurface:
    """The sea at one moment: a periodic tile of elevations in metres by x and y, shape (M, M), in cells of a width."""

    heights: NDArray[np.float32]
    cell_m: float

    def _cells(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.int64]:
        size = len(self.heights)
        column = np.floor(x / self.cell_m + 0.5).astype(np.int64) % size
        row = np.floor(y / self.cell_m + 0.5).astype(np.int64) % size
        return np.asarray(column * size + row)

    def height(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return the elevation of the nearest cells in metres."""
        return np.asarray(self.heights.reshape(-1)[self._cells(x, y)])

    def slope(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the slopes along x and y of the nearest cells, by central differences."""
        size, flat = len(self.heights), self.heights.reshape(-1)
        cells = self._cells(x, y)
        column, row = cells // size, cells % size
        along_x = flat[(column + 1) % size * size + row] - flat[(column - 1) % size * size + row]
        along_y = flat[column * size + (row + 1) % size] - flat[column * size + (row - 1) % size]
        return along_x / (2 * self.cell_m), along_y / (2 * self.cell_m)


class Sea:
    r"""Random waves in deep water on a periodic tile.

    Each wave vector of a grid gets a random amplitude with the variance given by spectrum and directional
    spread, and oscillates with :math:`\omega = \sqrt{g k}`; the surface is the inverse Fourier transform, as in
    Tessendorf (2001, Simulating Ocean Water). The tile is twelve peak wavelengths wide, but at most 160 m, so that it
    repeats beyond the part of the sea that a lidar sees.
    """

    def __init__(self, params: SeaParams, rng: np.random.Generator) -> None:
        self.params = params
        peak = 0.877 * GRAVITY / params.wind_ms if params.wind_ms else 5.0
        wavelength = 2 * np.pi * GRAVITY / peak**2
        self.tile_m = max(_MIN_TILE_M, min(_TILE_WAVES * wavelength, _MAX_TILE_M))
        self.cell_m = self.tile_m / _CELLS
        wave = 2 * np.pi * fft.fftfreq(_CELLS, self.cell_m)
        self._kx, self._ky = wave[:, None], wave[None, :]
        self._omega = np.sqrt(GRAVITY * np.hypot(self._kx, self._ky))
        noise = rng.standard_normal((2, _CELLS, _CELLS))
        angles = np.linspace(-np.pi, np.pi, 720, endpoint=False)
        norm = np.mean(np.cos(angles / 2) ** (2 * params.spreading)) * 2 * np.pi
        spectrum = params.significant_height_m, peak, params.peak_enhancement
        density = directional_variance((self._kx, self._ky), spectrum, params.direction_deg, params.spreading, norm)
        self._amplitude = np.sqrt(density * (2 * np.pi / self.tile_m) ** 2) * (noise[0] + 1j * noise[1])

    def at(self, time_s: float) -> WaveSurface:
        """Return the surface at a time."""
        modes = self._amplitude * np.exp(-1j * self._omega * time_s)
        heights = fft.ifft2(modes, workers=1, overwrite_x=True).real * _CELLS**2
        return WaveSurface(heights.astype(np.float32), self.cell_m)

    def swell(self, shortest_m: float) -> "Swell":
        """Return the strongest waves longer than ``shortest_m`` in metres, which are those that move a hull."""
        kx, ky = (part.reshape(-1) for part in np.broadcast_arrays(self._kx, self._ky))
        long = np.flatnonzero(np.hypot(kx, ky) < 2 * np.pi / shortest_m)
        amplitude, omega = self._amplitude.reshape(-1), self._omega.reshape(-1)
        chosen = long[np.argsort(-np.abs(amplitude[long]), kind="stable")[:_SWELL_WAVES]]
        return Swell(kx[chosen, None], ky[chosen, None], omega[chosen, None], amplitude[chosen, None])


@dataclass(frozen=True)
class Swell:
    """The strongest long waves of a sea, W of them: wave vectors, frequencies and amplitudes, shape (W, 1) each."""

    kx: NDArray[np.float64]
    ky: NDArray[np.float64]
    omega: NDArray[np.float64]
    amplitude: NDArray[np.complex128]

    def at(self, x: NDArray[np.float64], y: NDArray[np.float64], times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return height in metres and slopes along x and y at given positions and times, (T,) each, as shape (3, T)."""
        modes = self.amplitude * np.exp(1j * (self.kx * x + self.ky * y - self.omega * times_s))
        return np.stack([(factor * modes).sum(axis=0).real for factor in (1, 1j * self.kx, 1j * self.ky)])
