"""Shots of a frame, the nearest surface that each hits, and the receiver that converts their echoes to points.

The noise of the receiver is of the two kinds in [Bi].
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Floats, Ints, Rng, Rows
from seaclutter_cli.sensors.packets import point_dtype
from seaclutter_cli.simulation.lidar.models import Lidar, NoiseParams
from seaclutter_cli.truth import CLUTTER

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
    edges = np.flatnonzero(
        np.isfinite(step) & (step > 2 * _SURFACE_M) & (rng.random(len(left)) < noise.mixed_pixel_share)
    )
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
