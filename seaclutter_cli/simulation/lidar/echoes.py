"""Shots of a frame, the nearest surface that each shot hits, and its reflectance."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


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

    @cached_property
    def spread_m(self) -> float:
        """Largest distance of an origin from the first one, in metres."""
        return float(np.linalg.norm(self.origins - self.origins[0], axis=1).max())

    @cached_property
    def _by_azimuth(self) -> tuple[Floats, NDArray[np.int64]]:
        order = np.argsort(self.azimuths, kind="stable")
        return self.azimuths[order], order

    def between(self, first: float, last: float) -> NDArray[np.int64]:
        """Return the shots from one azimuth counter-clockwise to another, both in radians, in firing order."""
        if last - first >= 2 * np.pi:
            return np.arange(len(self))
        azimuths, order = self._by_azimuth
        first, last = (first + np.pi) % (2 * np.pi) - np.pi, (last + np.pi) % (2 * np.pi) - np.pi
        start, end = np.searchsorted(azimuths, first), np.searchsorted(azimuths, last, side="right")
        chosen = order[start:end] if first <= last else np.concatenate((order[start:], order[:end]))
        return np.sort(chosen)

    def towards(self, azimuth: float, half: float) -> NDArray[np.int64]:
        """Return the shots within an angle of an azimuth, both in radians."""
        off = np.abs((self.azimuths - azimuth + np.pi) % (2 * np.pi) - np.pi)
        return np.flatnonzero(off <= half)


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

    def add(self, shots: NDArray[np.int64], range_m: Floats, reflectance: Floats, label: int) -> None:
        """Update the shots whose new hits are nearer than their previous ones."""
        nearer = range_m < self.range_m[shots]
        chosen = shots[nearer]
        self.range_m[chosen] = range_m[nearer]
        self.reflectance[chosen] = reflectance[nearer]
        self.label[chosen] = label
