"""What tuning found: rates over a parameter, and a ring's threshold over the frames (S0, Fig. 7)."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Series = NDArray[np.float64]

# Okabe and Ito's colours, told apart by colour-blind readers.
_COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442")


def draw_rates(
    figure: "Figure", parameter: str, values: Sequence[str], r_fp: Series, r_fn: Series, best: int | None
) -> None:
    """Draw the rates of false and omitted alarms over the values of a parameter.

    Parameters
    ----------
    figure : Figure
        Empty.
    parameter : str
        Its name.
    values : sequence of str
        What was tried, K values.
    r_fp, r_fn : ndarray, shape (K,), float64
        Shares of frames, 0 to 1; NaN where unknown.
    best : int or None
        Which value is best.
    """
    axes = figure.add_subplot()
    places = np.arange(len(values))
    axes.plot(places, 100 * r_fp, "o-", color=_COLORS[0], markersize=3, label="false alarms, $R_{FP}$")
    axes.plot(places, 100 * r_fn, "s--", color=_COLORS[1], markersize=3, label="omitted alarms, $R_{FN}$")
    if best is not None:
        axes.axvline(best, color="0.7", linewidth=0.8, zorder=0)
        axes.annotate("best", (best, 1), xycoords=("data", "axes fraction"), xytext=(2, -8), textcoords="offset points")
    axes.set_xticks(places, values, rotation=0 if len(values) <= 6 else 60)
    axes.set_xlabel(parameter)
    axes.set_ylabel("frames (%)")
    axes.set_ylim(bottom=0)
    figure.legend(loc="outside upper center", ncols=2)


def draw_thresholds(
    figure: "Figure", ring: str, curves: Mapping[str, Series], ideal: Series, *, title: str | None = None
) -> None:
    """Draw a ring's intensity threshold over the frames for several values beside the ideal one (Fig. 7).

    Parameters
    ----------
    figure : Figure
        Empty.
    ring : str
        Which ring, for the label of the axis.
    curves : mapping of str to ndarray, shape (N,), float64
        Thresholds by the name of the value.
    ideal : ndarray, shape (N,), float64
        Ideal threshold; NaN where there is none.
    title : str, optional
        What the names are values of.
    """
    axes = figure.add_subplot()
    frames = np.arange(len(ideal))
    axes.plot(frames, ideal, ".", color="0.55", markersize=2, label="ideal", zorder=1)
    for (name, curve), color in zip(curves.items(), _COLORS * len(curves), strict=False):
        axes.plot(frames, curve, color=color, linewidth=0.9, label=name)
    known = np.concatenate([ideal[np.isfinite(ideal)], *curves.values()])
    if len(known):
        axes.set_ylim(0, 1.3 * float(np.quantile(known, 0.98)))
    axes.set_xlabel("frame")
    axes.set_ylabel(f"threshold, {ring}")
    longest = max(len(name) for name in curves)
    figure.legend(loc="outside upper center", ncols=max(1, min(len(curves) + 1, 50 // (longest + 6))), title=title)
