"""Figures of tuning, by their axes."""

import numpy as np
import pytest

from seaclutter_cli.plots.tuning import draw_rates

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
