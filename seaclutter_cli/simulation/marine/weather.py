"""Rain and fog: echoes of the air in front of surfaces, and its extinction."""

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.simulation.lidar.echoes import Echoes
from seaclutter_cli.simulation.lidar.models import Lidar
from seaclutter_cli.simulation.marine.physics import DIVERGENCE_RAD
from seaclutter_cli.truth import CLUTTER

Floats = NDArray[np.float64]

_STEP_M = 0.05
_PULSE_M = 0.75
_APERTURE_M = 0.008
_DROPS_M3_MM = 8000.0
_REACH_M = 60.0
_KOSCHMIEDER = 3.912


def rain_extinction(rain_mm_h: float) -> float:
    """Return the extinction of rain in 1/m: 1.076 R^0.67 dB/km (Carbonneau and Wisely 1998)."""
    return float(1.076 * rain_mm_h**0.67 * np.log(10) / 10 / 1000)


class Weather:
    r"""Echoes of rain and fog along a shot, which are the same for all shots of a lidar.

    Notes
    -----
    *Rain.* Drops of diameter D are distributed as :math:`N_0 e^{-\Lambda D}`, :math:`\Lambda = 4.1 R^{-0.21}` per mm
    [1]_. A drop in the beam, B wide, returns its share of the area of the beam [2]_, with a reflectivity :math:`\rho`
    of about 0.17, which is the lidar ratio of water drops, 18.8 sr [4]_, as that of a surface. Only drops larger than
    :math:`D^* = B R e^{\alpha R} / \sqrt{G \rho}` give an echo; there are
    :math:`N_0 / \Lambda e^{-\Lambda D^*} \cdot \pi B^2 / 4` of them per metre.

    *Fog.* A soft target: the pulse lights droplets of backscatter :math:`\beta = 0.046 / V` per metre over its length
    L, with the visibility V [3]_, which is a reflectivity of :math:`\pi \beta L`; the echo fluctuates exponentially.

    A shot reports the medium if its echo there is stronger than that of the surface that it hits.

    References
    ----------
    .. [1] Marshall, Palmer (1948). "The distribution of raindrops with size". Journal of Meteorology 5(4).
    .. [2] Kilic et al. (2021). "Lidar Light Scattering Augmentation (LISA): Physics-based simulation of adverse weather
       conditions for 3D object detection". arXiv:2107.07004.
    .. [3] Rasshofer, Spies, Spies (2011). "Influences of weather phenomena on automotive laser radar systems". Advances
       in Radio Science 9.
    .. [4] O'Connor, Illingworth, Hogan (2004). "A technique for autocalibration of cloud lidar". JTECH 21(5).
    """

    def __init__(self, lidar: Lidar, rain: tuple[float, float], fog_extinction: float, near_m: float) -> None:
        rain_mm_h, drop_reflectivity = rain
        self.extinction, self._near_m = fog_extinction + rain_extinction(rain_mm_h), near_m
        self._gain = lidar.gain
        self._range_m = np.arange(lidar.min_range_m, _REACH_M, _STEP_M)
        received = lidar.gain * self.loss(self._range_m)
        self._fog = received * np.pi * 0.046 * fog_extinction / _KOSCHMIEDER * _PULSE_M
        fog_rate = np.exp(-1 / np.maximum(self._fog, 1e-3)) / _PULSE_M
        rain_rate = np.zeros_like(fog_rate)
        if rain_mm_h:
            beam_m, slope = _APERTURE_M + DIVERGENCE_RAD * self._range_m, 4.1 * rain_mm_h**-0.21
            least_mm = 1000 * beam_m / np.sqrt(received * drop_reflectivity)
            rain_rate = _DROPS_M3_MM / slope * np.exp(-slope * least_mm) * np.pi / 4 * beam_m**2
            self._spread = 1 / (slope * least_mm)
        self._rain_share = rain_rate / np.maximum(rain_rate + fog_rate, 1e-30)
        self._depth = np.cumsum(rain_rate + fog_rate) * _STEP_M

    def loss(self, range_m: Floats) -> Floats:
        """Return the share of a reflectance that is received from a range, but for the gain, shape (N,)."""
        return np.asarray(np.exp(-2 * self.extinction * range_m) / np.maximum(range_m, self._near_m) ** 2)

    def add_echoes(self, echoes: Echoes, rng: np.random.Generator) -> None:
        """Add the first detectable echo of the air along each shot."""
        count = len(echoes.range_m)
        depth = rng.standard_exponential(count)
        hit = np.flatnonzero(depth < self._depth[-1])
        step = np.searchsorted(self._depth, depth[hit])
        range_m = self._range_m[step] + _STEP_M * rng.random(len(hit))
        draw = rng.standard_exponential(len(hit))
        power = 1 + draw * self._fog[step]
        rain = rng.random(len(hit)) < self._rain_share[step]
        if rain.any():
            # D is exponential beyond the least size, and the power grows with its square.
            power[rain] = (1 + draw[rain] * self._spread[step[rain]]) ** 2
        nearer = range_m < echoes.range_m[hit]
        hit, range_m, power = hit[nearer], range_m[nearer], np.minimum(power[nearer], 255.0)
        reflectance = power / (self._gain * self.loss(range_m))
        echoes.add_stronger(hit, (range_m, reflectance), CLUTTER, self.loss)
