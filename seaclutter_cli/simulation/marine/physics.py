"""Optics of water, foam, rain and fog, and the parameters of seas whose physics goes beyond the default one."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Interval

from seaclutter_cli.arrays import Floats, Rng
from seaclutter_cli.params import NotNegative, Positive, Share, key
from seaclutter_cli.simulation.lidar import Echoes, Lidar

DIVERGENCE_RAD = 0.003
"""Full width of a beam."""
PULSE_M = 0.75
"""Length of a pulse."""

_WAVELENGTHS_NM = (850.0, 865.0, 905.0, 1550.0)
_INDEX = (1.329, 1.329, 1.328, 1.318)
_ABSORPTION = (4.3, 4.8, 6.8, 1080.0)
_FOAM_WAVELENGTHS_NM, _FOAM = (440.0, 850.0, 1020.0, 1650.0), (1.0, 0.6, 0.5, 0.15)


@dataclass(frozen=True, kw_only=True)
class PhysicsParams:
    """Physics of water, air and own motion; without this section, waves, foam and wakes only."""

    families: tuple[str, ...] = key((), "What the scene is an example of, so that a benchmark can leave it out.")
    rate_hz: Annotated[float, Interval(ge=1, le=50)] | None = key(
        None, "Frames per second; null is the lidar's own rate."
    )
    wind_ms: Annotated[float, Interval(ge=0, le=30)] = key(
        4.0, "Wind speed, which ripples the water, tears off spray and makes whitecaps."
    )
    wind_deg: float = key(0.0, "Direction to which the wind blows, counter-clockwise from the world's x.")
    shelter: Share = key(
        1.0,
        "Share of the slope variance of open water that the ripples of this water have; small under quays and in "
        "slicks.",
    )
    backscatter: Positive = key(
        0.02,
        "Backscattering coefficient of the water and what floats in it, in 1/m: 0.002 in the ocean, 0.3 in a port.",
    )
    patch_m: Positive = key(0.5, "Size of the patches in which the water is bright or dark.")
    patch_s: Positive = key(0.3, "Time for which a patch stays as bright as it is.")
    whitecap_s: Positive = key(3.5, "Time in which the foam of a whitecap decays to 1/e.")
    wake_m: NotNegative = key(0.0, "Length of the turbulent wake behind each vessel under way.")
    wash_m: NotNegative = key(0.0, "Reach of the wash of own propeller beyond the bow, when it stops own ship.")
    wake_height_m: NotNegative = key(0.12, "Mean height of the echoes of a turbulent wake and of wash above the water.")
    wake_cover: Share = key(0.3, "Share of the shots into a fresh turbulent wake or wash that meet its froth.")
    wake_reflectivity: Share = key(0.05, "Mean reflectivity of the froth.")
    spray: Annotated[float, Interval(ge=0, le=50)] = key(
        0.0, "Number of sheets of spray that the bow and breaking crests throw up per second."
    )
    rain_mm_h: Annotated[float, Interval(ge=0, le=200)] = key(0.0, "Rain rate.")
    drop_reflectivity: Share = key(0.17, "Reflectivity of a drop of rain that fills the beam.")
    retro_tracks: tuple[int, ...] = key((), "Objects with a retro-reflector at their top.")
    bloom_deg: Positive = key(0.5, "Angle at which the blooming around a retro-reflector has decayed to 1/e.")
    roll_deg: Annotated[float, Interval(ge=0, le=45)] = key(
        0.0, "Amplitude of the rolling of own ship beyond its response to waves."
    )
    roll_s: Positive = key(4.0, "Period of rolling.")
    pitch_deg: Annotated[float, Interval(ge=0, le=30)] = key(
        0.0, "Amplitude of pitching, at twice the rate of rolling."
    )
    least_reflectivity: Annotated[float, Interval(gt=0, le=0.1)] = key(
        0.001,
        "Reflectivity below which no echo is detected, however near: beam and receiver do not overlap at the lidar.",
    )
    intensity_offset: Annotated[float, Interval(ge=0, le=100)] = key(
        0.0, "Intensity that the lidar reports beyond its echo's."
    )
    intensity_exponent: Annotated[float, Interval(gt=0, le=1)] = key(
        1.0, "Power of the echo to which reported intensities are proportional."
    )

    @property
    def ripple_variance(self) -> float:
        """Variance of the slopes of all ripples, over both directions (Cox and Munk 1954, JOSA 44(11))."""
        return self.shelter * (0.003 + 0.00512 * self.wind_ms)


def whitecap_share(wind_ms: float) -> float:
    """Return the share of open water under whitecaps (Monahan and O'Muircheartaigh 1980, JPO 10(12))."""
    return float(min(1.0, 3.84e-6 * wind_ms**3.41))


def refractive_index(wavelength_nm: float) -> float:
    """Return the refractive index of water (Hale and Querry 1973)."""
    return float(np.interp(wavelength_nm, _WAVELENGTHS_NM, _INDEX))


def absorption(wavelength_nm: float) -> float:
    """Return the absorption of light in water in 1/m.

    Visible light: Hale and Querry (1973, Applied Optics 12(3)); infrared: Kou et al. (1993, Applied Optics 32(19)).
    """
    return float(np.exp(np.interp(wavelength_nm, _WAVELENGTHS_NM, np.log(_ABSORPTION))))


def foam_share(wavelength_nm: float) -> float:
    """Return the reflectivity of foam relative to that in visible light (Frouin et al. 1996, JGR 101(C6))."""
    return float(np.interp(wavelength_nm, _FOAM_WAVELENGTHS_NM, _FOAM))


def fresnel(cosine: Floats, index: float) -> Floats:
    """Return the share of unpolarised light that water reflects, for cosines of incidence from 0 to 1, shape (N,)."""
    inside = np.sqrt(1 - (1 - cosine**2) / index**2)
    across = (cosine - index * inside) / (cosine + index * inside)
    along = (index * cosine - inside) / (index * cosine + inside)
    return np.asarray((across**2 + along**2) / 2)


def water_reflectance(cosine: Floats, wavelength_nm: float, backscatter: float) -> Floats:
    r"""Return the reflectance of the light that comes back out of water, for cosines of incidence, shape (N,).

    .. math:: (1 - F(\theta))^2 \cdot 0.33 \frac{b_b}{a + b_b} \cdot \cos\theta

    The light passes the surface twice. Since :math:`1 - F` and :math:`\cos\theta` fall with the grazing angle h/R, the
    echo of water falls nearly with :math:`h^3 / R^5`, and the range at which it is lost grows with :math:`h^{3/5}`:
    from 17 m for a lidar 1.2 m up to just below 40 m for one 5 m up (Gordon et al. 1975, Applied Optics 14(2)).
    """
    albedo = 0.33 * backscatter / (absorption(wavelength_nm) + backscatter)
    return np.asarray((1 - fresnel(cosine, refractive_index(wavelength_nm))) ** 2 * albedo * cosine)


def facet_reflectance(cosine: Floats, wavelength_nm: float, variance: float) -> Floats:
    r"""Return the reflectance of the ripples that face the lidar, for cosines of incidence on the wave, shape (N,).

    .. math:: \frac{F(0)}{4 s^2 \cos^5\theta} \exp\!\left(-\tan^2\theta / s^2\right)

    Bufton, Hoge, Swift (1983, Applied Optics 22(17)).
    """
    normal = float(fresnel(np.ones(1), refractive_index(wavelength_nm))[0])
    cosine, variance = np.maximum(cosine, 0.05), max(variance, 1e-6)
    return np.asarray(normal / (4 * variance * cosine**5) * np.exp(-(1 / cosine**2 - 1) / variance))


def mirror_share(cosine: Floats, variance: float) -> Floats:
    r"""Return the share of a mirrored echo that ripples leave in the beam, for cosines of incidence, shape (N,).

    Ripples of slope :math:`s/\sqrt2` along and across tilt the mirrored ray by twice the slope up and down, and by
    :math:`2 \cos\theta` times the slope to the sides. Of the lobe into which they spread the beam, the receiver, which
    sees the target through the same ripples, sees the part that is as wide as the beam in each direction.
    """
    tilt = 2 * np.sqrt(variance / 2)
    return np.asarray(DIVERGENCE_RAD**2 / np.hypot(DIVERGENCE_RAD, tilt) / np.hypot(DIVERGENCE_RAD, tilt * cosine))


_STEP_M = 0.05
_APERTURE_M = 0.008
_DROPS_M3_MM = 8000.0
_REACH_M = 60.0
_KOSCHMIEDER = 3.912


class Weather:
    r"""Echoes of rain and fog along a shot, which are the same for all shots of a lidar.

    *Rain.* Drops of diameter D are distributed as :math:`N_0 e^{-\Lambda D}`, :math:`\Lambda = 4.1
    R^{-0.21}` per mm (Marshall and Palmer 1948, J. Meteorology 5(4)). A drop in the beam, B wide, returns its share of
    the area of the beam (Kilic et al. 2021, arXiv:2107.07004), with a reflectivity :math:`\rho` of about 0.17, which is
    the lidar ratio of water drops, 18.8 sr (O'Connor et al. 2004, JTECH 21(5)), as that of a surface. Only drops larger
    than :math:`D^* = B R e^{\alpha R} / \sqrt{G \rho}` give an echo; there are :math:`N_0 / \Lambda e^{-\Lambda D^*}
    \cdot \pi B^2 / 4` of them per metre.

    *Fog.* A soft target: the pulse lights droplets of backscatter :math:`\beta = 0.046 / V` per metre over its length
    L, with the visibility V (Rasshofer et al. 2011, Adv. Radio Sci. 9), which is a reflectivity of :math:`\pi \beta L`;
    the echo fluctuates exponentially.

    A shot reports the medium if its echo there is stronger than that of the surface that it hits.
    """

    def __init__(self, lidar: Lidar, physics: PhysicsParams, fog_extinction: float, near_m: float) -> None:
        rain_mm_h = physics.rain_mm_h
        # Of rain, 1.076 R^0.67 dB/km (Carbonneau and Wisely 1998).
        self.extinction = fog_extinction + float(1.076 * rain_mm_h**0.67 * np.log(10) / 10 / 1000)
        self._near_m = near_m
        self._gain = lidar.gain
        self._range_m = np.arange(lidar.min_range_m, _REACH_M, _STEP_M)
        received = lidar.gain * self.loss(self._range_m)
        self._fog = received * np.pi * 0.046 * fog_extinction / _KOSCHMIEDER * PULSE_M
        fog_rate = np.exp(-1 / np.maximum(self._fog, 1e-3)) / PULSE_M
        rain_rate = np.zeros_like(fog_rate)
        if rain_mm_h:
            beam_m, slope = _APERTURE_M + DIVERGENCE_RAD * self._range_m, 4.1 * rain_mm_h**-0.21
            least_mm = 1000 * beam_m / np.sqrt(received * physics.drop_reflectivity)
            rain_rate = _DROPS_M3_MM / slope * np.exp(-slope * least_mm) * np.pi / 4 * beam_m**2
            self._spread = 1 / (slope * least_mm)
        self._rain_share = rain_rate / np.maximum(rain_rate + fog_rate, 1e-30)
        self._depth = np.cumsum(rain_rate + fog_rate) * _STEP_M

    def loss(self, range_m: Floats) -> Floats:
        """Return the share of a reflectance that is received from a range, but for the gain, shape (N,)."""
        return np.asarray(np.exp(-2 * self.extinction * range_m) / np.maximum(range_m, self._near_m) ** 2)

    def add_echoes(self, echoes: Echoes, rng: Rng) -> None:
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
        echoes.add_stronger(hit, range_m, reflectance, self.loss)
