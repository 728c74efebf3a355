"""Lidars that can be simulated: their beams, the surface that each shot hits, and the receiver that makes points.

The noise of the receiver is of the two kinds in [Bi].
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Floats, Ints, Rng, Rows
from seaclutter_cli.params import Positive, Share, key
from seaclutter_cli.sensors.packets import point_dtype
from seaclutter_cli.truth import CLUTTER


@dataclass(frozen=True, kw_only=True)
class NoiseParams:
    """False returns of a lidar.

    [Bi] shows both kinds but does not quantify them; the values for the lidars here are assumptions.
    """

    false_return_share: Share = key(
        0.0,
        'Share of the shots without an echo that report a nearby point anyway ("lost information" in [Bi]).',
        formerly="lost_share",
    )
    false_return_reach_m: Positive = key(
        0.6, "Mean distance of these points beyond the minimum range.", formerly="lost_reach_m"
    )
    mixed_pixel_share: Share = key(
        0.0,
        'Share of the shots across an edge that report a point between the two surfaces ("escape values" in [Bi]).',
        formerly="edge_share",
    )


@dataclass(frozen=True)
class Lidar:
    """A lidar that rotates clockwise, or a flash lidar, with K beams and C columns per frame.

    Each beam, in firing order, has an elevation, an azimuth relative to its column, clockwise in top view, and a firing
    time from the start of its column. ``detection_m`` is the range at which a surface of reflectivity 0.1 at normal
    incidence gives an echo of intensity 1; echoes are reported between ``min_range_m`` and ``max_range_m``, with a
    standard deviation of ``range_noise_m``. The lens is ``lens_m`` from the axis in the direction of the column. In a
    horizontal field of view of less than 360°, the columns are evenly spaced around straight ahead, and all shots are
    fired at once. A scene overrides the noise. Water absorbs light of its wavelength.
    """

    elevations_deg: tuple[float, ...]
    azimuth_offsets_deg: tuple[float, ...]
    firing_us: tuple[float, ...]
    columns: int
    detection_m: float
    max_range_m: float
    min_range_m: float = 0.4
    range_noise_m: float = 0.02
    lens_m: float = 0.0
    rate_hz: float = 10.0
    field_deg: float = 360.0
    noise: NoiseParams = NoiseParams()
    wavelength_nm: int = 905

    @property
    def gain(self) -> float:
        """Intensity of an echo from a surface of reflectivity 1 at one metre."""
        return self.detection_m**2 / 0.1

    @property
    def step_rad(self) -> float:
        """Angle from column to column in radians, counter-clockwise."""
        return -float(np.radians(self.field_deg)) / self.columns

    @property
    def rotates(self) -> bool:
        """Whether the lidar rotates and fires its columns one after the other."""
        return self.field_deg == 360

    def firing_times_s(self, azimuths: Floats) -> Floats:
        """Return the times in seconds, from the start of a frame, at which the lidar points at given azimuths.

        Azimuths are in the frame of the lidar, in radians, shape (N,).
        """
        return self.rotates * (azimuths / self.step_rad % self.columns / (self.columns * self.rate_hz))

    @cached_property
    def times_s(self) -> Floats:
        """Time of each shot from the start of the frame, shape (C, K), in seconds."""
        column = self.rotates * np.arange(self.columns) / (self.columns * self.rate_hz)
        return column[:, None] + np.array(self.firing_us) * 1e-6

    @cached_property
    def _rotation(self) -> Floats:
        """Rotation of the lidar at each shot, counter-clockwise, shape (C, K), in radians."""
        if not self.rotates:
            column = self.step_rad * (np.arange(self.columns) - (self.columns - 1) / 2)
            return np.repeat(column[:, None], len(self.elevations_deg), axis=1)
        return -self.times_s * self.rate_hz * 2 * np.pi

    @cached_property
    def lenses(self) -> Floats:
        """Position of the lens at each shot in the lidar's frame, shape (C, K, 3), in metres."""
        turn = self._rotation
        return self.lens_m * np.stack((np.cos(turn), np.sin(turn), np.zeros_like(turn)), axis=-1)

    @cached_property
    def directions(self) -> Floats:
        """Unit vector of each shot in the lidar's frame (x forward, y left, z up), shape (C, K, 3)."""
        azimuth = self._rotation - np.radians(self.azimuth_offsets_deg)
        elevation = np.broadcast_to(np.radians(self.elevations_deg), azimuth.shape)
        flat = np.cos(elevation)
        return np.stack((flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)), axis=-1)

    @cached_property
    def rings(self) -> NDArray[np.uint16]:
        """Number of each beam, counted from the lowest, shape (K,)."""
        return np.argsort(np.argsort(self.elevations_deg)).astype(np.uint16)


