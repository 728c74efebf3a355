"""Curves of tuning ([Li2023], Fig. 7) and of the training of a classifier ([Bi], Fig. 10)."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Series = NDArray[np.float64]

# Okabe and Ito's colours, distinguishable by colour-blind readers.
_COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442")
_PARTS = (("training", "-"), ("validation", "--"))


def draw_rates(
    figure: "Figure", parameter: str, values: Sequence[str], tuned: Series, held_out: Series, best: int | None
) -> None:
    """Draw the rates of frames with false alarms and with missed targets over K values of a parameter.

    Both rates, shape (2, K), are shares in the frames used for tuning and in those held out, NaN where unknown; if
    nothing is held out, the shape is (2, 0). ``best`` is the index of the best value.
    """
    axes = figure.add_subplot()
    positions = np.arange(len(values))
    names = ("false alarms, $R_{FP}$", "missed targets, $R_{FN}$")
    for name, color, style, rate in zip(names, _COLORS, ("o-", "s--"), tuned, strict=False):
        axes.plot(positions, 100 * rate, style, color=color, markersize=3, label=name)
    for name, color, style, size, rate in zip(names, _COLORS, ("o:", "s:"), (6, 3.5), held_out, strict=False):
        if len(rate):
            (line,) = axes.plot(positions, 100 * rate, style, color=color, markersize=size, label=f"{name}, held out")
            line.set(markerfacecolor="white", linewidth=0.8, clip_on=False)  # where one covers the other, both show
    if best is not None:
        axes.axvline(best, color="0.7", linewidth=0.8, zorder=0)
        axes.annotate("best", (best, 1), xycoords=("data", "axes fraction"), xytext=(2, -8), textcoords="offset points")
    axes.set_xticks(positions, values, rotation=0 if len(values) <= 6 else 60)
    axes.set(xlabel=parameter, ylabel="Frames (%)", ylim=(0, None))
    figure.legend(loc="outside upper center", ncols=2)


def draw_thresholds(
    figure: "Figure", ring: str, curves: Mapping[str, Series], ideal: Series, *, title: str | None = None
) -> None:
    """Draw the threshold of a range ring over N frames for several parameter values, with the ideal threshold.

    All curves have shape (N,); the ideal one is NaN where it is undefined. ``title`` is that of the legend.
    """
    axes = figure.add_subplot()
    frames = np.arange(len(ideal))
    axes.plot(frames, ideal, ".", color="0.55", markersize=2, label="ideal", zorder=1)
    for (name, curve), color in zip(curves.items(), _COLORS * len(curves), strict=False):
        axes.plot(frames, curve, color=color, linewidth=0.9, label=name)
    known = np.concatenate([ideal[np.isfinite(ideal)], *curves.values()])
    if len(known):
        axes.set_ylim(0, 1.3 * float(np.quantile(known, 0.98)))
    axes.set(xlabel="Frame", ylabel=f"Threshold, {ring}")
    longest = max(len(name) for name in curves)
    figure.legend(loc="outside upper center", ncols=max(1, min(len(curves) + 1, 50 // (longest + 6))), title=title)


def draw_training(figure: "Figure", loss: Series, precision: Series, best: int) -> None:
    """Draw loss and precision over E epochs, one above the other, and mark the best epoch, counted from 0.

    Both have shape (2, E), on training and validation data; the precision is a share.
    """
    upper, lower = figure.subplots(2, sharex=True)
    epochs = np.arange(1, loss.shape[1] + 1)
    for axes, curves, name in ((upper, loss, "Loss"), (lower, precision, "Precision")):
        for curve, (part, line), color in zip(curves, _PARTS, _COLORS, strict=False):
            axes.plot(epochs, curve, line, color=color, label=part, marker="." if len(epochs) == 1 else None)
        axes.axvline(best + 1, color="0.7", linewidth=0.8, zorder=0)
        axes.set_ylabel(name)
    # The loss of a single early epoch can be larger by orders of magnitude.
    upper.set_ylim(0, max(1.2 * float(np.nanquantile(loss, 0.95)), 1e-3))
    lower.set_ylim(min(0.9, float(np.nanquantile(precision, 0.05))) - 0.02, 1.01)
    lower.annotate("best", (best + 1, 0), xycoords=("data", "axes fraction"), xytext=(2, 3), textcoords="offset points")
    lower.set_xlabel("Epoch")
    figure.legend(*upper.get_legend_handles_labels(), loc="outside upper center", ncols=2)
