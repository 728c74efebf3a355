"""Curves over parameters, frames and epochs; clutter and thresholds over range ([Li2023], Fig. 5 to 7)."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Self

import numpy as np

from seaclutter_cli.arrays import Floats, Ints
from seaclutter_cli.calibration import Thresholds

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Okabe and Ito's colours, distinguishable by colour-blind readers.
_COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442")
_PARTS = (("training", "-"), ("validation", "--"))
_COLUMNS = 32
_KEY_BITS = 15
_ROWS = 128


def draw_rates(
    figure: "Figure", parameter: str, values: Sequence[str], tuned: Floats, held_out: Floats, best: int | None
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
    figure: "Figure", ring: str, curves: Mapping[str, Floats], ideal: Floats, *, title: str | None = None
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


def draw_training(figure: "Figure", loss: Floats, precision: Floats, best: int) -> None:
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


class ClutterDensity:
    """Histogram of points by range and intensity in bounded memory, for intensities of any scale.

    A range ring has 32 columns. The row of an intensity is the upper 15 bits of its float32 representation: sign,
    exponent, and six bits that divide each octave into 64 rows. Points beyond ``max_rings`` are left out.
    """

    def __init__(self, start_m: float, ring_width_m: float, max_rings: int) -> None:
        self._start_m, self._width_m, self._columns = start_m, ring_width_m / _COLUMNS, _COLUMNS * max_rings
        self._all_whole = True
        self._cells, self._counts = np.empty(0, np.int64), np.empty(0, np.int64)

    def add(self, range_m: Floats, intensity: Floats) -> None:
        """Count points beyond ``start_m``, given their ranges in metres and their intensities, both of shape (N,)."""
        self._all_whole = self._all_whole and bool((intensity == np.floor(intensity)).all())
        column = ((range_m - self._start_m) / self._width_m).clip(0, self._columns).astype(np.int64)
        limit = np.finfo(np.float32).max
        single = np.clip(intensity, -limit, limit).astype(np.float32) + np.float32(0)  # -0 becomes 0
        cells = (column << _KEY_BITS) + (single.view(np.uint32) >> (32 - _KEY_BITS)).astype(np.int64)
        self._count(*np.unique(cells[column < self._columns], return_counts=True))

    def __iadd__(self, other: Self) -> Self:
        self._all_whole = self._all_whole and other._all_whole
        self._count(other._cells, other._counts)
        return self

    def _count(self, cells: Ints, counts: Ints) -> None:
        both = np.append(self._counts, counts)
        self._cells, place = np.unique(np.append(self._cells, cells), return_inverse=True)
        self._counts = np.zeros(len(self._cells), np.int64)
        np.add.at(self._counts, place, both)

    def grid(self, end_m: float, limits: tuple[float, float]) -> tuple[Floats, Floats, Ints]:
        """Return the counts, shape (R, C), up to a range and between intensities, in around 100 rows of equal height.

        The edges of the columns in metres, and those of the rows, come first.
        """
        height = 2.0 ** np.ceil(np.log2((limits[1] - limits[0]) / _ROWS))
        if self._all_whole:
            height = max(height, 1.0)  # a smaller height would leave empty rows between the values
        first, last = np.floor(limits[0] / height), np.ceil(limits[1] / height)
        columns = int(np.ceil((end_m - self._start_m) / self._width_m - 1e-9))
        counts = np.zeros((int(last - first), columns), np.int64)
        column, row = self._cells >> _KEY_BITS, np.floor(self._intensity / height) - first
        shown = (row >= 0) & (row < len(counts)) & (column < columns)
        np.add.at(counts, (row[shown].astype(np.int64), column[shown]), self._counts[shown])
        range_m = np.asarray(self._start_m + self._width_m * np.arange(columns + 1), np.float64)
        return range_m, height * np.arange(first, last + 1), counts

    def quantile(self, share: float) -> float:
        """Return the approximate quantile of the intensities; 0 without points."""
        if not len(self._cells):
            return 0.0
        order = np.argsort(self._intensity, kind="stable")
        below = np.cumsum(self._counts[order])
        return float(self._intensity[order][np.searchsorted(below, share * below[-1])])

    @property
    def _intensity(self) -> Floats:
        key = self._cells & ((1 << _KEY_BITS) - 1)
        # 0 is exact; all other values become the middle of their row.
        half = np.where(key == 0, 0, 1 << (31 - _KEY_BITS)).astype(np.uint32)
        return ((key.astype(np.uint32) << (32 - _KEY_BITS)) + half).view(np.float32).astype(np.float64)


def draw_clutter(figure: "Figure", density: ClutterDensity, found: Thresholds) -> None:
    """Draw the density of clutter, the thresholds of the range rings as a step line, and the far limit."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap, LogNorm

    axes = figure.add_subplot()
    width = found.end_m - found.rings[0].start_m
    reach_m = found.end_m + max(0.12 * width, 2.0)
    range_m, intensity, counts = density.grid(reach_m, _limits(density, found))
    visible = ListedColormap(colormaps["Blues"](np.linspace(0.2, 1, 256)))  # a single point is visible on white
    shown = np.ma.masked_equal(counts, 0)
    norm = LogNorm(vmin=1, vmax=max(10, int(counts.max(initial=1))))
    mesh = axes.pcolormesh(range_m, intensity, shown, norm=norm, cmap=visible, rasterized=True)
    figure.colorbar(mesh, ax=axes, label="Clutter points per cell", pad=0.02, aspect=30)
    edges = [ring.start_m for ring in found.rings] + [found.end_m]
    axes.stairs(
        found.initial_thresholds, edges, baseline=None, linewidth=1.6, color="#d1495b", zorder=3, label="threshold"
    )
    axes.axvline(found.end_m, color="#333333", linewidth=0.9, linestyle="--", label=f"far limit ({found.end_m:g} m)")
    axes.set(xlim=(edges[0], range_m[-1]), ylim=(intensity[0], intensity[-1]))
    axes.set(xlabel="Range (m)", ylabel="Intensity (sensor units)")
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2, borderaxespad=0.2, handlelength=1.6)


def _limits(density: ClutterDensity, found: Thresholds) -> tuple[float, float]:
    """Return the limits of the intensity axis, which include most points and a margin above each threshold."""
    thresholds = found.initial_thresholds
    low = min(0.0, density.quantile(0.001), *thresholds)
    high = max(density.quantile(0.97), *(value + 0.5 * abs(value) for value in thresholds))
    return low, high if high > low else low + 1.0
