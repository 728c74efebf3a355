"""What the receiver of a lidar makes of echoes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.simulation.lidar.echoes import Echoes
from seaclutter_cli.simulation.lidar.models import Lidar
from seaclutter_cli.simulation.lidar.noise import NoiseParams, lost_ranges, mix_edges
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
    r"""Makes points of echoes.

    Parameters
    ----------
    lidar : Lidar
        What is measured with.
    noise : NoiseParams
        What it reports that is not there.
    extinction : float
        Extinction coefficient of air in 1/m.
    dropout : float
        Share of echoes that get lost.

    Notes
    -----
    The intensity is Eq. 2 of S0 with a linear receiver:
    :math:`I = G \, \rho \cos\theta \, e^{-2 \alpha R} / R^2`, rounded to a whole number and cut at 255, with :math:`G`
    such that a surface of reflectivity 0.1 gives 1 at the range that the maker states for it. An echo is lost where,
    with the noise of the receiver, it would be below 1.
    """

    lidar: Lidar
    noise: NoiseParams
    extinction: float
    dropout: float

    def receive(
        self, echoes: Echoes, times_s: Floats, rng: np.random.Generator
    ) -> tuple[NDArray[np.void], NDArray[np.int64], Floats]:
        """Return the points of a turn, which shots they are of, and their distances.

        Parameters
        ----------
        echoes : Echoes
            What each shot meets; changed by the noise.
        times_s : ndarray, shape (C, K), float64
            When each shot is fired.
        rng : numpy.random.Generator
            Source of chance.

        Returns
        -------
        (ndarray, shape (M,), `POINT`), (ndarray, shape (M,), int64), (ndarray, shape (M,), float64)
        """
        mix_edges(echoes, self.lidar.columns, self.noise, rng)
        chosen, measured, power = self._echoed(echoes, rng)
        label = echoes.label[chosen]
        silent = np.setdiff1d(np.arange(len(echoes.range_m)), chosen) if self.noise.false_return_share else chosen[:0]
        lost, near, weak = lost_ranges(silent, self.lidar.min_range_m, self.noise, rng)
        if len(lost):
            order = np.argsort(np.concatenate((chosen, lost)), kind="stable")
            chosen, measured = np.concatenate((chosen, lost))[order], np.concatenate((measured, near))[order]
            power = np.concatenate((power, weak))[order]
            label = np.concatenate((label, np.full(len(lost), CLUTTER, np.uint16)))[order]
        return self._points(chosen, measured, power, label, times_s), chosen, measured

    def _echoed(self, echoes: Echoes, rng: np.random.Generator) -> tuple[NDArray[np.int64], Floats, Floats]:
        """Return the shots whose echo is heard, the distances measured and the power received."""
        lidar = self.lidar
        some = np.flatnonzero(echoes.reflectance > 0)
        range_m = echoes.range_m[some]
        power = lidar.gain * echoes.reflectance[some] / np.maximum(range_m, lidar.min_range_m) ** 2
        power *= np.exp(-2 * self.extinction * range_m)
        power += 0.25 * rng.standard_normal(len(some)) * np.sqrt(1 + 0.05 * power)
        kept = (power >= 1) & (range_m >= lidar.min_range_m) & (range_m <= lidar.max_range_m)
        kept &= rng.random(len(some)) >= self.dropout
        measured = range_m[kept] + lidar.range_noise_m * rng.standard_normal(int(kept.sum()))
        return some[kept], measured, power[kept]

    def _points(
        self, chosen: NDArray[np.int64], measured: Floats, power: Floats, label: NDArray[np.uint16], times_s: Floats
    ) -> NDArray[np.void]:
        lidar = self.lidar
        points = np.empty(len(chosen), POINT)
        place = lidar.lenses.reshape(-1, 3)[chosen] + lidar.directions.reshape(-1, 3)[chosen] * measured[:, None]
        points["x"], points["y"], points["z"] = place.T
        points["intensity"] = np.minimum(np.floor(power), 255.0)
        points["ring"] = lidar.rings[chosen % len(lidar.elevations_deg)]
        points["timestamp"] = times_s.reshape(-1)[chosen]
        points["label"] = label
        return points
