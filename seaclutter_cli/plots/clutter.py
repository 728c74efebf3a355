"""Intensity of clutter over range, with the thresholds of the range rings ([Li2023], Fig. 5 and 6)."""

from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.calibration import Thresholds

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

_COLUMNS = 32
_KEY_BITS = 15
_ROWS = 128


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

    def _count(self, cells: NDArray[np.int64], counts: NDArray[np.int64]) -> None:
        both = np.append(self._counts, counts)
        self._cells, place = np.unique(np.append(self._cells, cells), return_inverse=True)
        self._counts = np.zeros(len(self._cells), np.int64)
        np.add.at(self._counts, place, both)

    def grid(self, end_m: float, limits: tuple[float, float]) -> tuple[Floats, Floats, NDArray[np.int64]]:
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
