"""The figure of docs/density.md: spacing over range for the built-in lidars.

Run as ``python benchmarks/density.py docs/density.svg``.
"""

import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from seaclutter_cli.plots.figure import render
from seaclutter_cli.sensors.density import STEPS_DEG, mean_spacing

Series = NDArray[np.float64]

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
