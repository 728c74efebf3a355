"""Spacing of the points of a lidar over range, and its slope ([Bi], Fig. 5 to 8)."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Series = NDArray[np.float64]

# Okabe and Ito's colours, distinguishable by colour-blind readers.
_COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#444444")


def draw_density(figure: "Figure", spacings: Mapping[str, tuple[Series, Series]], slope: tuple[Series, Series]) -> None:
    """Draw the spacing over range for several lidars and, below it, the slope at short range for one lidar.

    Parameters
    ----------
    figure : Figure
        Empty figure.
    spacings : mapping of str to tuple of ndarray
        By the name of the lidar: ascending ranges, shape (N,), and mean spacings there, both in metres.
    slope : tuple of ndarray
        Ranges in metres, shape (M,), and the slope of the spacing there relative to the slope far away.
    """
    upper, lower = figure.subplots(2, 1, height_ratios=(2.2, 1))
    farthest = max(range_m[-1] for range_m, _ in spacings.values())
    for (name, (range_m, spacing_m)), color in zip(spacings.items(), _COLORS * len(spacings), strict=False):
        upper.plot(range_m, spacing_m, color=color)
        text = {"xytext": (4, 0), "textcoords": "offset points", "va": "center", "fontsize": 6.5, "color": color}
        upper.annotate(name, (range_m[-1], spacing_m[-1]), annotation_clip=False, **text)
    upper.set_xlim(0, 1.42 * farthest)
    upper.set_ylim(bottom=0)
    upper.set_xticks(np.linspace(0, farthest, 5))
    upper.set_xlabel("Range $l$ (m)")
    upper.set_ylabel("Mean spacing $s$ (m)")
    lower.plot(*slope, color=_COLORS[0])
    lower.axhline(1, color="0.7", linewidth=0.8, zorder=0)
    lower.set_xlim(0, np.ceil(slope[0][-1]))
    lower.set_ylim(0, 1.1)
    lower.set_xlabel("Range $l$ (m)")
    lower.set_ylabel("$s'(l) / \\sqrt{r_h r_v}$")
    for axes in (upper, lower):
        axes.spines[["top", "right"]].set_visible(False)
    upper.spines["bottom"].set_bounds(0, farthest)
