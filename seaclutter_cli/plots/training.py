"""Training curves of a classifier: loss and precision over the epochs ([Bi], Fig. 10)."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Series = NDArray[np.float64]

_PARTS = (("training", "-", "#0072B2"), ("validation", "--", "#D55E00"))


def draw_training(figure: "Figure", loss: Series, precision: Series, best: int) -> None:
    """Draw loss and precision over the epochs, one above the other.

    Parameters
    ----------
    figure : Figure
        Empty figure.
    loss, precision : ndarray, shape (2, E), float64
        Mean loss, and mean precision of the classes from 0 to 1, on training and validation data.
    best : int
        Index of the best epoch, from 0.
    """
    upper, lower = figure.subplots(2, sharex=True)
    epochs = np.arange(1, loss.shape[1] + 1)
    for axes, curves, name in ((upper, loss, "Loss"), (lower, precision, "Precision")):
        for curve, (part, line, color) in zip(curves, _PARTS, strict=True):
            axes.plot(epochs, curve, line, color=color, label=part, marker="." if len(epochs) == 1 else None)
        axes.axvline(best + 1, color="0.7", linewidth=0.8, zorder=0)
        axes.set_ylabel(name)
    # The loss of a single early epoch can be larger by orders of magnitude.
    upper.set_ylim(0, max(1.2 * float(np.nanquantile(loss, 0.95)), 1e-3))
    lower.set_ylim(min(0.9, float(np.nanquantile(precision, 0.05))) - 0.02, 1.01)
    lower.annotate("best", (best + 1, 0), xycoords=("data", "axes fraction"), xytext=(2, 3), textcoords="offset points")
    lower.set_xlabel("Epoch")
    figure.legend(*upper.get_legend_handles_labels(), loc="outside upper center", ncols=2)
