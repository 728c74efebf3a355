"""Top views: frames stage by stage and for two methods ([Li2023], Fig. 8, 10 and 11), suspects, own structure."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from seaclutter_cli.arrays import Bytes, Floats, Mask
from seaclutter_cli.frame import Reason
from seaclutter_cli.reporting import palette
from seaclutter_cli.reporting.collector import Collector
from seaclutter_cli.reporting.sample import Sample
from seaclutter_cli.structure.mask import StructureMask
from seaclutter_cli.text import count

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D


_WIDE = 1.7
"""Ratio of the width of a panel to its height."""

_SIZES = {
    Reason.NEAR: 1.4,
    Reason.FAR: 1.4,
    Reason.EXCLUDED: 1.4,
    Reason.KEPT: 3.2,
    Reason.LOW_INTENSITY: 1.6,
    Reason.OUTLIER: 2.2,
    Reason.UNCONFIRMED: 2.2,
    Reason.MIRRORED: 1.6,
}
"""Marker sizes in typographic points, in drawing order: removed points are smaller, so kept ones below stay visible."""

_BOX_STYLES: dict[str | None, tuple[str, str, str]] = {
    "detected": ("detected target", "-", palette.STATES["detected"]),
    "missed": ("missed target", "--", palette.STATES["missed target"]),
    "hidden": ("target not visible", ":", "0.5"),
    None: ("target not evaluated", "-.", "0.5"),
    "ignored": ("area to ignore", "--", "0.5"),
}
"""Name, line style and colour of labelled boxes by state, in the order of the legend."""

_FALSE_ALARM = "false alarm"
_SUSPECT_M = 12.0
"""Half of the width of a picture of a suspect."""
_MAX_LEGEND_CHARACTERS = 40
"""Characters of a legend that fit into one row of four columns."""

STAGES: dict[str, Callable[[Bytes], Mask]] = {
    "raw": lambda reason: np.ones(len(reason), np.bool_),
    "after thresholds": lambda reason: np.isin(reason, (Reason.KEPT, Reason.OUTLIER, Reason.UNCONFIRMED)),
    "after outlier removal": lambda reason: np.asarray(reason == Reason.KEPT),
}
"""Masks of the points left after each stage of a filter, computed from their reasons."""


def draw_stages(figure: "Figure", collected: Collector) -> None:
    """Draw a frame before filtering, after the intensity thresholds, and after outlier removal."""
    sample = collected.figure_sample
    panels = figure.subplots(len(STAGES), 1, sharex=True, sharey=True)
    _set_limits(panels, sample)
    names = list(STAGES)
    if (sample.reasons[0] == Reason.UNCONFIRMED).any():
        names[-1] = "kept"
    for number, (axes, name, left) in enumerate(zip(panels, names, STAGES.values(), strict=True)):
        shown = left(sample.reasons[0])
        size = round(float(sample.weight[shown].sum()))
        draw_cloud(axes, sample, 0, shown)
        axes.set_title(f"({'abc'[number]}) {name}: {count(size, 'point')}", fontsize=8)
    _add_legend(figure, [reason for reason in _SIZES if (sample.reasons[0] == reason).any()])


def draw_methods(figure: "Figure", collected: Collector) -> None:
    """Draw the points of a frame that each of the first two methods keeps, with labelled boxes and false alarms."""
    sample = collected.figure_sample
    panels = figure.subplots(2, 1, sharex=True, sharey=True)
    _set_limits(panels, sample)
    marks: dict[str, Line2D] = {}
    for number, (letter, axes) in enumerate(zip("ab", panels, strict=True)):
        draw_cloud(axes, sample, number, sample.reasons[number] == Reason.KEPT)
        marks |= draw_boxes(axes, sample, number)
        axes.set_title(f"({letter}) {collected.methods[number].name}", fontsize=8)
    _add_legend(figure, [Reason.KEPT], marks)


def draw_suspect(figure: "Figure", sample: Sample, place: tuple[float, float]) -> None:
    """Draw the points around a place before and after a filter, coloured by their reasons."""
    panels = figure.subplots(2, 1, sharex=True, sharey=True)
    x, y = place
    for axes, name in zip(panels, ("raw", "kept"), strict=True):
        shown = np.ones(len(sample.xyz), np.bool_) if name == "raw" else sample.reasons[0] == Reason.KEPT
        inside = shown & (np.abs(sample.xyz[:, :2] - np.array(place)) <= _SUSPECT_M).all(axis=1)
        draw_cloud(axes, sample, 0, inside)
        axes.plot(-y, x, "o", color=palette.STATES["missed target"], markersize=14, fillstyle="none")
        limits = {"xlim": (-y - _SUSPECT_M, -y + _SUSPECT_M), "ylim": (x - _SUSPECT_M, x + _SUSPECT_M)}
        axes.set(aspect="equal", ylabel="Ahead (m)", **limits)
        axes.set_title(f"{name}: {count(int(np.count_nonzero(inside)), 'point')}", fontsize=8)
    panels[-1].set_xlabel("To starboard (m)")
    _add_legend(figure, [reason for reason in _SIZES if (sample.reasons[0] == reason).any()])


def draw_cloud(axes: "Axes", sample: Sample, method: int, shown: Mask) -> None:
    """Draw some points of a sample in top view, coloured by the reasons of a method, with x up and y to the left."""
    for reason, size in _SIZES.items():
        xy = sample.xyz[shown & (sample.reasons[method] == reason)]
        color = palette.REASONS[reason]
        axes.plot(-xy[:, 1], xy[:, 0], ".", color=color, markersize=size, markeredgewidth=0, rasterized=True)
    axes.plot(0, 0, "+", color="black", markersize=5, markeredgewidth=0.7)


def draw_boxes(axes: "Axes", sample: Sample, method: int) -> "dict[str, Line2D]":
    """Draw labelled boxes in the line style of their state, and a circle around every false alarm.

    The legend handles by name are returned, for the kinds of marks that are visible.
    """
    drawn: dict[str, Line2D] = {}
    for box in sample.boxes:
        state = box["state"][method] if isinstance(box["state"], list) else box["state"]
        name, style, color = _BOX_STYLES[state]
        corners = _corners(box)
        drawn[name] = axes.plot(-corners[:, 1], corners[:, 0], style, color=color, linewidth=0.8)[0]
    for cluster in sample.clusters[method]:
        if cluster["kind"] == "false":
            x, y, _ = (np.array(cluster["low"]) + cluster["high"]) / 2
            color = palette.STATES[_FALSE_ALARM]
            circle = axes.plot(-y, x, "o", color=color, markersize=8, fillstyle="none")[0]
            if axes.viewLim.contains(-y, x):
                drawn[_FALSE_ALARM] = circle
    return drawn


def _corners(box: dict[str, Any]) -> Floats:
    cos, sin = np.cos(box["yaw"]), np.sin(box["yaw"])
    outline = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1], [1, 1]]) / 2 * box["size"][:2]
    rotated: Floats = outline @ np.array([[cos, sin], [-sin, cos]]) + box["center"][:2]
    return rotated


def _set_limits(panels: Any, sample: Sample) -> None:
    inside = np.isin(sample.reasons[0], (Reason.KEPT, Reason.LOW_INTENSITY, Reason.OUTLIER, Reason.UNCONFIRMED))
    extents = [np.zeros((1, 2)), *(_corners(box) for box in sample.boxes)]
    if inside.any():
        extents.append(np.percentile(sample.xyz[inside, :2].astype(np.float64), [1, 99], axis=0))
    positions = np.concatenate(extents)
    low, high = positions.min(axis=0), positions.max(axis=0)
    middle, half = (low + high) / 2, 1.08 * (high - low) / 2 + 1.0
    ahead = max(float(half[0]), float(half[1]) / _WIDE)
    for axes in panels:
        xlim, ylim = -middle[1] + _WIDE * np.array([-ahead, ahead]), middle[0] + np.array([-ahead, ahead])
        axes.set(aspect="equal", ylabel="Ahead (m)", xlim=xlim, ylim=ylim)
    panels[-1].set_xlabel("To starboard (m)")


def _add_legend(figure: "Figure", reasons: list[Reason], marks: "Mapping[str, Line2D] | None" = None) -> None:
    """Add a legend above a figure, in the order of the palette and of `_BOX_STYLES`."""
    marks = marks or {}
    handles = {
        palette.REASON_NAMES[reason]: figure.axes[0].plot([], [], "o", markersize=3, color=color)[0]
        for reason, color in palette.REASONS.items()
        if reason in reasons
    }
    for name in (*(name for name, _, _ in _BOX_STYLES.values()), _FALSE_ALARM):
        if name in marks:
            handles[name] = marks[name]
    columns = 4 if sum(map(len, handles)) <= _MAX_LEGEND_CHARACTERS else 3
    length = 1.4 if marks else 0.8
    figure.legend(
        handles.values(), handles, loc="outside upper center", ncols=columns, handlelength=length, columnspacing=1.2
    )


def draw_mask(figure: "Figure", *, mask: StructureMask, reach_m: float) -> None:
    """Draw a mask, searched up to a range, by azimuth and elevation and, below it, from above with the bow up."""
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Rectangle, Wedge

    upper, lower = figure.subplots(2, 1, height_ratios=(1, 1.9))
    sectors = sorted(mask.sectors, key=lambda one: -one.range_min_m)  # near ones lie above
    ranges = np.array([one.range_min_m for one in sectors])
    boxes, wedges = [], []
    for one in sectors:
        low, high, first, last = one.elevation_min_deg, one.elevation_max_deg, one.azimuth_min_deg, one.azimuth_max_deg
        boxes.append(Rectangle((-last, low), last - first, high - low))
        # Turned by 90°, x points up and y to the left, as on a chart with the bow up.
        flat = np.cos(np.radians((low + high) / 2))
        width = (one.range_max_m - one.range_min_m) * flat
        wedges.append(Wedge((0, 0), one.range_max_m * flat, first + 90, last + 90, width=width))
    for axes, patches in ((upper, boxes), (lower, wedges)):
        drawn = PatchCollection(patches, cmap="viridis_r", linewidth=0)
        drawn.set_array(ranges)
        drawn.set_clim(0, reach_m)
        axes.add_collection(drawn)
        axes.spines[["top", "right"]].set_visible(False)
    low = min((one.elevation_min_deg for one in sectors), default=-20.0)
    high = max((one.elevation_max_deg for one in sectors), default=10.0)
    upper.set(xlim=(-180, 180), ylim=(low - 2, high + 2), xlabel="Azimuth (°)", ylabel="Elevation (°)")
    ticks = np.arange(-180, 181, 90)
    upper.set_xticks(ticks, [f"{0 - tick:g}" for tick in ticks])
    far = max((one.range_max_m for one in sectors), default=reach_m) * 1.1
    lower.set(xlim=(-far, far), ylim=(-far, far), xlabel="y to port (m)", ylabel="x forward (m)", aspect="equal")
    lower.xaxis.set_major_formatter(lambda value, _: f"{0 - value:g}")
    lower.plot(0, 0, "+", color="0.2", markersize=8)
    lower.annotate("lidar", (0, 0), xytext=(6, 4), textcoords="offset points", fontsize=6.5)
    if sectors:
        figure.colorbar(drawn, ax=lower, shrink=0.7, label="Nearest masked range (m)")
    else:
        upper.set_title("No own structure found", fontsize=8)
