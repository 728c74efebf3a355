"""How far apart the points of a lidar are at a distance (S3, Eq. 1 to 4); docs/density.md derives it."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

Values = NDArray[np.float64]

STEPS_DEG: Mapping[str, tuple[float, float]] = {
    "RS-LiDAR-32": (0.2, 1 / 3),
    "RS-LiDAR-16": (0.2, 2.0),
    "VLP-16": (0.2, 2.0),
    "OS1-64": (360 / 1024, 45 / 63),
    "OS1-128": (360 / 1024, 45 / 127),
    "PandarXT-32": (0.18, 1.0),
    "Pandar40P": (0.2, 1 / 3),
    "CE30-D": (60 / 320, 4 / 20),
}
"""Horizontal and vertical angle between neighbouring beams, in degrees, at 10 turns a second.

Of lidars whose beams are unevenly spread, the vertical one is that of the dense part, about the horizon. CE30-D is the
solid-state lidar of S3: 60° by 4°, 320 by 20 pixels.
"""


def points_in_rectangle(distance_m: ArrayLike, size_m: tuple[float, float], steps_rad: tuple[float, float]) -> Values:
    r"""Return how many points a rectangle that faces the lidar has on average (S3, Eq. 1).

    .. math:: m = \frac{2 \arctan(w / 2l)}{r_h} \cdot \frac{2 \arctan(h / 2l)}{r_v}

    Parameters
    ----------
    distance_m : array_like
        Distance l of its centre in metres; more than 0.
    size_m : tuple of float
        Width w and height h in metres.
    steps_rad : tuple of float
        Angles between neighbouring beams, horizontal and vertical, :math:`r_h` and :math:`r_v`, in radians.

    Examples
    --------
    >>> points_in_rectangle([1.0, 10.0, 20.0], (1.0, 1.0), (0.01, 0.02)).round(1)
    array([4299.4,   49.9,   12.5])
    """
    half = np.arctan(np.divide.outer(np.asarray(size_m) / 2, np.asarray(distance_m, np.float64)))
    return np.asarray(4 * half[0] * half[1] / (steps_rad[0] * steps_rad[1]))


def mean_spacing(distance_m: ArrayLike, size_m: tuple[float, float], steps_rad: tuple[float, float]) -> Values:
    r"""Return the geometric mean spacing of the points in such a rectangle, in metres (S3, Eq. 2).

    .. math:: s = \sqrt{h w / m}

    Far away it is :math:`l \sqrt{r_h r_v}`. Parameters are those of `points_in_rectangle`.

    Examples
    --------
    >>> mean_spacing([1.0, 10.0, 20.0], (1.0, 1.0), (0.01, 0.01)).round(4)
    array([0.0108, 0.1001, 0.2   ])
    """
    return np.asarray(np.sqrt(size_m[0] * size_m[1] / points_in_rectangle(distance_m, size_m, steps_rad)))


def density(distance_m: ArrayLike, size_m: tuple[float, float], steps_rad: tuple[float, float]) -> Values:
    r"""Return the density as S3 has it, in metres: how much less than that of a single point the spacing is (Eq. 3).

    .. math:: \rho = -s + c, \quad c = \sqrt{h w}

    It is c where points lie together, and 0 where the rectangle has one. Parameters are those of
    `points_in_rectangle`.

    Examples
    --------
    >>> density([1e-6, 10.0, 100.0], (1.0, 1.0), (0.01, 0.01)).round(3)
    array([ 0.997,  0.9  , -0.   ])
    """
    return np.asarray(np.sqrt(size_m[0] * size_m[1]) - mean_spacing(distance_m, size_m, steps_rad))


def density_slope(distance_m: ArrayLike, size_m: tuple[float, float], steps_rad: tuple[float, float]) -> Values:
    r"""Return how the density changes with distance (S3, Eq. 4): no more than :math:`-\sqrt{r_h r_v}` far away.

    .. math:: \rho'(l) = -\frac{s}{4} \left( \frac{w}{(l^2 + w^2/4) \arctan(w / 2l)}
        + \frac{h}{(l^2 + h^2/4) \arctan(h / 2l)} \right)

    Parameters are those of `points_in_rectangle`.

    Examples
    --------
    >>> density_slope([1e-6, 1.5, 15.0], (1.0, 1.0), (0.01, 0.01)).round(5)
    array([-0.00405, -0.00966, -0.01   ])
    """
    distance = np.asarray(distance_m, np.float64)
    sides = (side / ((distance**2 + side**2 / 4) * np.arctan(side / (2 * distance))) for side in size_m)
    return np.asarray(-mean_spacing(distance, size_m, steps_rad) / 4 * sum(sides))


def radius_ratio(steps_deg: tuple[float, float], spacings: float) -> float:
    r"""Return the share of the range that is as much as some spacings of points, :math:`K = a \sqrt{r_h r_v}`.

    A disc of that radius on a surface that faces the lidar has about :math:`\pi a^2` points, whatever its range.

    Examples
    --------
    >>> round(radius_ratio(STEPS_DEG["RS-LiDAR-32"], 3.3), 4)
    0.0149
    """
    return float(spacings * np.sqrt(np.prod(np.radians(steps_deg))))
