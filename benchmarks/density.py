"""The figure of docs/density.md: spacing over range for the built-in lidars.

Run as ``python benchmarks/density.py docs/density.svg``.
"""

import sys
from pathlib import Path

import numpy as np

from seaclutter_cli.plots.density import draw_density
from seaclutter_cli.plots.figure import render
from seaclutter_cli.sensors.density import STEPS_DEG, mean_spacing

UNIT = (1.0, 1.0)
FARTHEST_M = {"CE30-D": 28.0}


def steps_by_names() -> dict[str, tuple[float, float]]:
    """Return the steps between beams in radians by lidar; lidars with equal steps share an entry."""
    names: dict[tuple[float, float], list[str]] = {}
    for name, steps in STEPS_DEG.items():
        names.setdefault(steps, []).append(name)
    return {",\n".join(same): tuple(np.radians(steps)) for steps, same in names.items()}


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
