"""Figure of the spacing of points over range."""

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from matplotlib.figure import Figure

from seaclutter_cli.plots.density import draw_density
from seaclutter_cli.plots.figure import render

RANGES = np.linspace(1, 50, 5)
SPACINGS = {"one": (RANGES, 0.01 * RANGES), "other": (RANGES[:2], 0.002 * RANGES[:2])}
SLOPE = RANGES, np.ones(5)


def test_every_lidar_is_drawn_and_named():
    figure = Figure()
    draw_density(figure, SPACINGS, SLOPE)
    upper, lower = figure.axes
    assert [line.get_ydata().tolist() for line in upper.lines] == [(0.01 * RANGES).tolist(), [0.002, 0.002 * 13.25]]
    assert [text.get_text() for text in upper.texts] == ["one", "other"]
    assert len(lower.lines) == 2


@pytest.mark.parametrize("suffix", [".svg", ".png"])
def test_the_same_bytes_each_time(suffix):
    first, second = (render(lambda figure: draw_density(figure, SPACINGS, SLOPE), suffix) for _ in range(2))
    assert first == second
