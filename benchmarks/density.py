"""Spacing and density of lidar points by distance ([Bi], Eq. 1 to 4); docs/density.md derives the equations.

``python benchmarks/density.py docs/density.svg`` draws its figure: spacing over range for the built-in lidars.
"""

import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from seaclutter_cli.plots.figure import render

Series = NDArray[np.float64]

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


def points_in_rectangle(distance_m: ArrayLike, size_m: tuple[float, float], steps_rad: tuple[float, float]) -> Series:
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


def mean_spacing(distance_m: ArrayLike, size_m: tuple[float, float], steps_rad: tuple[float, float]) -> Series:
    r"""Return the geometric mean spacing of the points on such a rectangle, in metres ([Bi], Eq. 2).

    .. math:: s = \sqrt{h w / m}

    At long range, it is :math:`l \sqrt{r_h r_v}`. The parameters are those of `points_in_rectangle`.

    Examples
    --------
    >>> mean_spacing([1.0, 10.0, 20.0], (1.0, 1.0), (0.01, 0.01)).round(4)
    array([0.0108, 0.1001, 0.2   ])
    """
    return np.asarray(np.sqrt(size_m[0] * size_m[1] / points_in_rectangle(distance_m, size_m, steps_rad)))


def density(distance_m: ArrayLike, size_m: tuple[float, float], steps_rad: tuple[float, float]) -> Series:
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


def density_slope(distance_m: ArrayLike, size_m: tuple[float, float], steps_rad: tuple[float, float]) -> Series:
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


UNIT = (1.0, 1.0)
FARTHEST_M = {"CE30-D": 28.0}
# Okabe and Ito's colours, distinguishable by colour-blind readers.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#444444")


def steps_by_names() -> dict[str, tuple[float, float]]:
    """Return the steps between beams in radians by lidar; lidars with equal steps share an entry."""
    names: dict[tuple[float, float], list[str]] = {}
    for name, steps in STEPS_DEG.items():
        names.setdefault(steps, []).append(name)
    return {",\n".join(same): tuple(np.radians(steps)) for steps, same in names.items()}


def draw_density(figure: Figure, spacings: Mapping[str, tuple[Series, Series]], slope: tuple[Series, Series]) -> None:
    """Draw the spacing over range for several lidars and, below it, the slope at short range for one lidar."""
    upper, lower = figure.subplots(2, 1, height_ratios=(2.2, 1))
    farthest = max(range_m[-1] for range_m, _ in spacings.values())
    for (name, (range_m, spacing_m)), color in zip(spacings.items(), COLORS * len(spacings), strict=False):
        upper.plot(range_m, spacing_m, color=color)
        text = {"xytext": (4, 0), "textcoords": "offset points", "va": "center", "fontsize": 6.5, "color": color}
        upper.annotate(name, (range_m[-1], spacing_m[-1]), annotation_clip=False, **text)
    upper.set_xlim(0, 1.42 * farthest)
    upper.set_ylim(bottom=0)
    upper.set_xticks(np.linspace(0, farthest, 5))
    upper.set_xlabel("Range $l$ (m)")
    upper.set_ylabel("Mean spacing $s$ (m)")
    lower.plot(*slope, color=COLORS[0])
    lower.axhline(1, color="0.7", linewidth=0.8, zorder=0)
    lower.set_xlim(0, np.ceil(slope[0][-1]))
    lower.set_ylim(0, 1.1)
    lower.set_xlabel("Range $l$ (m)")
    lower.set_ylabel("$s'(l) / \\sqrt{r_h r_v}$")
    for axes in (upper, lower):
        axes.spines[["top", "right"]].set_visible(False)
    upper.spines["bottom"].set_bounds(0, farthest)


def main() -> None:
    target = Path(sys.argv[1])
    spacings = {}
    for name, steps in steps_by_names().items():
        range_m = np.linspace(0.05, FARTHEST_M.get(name, 100.0), 200)
        spacings[name] = range_m, mean_spacing(range_m, UNIT, steps)
    near = np.linspace(0.01, 5, 300)
    slope = near[:-1], np.diff(mean_spacing(near, UNIT, (1e-3, 1e-3))) / np.diff(near) / 1e-3
    target.write_bytes(render(lambda figure: draw_density(figure, spacings, slope), target.suffix, aspect=1.05))


if __name__ == "__main__":
    main()
