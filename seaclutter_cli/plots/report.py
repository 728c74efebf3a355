"""Figures of a report for print ([Li2023], Fig. 5 to 8, 10 and 11)."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from seaclutter_cli.frame import WATER_COLUMNS, WATER_REASONS, Reason
from seaclutter_cli.plots.clouds import draw_methods, draw_stages
from seaclutter_cli.plots.figure import render
from seaclutter_cli.reporting import palette
from seaclutter_cli.reporting.collector import Collector
from seaclutter_cli.reporting.page import mean_thresholds

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

_DASHES = ("-", "--", ":", "-.", (0, (5, 1)), (0, (1, 1)))
_MAX_POINTS = 12_000
_MAX_LEGEND = 6
_FEW_FRAMES = 10
_WATER_LABELS = {"water_level_m": "Water level (m)", "significant_wave_height_m": "Wave height (m)"}


@dataclass(frozen=True)
class ReportFigure:
    """A figure of a report, if there is anything to draw; each method increases height by width by ``row_aspect``."""

    draw: "Callable[[Figure, Collector], None]"
    applies: Callable[[Collector], bool]
    aspect: float = 0.62
    row_aspect: float = 0.0


def draw_figures(collected: Collector, form: str) -> dict[str, bytes]:
    """Return the figures as the bytes of ``svg`` or ``png`` files, by file name; figures without data are omitted.

    Figures of one method show the first; figures of one frame show `Collector.figure_sample`.
    """
    methods = len(collected.methods)
    drawn = {f"{name}.{form}": one for name, one in FIGURES.items() if one.applies(collected)}
    return {
        name: render(one.draw, f".{form}", aspect=one.aspect + one.row_aspect * methods, collected=collected)
        for name, one in drawn.items()
    }


def _draw_intensity(figure: "Figure", collected: Collector) -> None:
    """Draw points of evenly spaced frames by range and intensity, and the mean threshold of each range ring."""
    edges, samples = collected.methods[0].edges, collected.spread
    range_m = np.concatenate([sample.range_m for sample in samples])
    intensity = np.concatenate([sample.intensity for sample in samples])
    reason = np.concatenate([sample.reasons[0] for sample in samples])
    reach_m = 1.1 * edges[-1] if edges else float(np.quantile(range_m, 0.98))
    shown = np.flatnonzero(np.isfinite(intensity) & (range_m < reach_m) & (range_m >= (edges[0] if edges else 0)))
    thresholds = mean_thresholds(collected.histories[0])
    top = max(float(np.quantile(intensity[shown], 0.99)) if len(shown) else 1.0, 1.4 * max(thresholds, default=0.0))
    axes = figure.add_subplot()
    for one in (Reason.FAR, Reason.LOW_INTENSITY, Reason.KEPT, Reason.OUTLIER, *WATER_REASONS):
        own = shown[reason[shown] == one]
        own = own[:: max(1, len(own) * 3 // _MAX_POINTS)]
        if len(own):
            style: Any = {"markersize": 2.2, "color": palette.REASONS[one], "label": palette.REASON_NAMES[one]}
            axes.plot(range_m[own], intensity[own], ".", rasterized=True, markeredgewidth=0, **style)
    if edges:
        axes.stairs(thresholds, edges, baseline=None, color="white", linewidth=4, zorder=3)
        line = axes.stairs(thresholds, edges, baseline=None, color=palette.INK["ink"], linewidth=2, zorder=4)
        line.set_label("mean threshold")
    low = min(0.0, float(intensity[shown].min(initial=0)))
    axes.set(xlabel="Range (m)", ylabel="Intensity (sensor units)", ylim=(low, top))
    figure.legend(loc="outside upper center", ncols=3, markerscale=3, handlelength=1.4)


def _draw_rings(figure: "Figure", collected: Collector, *, name: str) -> None:
    values: NDArray[np.float32] = collected.histories[0][name]
    edges = collected.methods[0].edges
    axes = figure.add_subplot()
    colors = _ring_colors(values.shape[1])
    named = {0, values.shape[1] // 2, values.shape[1] - 1} if values.shape[1] > _MAX_LEGEND else range(_MAX_LEGEND)
    for k, (color, column) in enumerate(zip(colors, values.T, strict=True)):
        dash = _DASHES[k] if values.shape[1] <= _MAX_LEGEND else "-"
        label = f"{edges[k]:g} to {edges[k + 1]:g} m" if k in named else None
        _draw_series(axes, column, color=color, linestyle=dash, label=label)
    _set_frame_axis(axes, len(values))
    axes.set(ylabel=f"{name.removesuffix('s').capitalize()} (sensor units)")
    axes.set_ylim(min(0.0, float(np.nanmin(values))), None if np.nan_to_num(values).any() else 1.0)
    figure.legend(loc="outside upper center", ncols=2, handlelength=2.4)


def _draw_series(axes: "Axes", values: "NDArray[np.float32]", **style: Any) -> None:
    """Draw a line over the frames, with markers at all values if there are few, otherwise at isolated ones."""
    line = axes.plot(np.arange(len(values)), values, linewidth=1, **style)[0]
    known = np.isfinite(values)
    padded = np.pad(known, 1)
    connected = (padded[:-2] | padded[2:]) & (len(known) > _FEW_FRAMES)
    if isolated := np.flatnonzero(known & ~connected).tolist():
        line.set(marker="o", markersize=3.5, markevery=isolated, clip_on=False)


def _ring_colors(count: int) -> list[str]:
    """Return a colour for each range ring: distinct colours for a few, otherwise a ramp from near to far."""
    if count <= len(palette.LINES):
        return list(palette.LINES[:count])
    from matplotlib.colors import LinearSegmentedColormap, to_hex

    ramp = LinearSegmentedColormap.from_list("rings", palette.RAMP)
    return [to_hex(ramp(k / (count - 1))) for k in range(count)]


def _draw_reasons(figure: "Figure", collected: Collector) -> None:
    counts = np.nan_to_num(collected.histories[0]["counts"])
    used = [reason for reason in palette.REASONS if counts[:, reason].any()]
    axes = figure.add_subplot()
    frames = np.arange(len(counts)) if len(counts) > 1 else np.array([-0.5, 0.5])
    stacked = np.stack([counts[:, reason] for reason in used])
    if len(counts) == 1:
        stacked = np.repeat(stacked, 2, axis=1)
    colors, labels = ([names[one] for one in used] for names in (palette.REASONS, palette.REASON_NAMES))
    axes.stackplot(frames, stacked / 1000, colors=colors, labels=labels)
    _set_frame_axis(axes, len(counts))
    axes.set(ylabel="Points (thousands)", ylim=(0, float(stacked.sum(axis=0).max(initial=1)) / 1000))
    figure.legend(loc="outside upper center", ncols=3, handlelength=1.2, handleheight=0.9)


def _draw_alarms(figure: "Figure", collected: Collector) -> None:
    """Draw, for each method, the frames with false alarms (upper half) and with missed targets (lower half)."""
    axes = figure.add_subplot()
    named = set()
    for row, history in enumerate(collected.histories):
        labelled = np.isfinite(history["false_alarms"])
        states = {"correct": (labelled, 0.1, 0.8), "false alarm": (history["false_alarms"] > 0, 0.1, 0.4)}
        states["missed target"] = (history["missed"] > 0, 0.5, 0.4)
        for state, (mask, low, height) in states.items():
            edges = np.flatnonzero(np.diff(np.pad(mask, 1))).reshape(-1, 2).tolist()
            spans = [(first - 0.5, end - first) for first, end in edges]
            if not spans:
                continue
            label = None if state in named else state
            named.add(state)
            axes.broken_barh(spans, (row + low, height), color=palette.STATES[state], linewidth=0, label=label)
    names = [method.name for method in collected.methods]
    axes.set_yticks(np.arange(len(names)) + 0.5, [_shortened(name) for name in names])
    axes.set_ylim(len(names), 0)
    _set_frame_axis(axes, len(collected.timeline), whole=True)
    axes.tick_params(axis="y", length=0)
    figure.legend(loc="outside upper center", ncols=3, handlelength=1.2, handleheight=0.9)


def _draw_water(figure: "Figure", collected: Collector) -> None:
    water = collected.histories[0]["water"]
    panels = figure.subplots(2, 1, sharex=True)
    for axes, name, label in zip(panels, _WATER_LABELS, _WATER_LABELS.values(), strict=True):
        _draw_series(axes, water[:, WATER_COLUMNS.index(name)], color=palette.LINES[0])
        axes.set(ylabel=label)
        _set_frame_axis(axes, len(water))
    panels[1].set_ylim(bottom=0)
    panels[0].set_xlabel("")


def _shortened(name: str, limit: int = 24) -> str:
    """Return a name, with its middle omitted if it is long: similar names often differ at the end."""
    return name if len(name) <= limit else f"{name[: limit - 6]}…{name[-5:]}"


def _set_frame_axis(axes: "Axes", frames: int, *, whole: bool = False) -> None:
    """Set the limits, label and ticks of a frame axis; ``whole`` shows the first and last frame at full width."""
    from matplotlib.ticker import MaxNLocator

    axes.set(xlim=(-0.5, frames - 0.5) if whole or frames == 1 else (0, frames - 1), xlabel="Frame")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))


def _has_rings(collected: Collector) -> bool:
    return bool(collected.methods[0].edges) and bool(np.isfinite(collected.histories[0]["thresholds"]).any())


FIGURES: Mapping[str, ReportFigure] = {
    "intensity": ReportFigure(_draw_intensity, lambda it: any(np.isfinite(one.intensity).any() for one in it.spread)),
    "thresholds": ReportFigure(partial(_draw_rings, name="thresholds"), _has_rings),
    "corrections": ReportFigure(partial(_draw_rings, name="corrections"), _has_rings),
    "water": ReportFigure(_draw_water, lambda it: bool(np.isfinite(it.histories[0]["water"]).any()), 0.75),
    "reasons": ReportFigure(_draw_reasons, lambda collected: bool(collected.chosen)),
    "alarms": ReportFigure(_draw_alarms, lambda collected: collected.labelled and bool(collected.chosen), 0.27, 0.08),
    "stages": ReportFigure(draw_stages, lambda collected: bool(collected.chosen), aspect=1.75),
    "methods": ReportFigure(draw_methods, lambda it: len(it.methods) > 1 and bool(it.chosen), aspect=1.2),
}
"""Figures by file name. To add a figure, add a line here and a function that draws it."""
