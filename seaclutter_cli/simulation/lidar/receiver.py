"""The receiver of a lidar, which converts echoes to points."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.simulation.lidar.echoes import Echoes
from seaclutter_cli.simulation.lidar.models import Lidar
from seaclutter_cli.simulation.lidar.noise import NoiseParams, add_mixed_pixels, false_returns
from seaclutter_cli.truth import CLUTTER

Floats = NDArray[np.float64]

POINT = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("intensity", "<f4"),
        ("ring", "<u2"),
        ("timestamp", "<f8"),
        ("label", "<u2"),
    ]
)
"""A simulated point: the fields of RoboSense's driver and the truth, as in `seaclutter_cli.truth`."""


@dataclass(frozen=True)
class Receiver:
    r"""Converter of echoes to points.

    Parameters
    ----------
    lidar : Lidar
        The lidar.
    noise : NoiseParams
        Its false returns.
    extinction : float
        Extinction coefficient of air in 1/m.
    dropout : float
        Share of the echoes that are lost.

    Notes
    -----
    The intensity is Eq. 2 of [Li2023] with a linear receiver:
    :math:`I = G \, \rho \cos\theta \, e^{-2 \alpha R} / R^2`, rounded down to a whole number and limited to 255.
    :math:`G` is the gain with which a surface of reflectivity 0.1 gives 1 at the range that the maker states for it. An
    echo is lost if it is below 1 with the noise of the receiver.
    """

    lidar: Lidar
    noise: NoiseParams
    extinction: float
    dropout: float

    def receive(
        self, echoes: Echoes, times_s: Floats, rng: np.random.Generator
    ) -> tuple[NDArray[np.void], NDArray[np.int64], Floats]:
        """Return the points of a frame, the shot of each point, and its distance.

        Parameters
        ----------
        echoes : Echoes
            Surface that each shot hits; changed by the noise.
        times_s : ndarray, shape (C, K), float64
            Firing time of each shot.
        rng : numpy.random.Generator
            Source of randomness.

        Returns
        -------
        (ndarray, shape (M,), `POINT`), (ndarray, shape (M,), int64), (ndarray, shape (M,), float64)
        """
        add_mixed_pixels(echoes, self.lidar.columns, self.noise, rng)
        chosen, measured, power = self._detect(echoes, rng)
        label = echoes.label[chosen]
        silent = np.setdiff1d(np.arange(len(echoes.range_m)), chosen) if self.noise.false_return_share else chosen[:0]
        spurious, spurious_range, spurious_power = false_returns(silent, self.lidar.min_range_m, self.noise, rng)
        if len(spurious):
            order = np.argsort(np.concatenate((chosen, spurious)), kind="stable")
            chosen, measured = (
                np.concatenate((chosen, spurious))[order],
                np.concatenate((measured, spurious_range))[order],
            )
            power = np.concatenate((power, spurious_power))[order]
            label = np.concatenate((label, np.full(len(spurious), CLUTTER, np.uint16)))[order]
        return self._points(chosen, measured, power, label, times_s), chosen, measured

    def _detect(self, echoes: Echoes, rng: np.random.Generator) -> tuple[NDArray[np.int64], Floats, Floats]:
        """Return the shots with a detected echo, the measured distances and the received power."""
        lidar = self.lidar
        reflecting = np.flatnonzero(echoes.reflectance > 0)
        range_m = echoes.range_m[reflecting]
        power = lidar.gain * echoes.reflectance[reflecting] / np.maximum(range_m, lidar.min_range_m) ** 2
        power *= np.exp(-2 * self.extinction * range_m)
        power += 0.25 * rng.standard_normal(len(reflecting)) * np.sqrt(1 + 0.05 * power)
        kept = (power >= 1) & (range_m >= lidar.min_range_m) & (range_m <= lidar.max_range_m)
        kept &= rng.random(len(reflecting)) >= self.dropout
        measured = range_m[kept] + lidar.range_noise_m * rng.standard_normal(int(kept.sum()))
        return reflecting[kept], measured, power[kept]

    def _points(
        self, chosen: NDArray[np.int64], measured: Floats, power: Floats, label: NDArray[np.uint16], times_s: Floats
    ) -> NDArray[np.void]:
        lidar = self.lidar
        points = np.empty(len(chosen), POINT)
        position = lidar.lenses.reshape(-1, 3)[chosen] + lidar.directions.reshape(-1, 3)[chosen] * measured[:, None]
        points["x"], points["y"], points["z"] = position.T
        points["intensity"] = np.minimum(np.floor(power), 255.0)
        points["ring"] = lidar.rings[chosen % len(lidar.elevations_deg)]
        points["timestamp"] = times_s.reshape(-1)[chosen]
        points["label"] = label
        return points
