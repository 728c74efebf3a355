"""Spacing and density of lidar points by distance ([Bi], Eq. 1 to 4); docs/density.md derives the equations."""

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
"""Horizontal and vertical angle between neighbouring beams, in degrees, at 10 revolutions per second.

For unevenly spaced beams, the vertical angle is that of the dense part around the horizon. CE30-D is the solid-state
lidar of [Bi]: 60° by 4°, 320 by 20 pixels.
"""


def points_in_rectangle(distance_m: ArrayLike, size_m: tuple[float, float], steps_rad: tuple[float, float]) -> Values:
    r"""Return the mean number of points on a rectangle that faces the lidar ([Bi], Eq. 1).

    .. math:: m = \frac{2 \arctan(w / 2l)}{r_h} \cdot \frac{2 \arctan(h / 2l)}{r_v}

    Parameters
    ----------
    distance_m : array_like
        Distance l of its centre in metres; greater than 0.
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
    r"""Return the geometric mean spacing of the points on such a rectangle, in metres ([Bi], Eq. 2).

    .. math:: s = \sqrt{h w / m}

    At long range, it is :math:`l \sqrt{r_h r_v}`. The parameters are those of `points_in_rectangle`.

    Examples
    --------
    >>> mean_spacing([1.0, 10.0, 20.0], (1.0, 1.0), (0.01, 0.01)).round(4)
    array([0.0108, 0.1001, 0.2   ])
    """
    return np.asarray(np.sqrt(size_m[0] * size_m[1] / points_in_rectangle(distance_m, size_m, steps_rad)))


def density(distance_m: ArrayLike, size_m: tuple[float, float], steps_rad: tuple[float, float]) -> Values:
    r"""Return the density in metres ([Bi], Eq. 3): the spacing of a single point minus the mean spacing.

    .. math:: \rho = -s + c, \quad c = \sqrt{h w}

    It is c where points coincide, and 0 where the rectangle contains one point. The parameters are those of
    `points_in_rectangle`.

    Examples
    --------
    >>> density([1e-6, 10.0, 100.0], (1.0, 1.0), (0.01, 0.01)).round(3)
    array([ 0.997,  0.9  , -0.   ])
    """
    return np.asarray(np.sqrt(size_m[0] * size_m[1]) - mean_spacing(distance_m, size_m, steps_rad))


def density_slope(distance_m: ArrayLike, size_m: tuple[float, float], steps_rad: tuple[float, float]) -> Values:
    r"""Return the derivative of the density with respect to distance ([Bi], Eq. 4).

    .. math:: \rho'(l) = -\frac{s}{4} \left( \frac{w}{(l^2 + w^2/4) \arctan(w / 2l)}
        + \frac{h}{(l^2 + h^2/4) \arctan(h / 2l)} \right)

    At long range, it is :math:`-\sqrt{r_h r_v}`. The parameters are those of `points_in_rectangle`.

    Examples
    --------
    >>> density_slope([1e-6, 1.5, 15.0], (1.0, 1.0), (0.01, 0.01)).round(5)
    array([-0.00405, -0.00966, -0.01   ])
    """
    distance = np.asarray(distance_m, np.float64)
    sides = (side / ((distance**2 + side**2 / 4) * np.arctan(side / (2 * distance))) for side in size_m)
    return np.asarray(-mean_spacing(distance, size_m, steps_rad) / 4 * sum(sides))


def radius_ratio(steps_deg: tuple[float, float], spacings: float) -> float:
    r"""Return the ratio of search radius to range, :math:`K = a \sqrt{r_h r_v}`, with ``spacings`` as a.

    The radius is a times the point spacing: a disc of this radius on a surface that faces the lidar contains about
    :math:`\pi a^2` points at any range.

    Examples
    --------
    >>> round(radius_ratio(STEPS_DEG["RS-LiDAR-32"], 3.3), 4)
    0.0149
    """
    return float(spacings * np.sqrt(np.prod(np.radians(steps_deg))))