_RS32_ELEVATIONS = (
    *(-10.281, -6.424, 2.333, 3.333, 4.667, 7.0, 10.333, 15.0),
    *(0.333, 0.0, -0.333, -0.667, 1.667, 1.333, 1.0, 0.667),
    *(-25.0, -14.638, -7.91, -5.407, -3.667, -4.0, -4.333, -4.667),
    *(-2.333, -2.667, -3.0, -3.333, -1.0, -1.333, -1.667, -2.0),
)
# The lasers are in four columns with different azimuths. The manual gives the value of channel 10; the others follow
# the pattern of the columns. Individual sensors differ from the design by fractions of a degree.
_RS32_OFFSETS = (-8.0, -2.672, 2.672, 8.0) * 8
_RS32_FIRING = (*(2.88 * c for c in range(15)), 44.64, *(1.44 + 2.88 * c for c in range(15)), 46.08)
_VLP16_ELEVATIONS = (-15.0, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15)
_RS16_ELEVATIONS = (-15.0, -13, -11, -9, -7, -5, -3, -1, 15, 13, 11, 9, 7, 5, 3, 1)
_VLP32_ELEVATIONS = (
    *(-25.0, -1.0, -1.667, -15.639, -11.31, 0.0, -0.667, -8.843),
    *(-7.254, 0.333, -0.333, -6.148, -5.333, 1.333, 0.667, -4.0),
    *(-4.667, 1.667, 1.0, -3.667, -3.333, 3.333, 2.333, -2.667),
    *(-3.0, 7.0, 4.667, -2.333, -2.0, 15.0, 10.333, -1.333),
)
_CE30_ELEVATIONS = tuple(round(1.9 - 0.2 * row, 1) for row in range(20))
_CE30_NOISE = NoiseParams(false_return_share=0.15, mixed_pixel_share=0.5)


def _plain(
    elevations: tuple[float, ...], step_us: float, columns: int, detection_m: float, max_range_m: float, **more: Any
) -> Lidar:
    """Return a lidar whose beams are fired at even intervals in the azimuth of their column."""
    offsets, firing = (0.0,) * len(elevations), tuple(step_us * beam for beam in range(len(elevations)))
    return Lidar(elevations, offsets, firing, columns, detection_m, max_range_m, **more)


def _even(beams: int, top: float, bottom: float, columns: int, detection_m: float, wavelength_nm: int = 905) -> Lidar:
    elevations = tuple(np.linspace(top, bottom, beams).tolist())
    return _plain(elevations, 0.0, columns, detection_m, 200.0, min_range_m=0.5, wavelength_nm=wavelength_nm)


