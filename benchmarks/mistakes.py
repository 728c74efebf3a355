"""Pictures of separated tiles: where sea and non-sea points are right, and where not."""

from typing import Any

import numpy as np

from seaclutter_cli.plots.figure import render

COLORS = {
    "no points": "#FFFFFF",
    "sea": "#C6DBEF",
    "not sea": "#BDB088",
    "called sea, but is not": "#D55E00",
    "not called sea, but is": "#CC79A7",
}
CELL_M = 2.0


def picture(xyz: Any, truth: Any, sea: Any) -> bytes:
    """Return a top view (PNG) of points, shape (3, N), by whether they are sea, and were called sea, shape (N,).

    A cell has the colour of most of its points.
    """
    x, y = (((xyz[axis] - xyz[axis].min()) / CELL_M).astype(np.int64) for axis in (0, 1))
    which = np.select([truth & sea, ~truth & ~sea, ~truth & sea], [1, 2, 3], 4)
    shape = y.max() + 1, x.max() + 1, len(COLORS)
    counts = np.bincount((y * shape[1] + x) * shape[2] + which, minlength=int(np.prod(shape))).reshape(shape)
    colors = np.array([[int(color[at : at + 2], 16) for at in (1, 3, 5)] for color in COLORS.values()], np.uint8)

    def draw(figure: Any) -> None:
        axes = figure.add_subplot()
        extent = (0, shape[1] * CELL_M, 0, shape[0] * CELL_M)
        axes.imshow(colors[counts.argmax(axis=2)], origin="lower", extent=extent, interpolation="nearest")
        for name, color in list(COLORS.items())[1:]:
            axes.scatter([], [], s=14, color=color, label=name)
        axes.set_xlabel("x (m)")
        axes.set_ylabel("y (m)")
        figure.legend(loc="outside upper center", ncols=2, handletextpad=0.2, columnspacing=1.0)

    return render(draw, ".png", aspect=0.85)
