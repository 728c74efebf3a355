"""Curves of tuning and training, by their axes and of any values."""

import io

import numpy as np
import pytest
from PIL import Image

from seaclutter_cli.plots.curves import draw_rates, draw_training
from seaclutter_cli.plots.figure import render

figures = pytest.importorskip("matplotlib.figure")
RATES = np.array([[0.5, 0.1, 0.2], [0.0, 0.3, np.nan]])


@pytest.mark.parametrize("held_out", [np.empty((2, 0)), RATES / 2])
def test_tuned_and_held_out_rates(held_out):
    figure = figures.Figure()
    draw_rates(figure, "update_weight", ["0.2", "0.4", "0.6"], RATES, held_out, 1)
    curves = {line.get_label(): line.get_ydata() for line in figure.axes[0].get_lines() if "$" in line.get_label()}
    names = ["false alarms, $R_{FP}$", "missed targets, $R_{FN}$"]
    expected = dict(zip(names, RATES, strict=True))
    if held_out.size:
        expected |= {f"{name}, held out": rates for name, rates in zip(names, held_out, strict=True)}
    assert list(curves) == list(expected)
    for name, rates in expected.items():
        np.testing.assert_allclose(curves[name], 100 * rates)


EPOCHS = np.arange(30)
CURVES = {
    "usual": (np.stack((np.exp(-EPOCHS / 5), np.exp(-EPOCHS / 6))), 1 - 0.4 * np.exp(-EPOCHS[None] / [[4], [5]]), 20),
    "one epoch": (np.array([[0.7], [0.6]]), np.array([[0.5], [0.0]]), 0),
    "perfect": (np.zeros((2, 5)), np.ones((2, 5)), 4),
    "an outlier": (np.array([[0.7, 0.1, 0.1], [900.0, 0.1, 0.1]]), np.array([[0.5, 1, 1], [0.0, 1, 1]]), 1),
}


@pytest.mark.parametrize("name", CURVES)
def test_any_values_can_be_drawn(name):
    with Image.open(io.BytesIO(render(lambda figure: draw_training(figure, *CURVES[name]), ".png"))) as image:
        assert image.width == 1050


def test_axes_and_curves():
    figure = figures.Figure()
    loss, precision, best = CURVES["usual"]
    draw_training(figure, loss, precision, best)
    upper, lower = figure.axes
    assert (upper.get_ylabel(), lower.get_ylabel(), lower.get_xlabel()) == ("Loss", "Precision", "Epoch")
    np.testing.assert_array_equal(upper.lines[0].get_ydata(), loss[0])
    np.testing.assert_array_equal(lower.lines[1].get_ydata(), precision[1])
    assert lower.lines[2].get_xdata()[0] == best + 1
    assert lower.get_ylim()[1] > 1