def _ouster(beams: int, half_deg: float = 22.5, detection_m: float = 90.0) -> Lidar:
    staggered = (4.23, 1.41, -1.41, -4.23) * (beams // 4)
    return replace(_even(beams, half_deg, -half_deg, 1024, detection_m, 865), azimuth_offsets_deg=staggered)


LIDARS: Mapping[str, Lidar] = {
    "RS-LiDAR-32": Lidar(_RS32_ELEVATIONS, _RS32_OFFSETS, _RS32_FIRING, 1800, 150.0, 200.0, lens_m=0.03997),
    "RS-LiDAR-16": _plain(_RS16_ELEVATIONS, 2.8, 1800, 100.0, 150.0, lens_m=0.03825),
    "VLP-16": _plain(_VLP16_ELEVATIONS, 2.304, 1808, 80.0, 100.0, min_range_m=0.5),
    "OS1-64": _ouster(64),
    "OS1-128": _ouster(128),
    "CE30-D": _plain(_CE30_ELEVATIONS, 0.0, 320, 28 / 3, 28.0, rate_hz=30.0, field_deg=60.0, noise=_CE30_NOISE),
    "OS1-16": _ouster(16, 16.6),
    "OS1-32": _ouster(32),
    "OS0-128": _ouster(128, 45.0, 45.0),
    "VLP-32C": _plain(_VLP32_ELEVATIONS, 1.152, 1800, 120.0, 200.0, min_range_m=0.5),
    "PandarXT-32": _even(32, 15.0, -16.0, 2000, 80.0),
    "generic-64-905": _even(64, 10.0, -20.0, 1024, 120.0),
    "generic-128-905": _even(128, 15.0, -25.0, 1024, 150.0),
    "generic-32-1550": _even(32, 10.0, -20.0, 1800, 200.0, 1550),
    "generic-64-1550": _even(64, 10.0, -20.0, 1024, 200.0, 1550),
}
"""Lidars by name; to add one, add a line here.

Angles, times and ranges are the makers' design values: RS-LiDAR-32 user manual (channel table, B.13 and B.14; appendix
A for the times), RS-LiDAR-16, VLP-16 and VLP-32C user manuals, Ouster OS0 and OS1 and Hesai PandarXT-32 datasheets,
CE30-D datasheet (table 2) and [Bi]. Generic lidars are named by their number of beams and their wavelength. For the
CE30-D, the amounts of noise are assumptions, and so is its sensitivity: it detects a white surface at its full
range and a reflectivity of 0.1 at a third of it.
"""


_SURFACE_M = 0.1

POINT = np.dtype([*point_dtype().descr, ("label", "<u2")])
"""A simulated point: the fields of RoboSense's driver and the truth, as in `seaclutter_cli.truth`."""


@dataclass
class Shots:
    """Shots of one frame in the world frame, N = C · K of them, column by column.

    ``origins`` and unit vectors, ``directions``, have the shape (N, 3); ``azimuths``, counter-clockwise from x in
    radians, (N,).
    """

    origins: Floats
    directions: Floats
    azimuths: Floats

    def __len__(self) -> int:
        return len(self.azimuths)

    def between(self, first: float, last: float) -> Ints:
        """Return the shots from one azimuth counter-clockwise to another, both in radians, in firing order."""
        return np.flatnonzero((self.azimuths - first) % (2 * np.pi) <= last - first)


@dataclass
class Echoes:
    r"""The nearest surface that each of N shots has hit so far.

    ``range_m`` is infinite without a hit; ``reflectance`` is reflectivity times the cosine of incidence,
    :math:`\rho \cos\theta` in Eq. 2 of [Li2023]; ``label`` is the object, as in `Truth.points`.
    """

    range_m: Floats
    reflectance: Floats
    label: NDArray[np.uint16]

    @classmethod
    def empty(cls, count: int) -> "Echoes":
        """Return the echoes of shots that have hit nothing."""
        return cls(np.full(count, np.inf), np.zeros(count), np.zeros(count, np.uint16))

    def add(self, shots: Ints, range_m: Floats, reflectance: Floats, label: int) -> None:
        """Update the shots whose new hits are nearer than their previous ones."""
        nearer = range_m < self.range_m[shots]
        chosen = shots[nearer]
        self.range_m[chosen] = range_m[nearer]
        self.reflectance[chosen] = reflectance[nearer]
        self.label[chosen] = label

    def add_stronger(self, shots: Ints, range_m: Floats, reflectance: Floats, loss: Callable[[Floats], Floats]) -> None:
        """Let hits that are clutter replace previous ones that are received less strongly, however near these are.

        ``loss`` is the share of a reflectance that is received from a range.
        """
        stronger = reflectance * loss(range_m) > self.reflectance[shots] * loss(self.range_m[shots])
        chosen = shots[stronger]
        self.range_m[chosen] = range_m[stronger]
        self.reflectance[chosen] = reflectance[stronger]
        self.label[chosen] = CLUTTER


@dataclass(frozen=True)
class Receiver:
    r"""Converter of echoes to points, in air with an extinction coefficient in 1/m; a share of the echoes drops out.

    The intensity is Eq. 2 of [Li2023] with a linear receiver:
    :math:`I = G \, \rho \cos\theta \, e^{-2 \alpha R} / R^2`, rounded down to a whole number and limited to 255.
    :math:`G` is the gain with which a surface of reflectivity 0.1 gives 1 at the range that the maker states for it. An
    echo is lost if it is below 1 with the noise of the receiver. Echoes from nearer than ``near_m``, where beam and
    receiver do not overlap fully, grow no further. Some lidars report :math:`I_0 + I^p` instead: ``response`` has
    :math:`I_0` and :math:`p`.
    """

    lidar: Lidar
    noise: NoiseParams
    extinction: float
    dropout: float
    near_m: float
    response: tuple[float, float]

    def receive(self, echoes: Echoes, times_s: Floats, rng: Rng) -> tuple[Rows, Ints, Floats]:
        """Return the points of a frame, `POINT`, the shot of each, and its distance, shape (M,) each.

        The echoes are those of the surface that each shot hits, and are changed by the noise; ``times_s``, shape
        (C, K), are the firing times of the shots.
        """
        add_mixed_pixels(echoes, self.lidar.columns, self.noise, rng)
        detected = self._detect(echoes, rng)
        spurious = false_returns(echoes, detected[0], self.lidar.min_range_m, self.noise, rng)
        order = np.argsort(np.concatenate((detected[0], spurious[0])), kind="stable")
        shot, range_m, power = (np.concatenate(both)[order] for both in zip(detected, spurious, strict=True))
        label = np.append(echoes.label[detected[0]], np.full(len(spurious[0]), CLUTTER, np.uint16))[order]
        return self._points(shot, range_m, power, label, times_s), shot, range_m

    def _detect(self, echoes: Echoes, rng: Rng) -> tuple[Ints, Floats, Floats]:
        lidar = self.lidar
        reflecting = np.flatnonzero(echoes.reflectance > 0)
        range_m = echoes.range_m[reflecting]
        power = lidar.gain * echoes.reflectance[reflecting] / np.maximum(range_m, self.near_m) ** 2
        power *= np.exp(-2 * self.extinction * range_m)
        power += 0.25 * rng.standard_normal(len(reflecting)) * np.sqrt(1 + 0.05 * power)
        kept = (power >= 1) & (range_m >= lidar.min_range_m) & (range_m <= lidar.max_range_m)
        kept &= rng.random(len(reflecting)) >= self.dropout
        measured = range_m[kept] + lidar.range_noise_m * rng.standard_normal(int(kept.sum()))
        return reflecting[kept], measured, power[kept]

    def _points(self, shots: Ints, measured: Floats, power: Floats, label: NDArray[np.uint16], times_s: Floats) -> Rows:
        lidar = self.lidar
        points = np.empty(len(shots), POINT)
        position = lidar.lenses.reshape(-1, 3)[shots] + lidar.directions.reshape(-1, 3)[shots] * measured[:, None]
        points["x"], points["y"], points["z"] = position.T
        offset, exponent = self.response
        points["intensity"] = np.minimum(np.floor(offset + power**exponent), 255.0)
        points["ring"] = lidar.rings[shots % len(lidar.elevations_deg)]
        points["timestamp"] = times_s.reshape(-1)[shots]
        points["label"] = label
        return points


def add_mixed_pixels(echoes: Echoes, columns: int, noise: NoiseParams, rng: Rng) -> None:
    r"""Convert some echoes at edges, those of a frame column by column, to mixed pixels.

    If the centres of two neighbouring beams hit different surfaces, the edge runs through one of the two beams, each
    with probability 1/2. The larger part of that beam, a share s uniform from 0.5 to 1, is on its own surface. The
    light of both parts adds up, and the beam reports the mean of their ranges weighted by their power, :math:`s P_1`
    and :math:`(1-s) P_2` with :math:`P \propto \rho \cos\theta / R^2`. The point is clutter if it is more than 10 cm
    from both surfaces.
    """
    if not noise.mixed_pixel_share:
        return
    shots = np.arange(len(echoes.range_m)).reshape(columns, -1)
    left, right = shots[:-1].reshape(-1), shots[1:].reshape(-1)
    with np.errstate(invalid="ignore"):
        step = np.abs(echoes.range_m[left] - echoes.range_m[right])
    chosen = rng.random(len(left)) < noise.mixed_pixel_share
    edges = np.flatnonzero(np.isfinite(step) & (step > 2 * _SURFACE_M) & chosen)
    swap = rng.random(len(edges)) < 0.5
    main, other = np.where(swap, right[edges], left[edges]), np.where(swap, left[edges], right[edges])
    share = 0.5 + 0.5 * rng.random(len(edges))
    first, second = echoes.range_m[main], echoes.range_m[other]
    main_power = share * echoes.reflectance[main] / first**2
    other_power = (1 - share) * echoes.reflectance[other] / second**2
    total = np.maximum(main_power + other_power, 1e-30)
    mixed = (main_power * first + other_power * second) / total
    clear = np.minimum(np.abs(mixed - first), np.abs(mixed - second)) > _SURFACE_M
    main, mixed, total = main[clear], mixed[clear], total[clear]
    echoes.range_m[main], echoes.reflectance[main], echoes.label[main] = mixed, total * mixed**2, CLUTTER


def false_returns(
    echoes: Echoes, detected: Ints, min_range_m: float, noise: NoiseParams, rng: Rng
) -> tuple[Ints, Floats, Floats]:
    """Return those of the shots without a detected echo that report a point anyway, with distances and intensities.

    Distances beyond the minimum range are distributed exponentially; intensities are the lowest, 1 to 3.
    """
    if not noise.false_return_share:
        return detected[:0], np.empty(0), np.empty(0)
    silent = np.delete(np.arange(len(echoes.range_m)), detected)
    chosen = silent[rng.random(len(silent)) < noise.false_return_share]
    ranges = min_range_m + noise.false_return_reach_m * rng.standard_exponential(len(chosen))
    return chosen, ranges, rng.integers(1, 4, len(chosen)).astype(np.float64)


def extinction(visibility_km: float) -> float:
    r"""Return the extinction coefficient :math:`\alpha` of air in 1/m for a meteorological visibility (Koschmieder)."""
    return 3.912 / (1000 * visibility_km)
