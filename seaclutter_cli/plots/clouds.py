"""Frames seen from above: stage by stage, and by two methods (S0, Fig. 8, 10 and 11)."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.frame import Reason
from seaclutter_cli.reporting import palette
from seaclutter_cli.reporting.collector import Collector
from seaclutter_cli.reporting.sample import Sample

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

Mask = NDArray[np.bool_]

_WIDE = 1.7
"""Width of a panel by its height."""

_SIZES = {
    Reason.NEAR: 1.4,
    Reason.FAR: 1.4,
    Reason.EXCLUDED: 1.4,
    Reason.KEPT: 3.2,
    Reason.LOW_INTENSITY: 1.6,
    Reason.OUTLIER: 2.2,
}
"""Sizes of points in points of print; what comes later lies on top: removed points, smaller, leave kept ones to see."""

_MARKS: dict[str | None, tuple[str, str, str]] = {
    "found": ("target found", "-", palette.STATES["found"]),
    "lost": ("target lost", "--", palette.STATES["omitted alarm"]),
    "hidden": ("target not visible", ":", "0.5"),
    None: ("target not judged", "-.", "0.5"),
    "ignored": ("ignored area", "--", "0.5"),
}
"""How labelled boxes are named and drawn, by their states: name, dashes and colour, in the order of the legend."""

_FALSE_ALARM = "false alarm"

STAGES: dict[str, Callable[[NDArray[np.uint8]], Mask]] = {
    "raw": lambda reason: np.ones(len(reason), np.bool_),
    "after intensity": lambda reason: np.asarray((reason == Reason.KEPT) | (reason == Reason.OUTLIER)),
    "after outliers": lambda reason: np.asarray(reason == Reason.KEPT),
}
"""What is left of a frame after each stage of a filter, by the reasons of its points."""


def draw_stages(figure: "Figure", collected: Collector) -> None:
    """Draw a frame as it was, after the intensity thresholds, and after the search for outliers."""
    sample = collected.foremost
    panels = figure.subplots(len(STAGES), 1, sharex=True, sharey=True)
    _look_at(panels, sample)
    for number, (axes, (name, left)) in enumerate(zip(panels, STAGES.items(), strict=True)):
        shown = left(sample.reasons[0])
        count = round(float(sample.weight[shown].sum()))
        draw_cloud(axes, sample, 0, shown)
        axes.set_title(f"({'abc'[number]}) {name}: {count:,} {'left' if number else 'points in the frame'}", fontsize=8)
    _explain(figure, panels[0], [reason for reason in _SIZES if (sample.reasons[0] == reason).any()])


def draw_methods(figure: "Figure", collected: Collector) -> None:
    """Draw what the first two methods keep of a frame, with labelled boxes and false alarms."""
    sample = collected.foremost
    panels = figure.subplots(2, 1, sharex=True, sharey=True)
    _look_at(panels, sample)
    marks: dict[str, Line2D] = {}
    for number, (letter, axes) in enumerate(zip("ab", panels, strict=True)):
        draw_cloud(axes, sample, number, sample.reasons[number] == Reason.KEPT)
        marks |= draw_boxes(axes, sample, number)
        axes.set_title(f"({letter}) {collected.methods[number].name}", fontsize=8)
    _explain(figure, panels[0], [Reason.KEPT], marks)


def draw_cloud(axes: "Axes", sample: Sample, method: int, shown: Mask) -> None:
    """Draw points of a frame from above in the colours of their reasons, x ahead and y to the left.

    Parameters
    ----------
    axes : Axes
        Where to.
    sample : Sample
        The frame, n points of it.
    method : int
        Whose reasons the colours are.
    shown : ndarray, shape (n,), bool
        Which points.
    """
    for reason, size in _SIZES.items():
        own = shown & (sample.reasons[method] == reason)
        xy = sample.xyz[own]
        color = palette.REASONS[reason]
        axes.plot(-xy[:, 1], xy[:, 0], ".", color=color, markersize=size, markeredgewidth=0, rasterized=True)
    axes.plot(0, 0, "+", color="black", markersize=5, markeredgewidth=0.7)


def draw_boxes(axes: "Axes", sample: Sample, method: int) -> "dict[str, Line2D]":
    """Draw labelled boxes in the dashes of their states, and a ring around every false alarm.

    Returns
    -------
    dict of str to Line2D
        One of each kind that lies within the axes, by name, for a legend.
    """
    drawn: dict[str, Line2D] = {}
    for box in sample.boxes:
        state = box["state"][method] if isinstance(box["state"], list) else box["state"]
        name, dashes, color = _MARKS[state]
        corners = _corners(box)
        drawn[name] = axes.plot(-corners[:, 1], corners[:, 0], dashes, color=color, linewidth=0.8)[0]
    for cluster in sample.clusters[method]:
        if cluster["kind"] == "false":
            x, y, _ = (np.array(cluster["low"]) + cluster["high"]) / 2
            color = palette.STATES[_FALSE_ALARM]
            ring = axes.plot(-y, x, "o", color=color, markersize=8, fillstyle="none")[0]
            if axes.viewLim.contains(-y, x):
                drawn[_FALSE_ALARM] = ring
    return drawn


def _corners(box: dict[str, Any]) -> NDArray[np.float64]:
    cos, sin = np.cos(box["yaw"]), np.sin(box["yaw"])
    outline = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1], [1, 1]]) / 2 * box["size"][:2]
    turned: NDArray[np.float64] = outline @ np.array([[cos, sin], [-sin, cos]]) + box["center"][:2]
    return turned


def _look_at(panels: Any, sample: Sample) -> None:
    """Show the same part of the scene in all panels: where clutter and targets are, around the vessel."""
    inside = np.isin(sample.reasons[0], (Reason.KEPT, Reason.LOW_INTENSITY, Reason.OUTLIER))
    ends = [np.zeros((1, 2)), *(_corners(box) for box in sample.boxes)]
    if inside.any():
        ends.append(np.percentile(sample.xyz[inside, :2].astype(np.float64), [1, 99], axis=0))
    places = np.concatenate(ends)
    low, high = places.min(axis=0), places.max(axis=0)
    middle, half = (low + high) / 2, 1.08 * (high - low) / 2 + 1.0
    ahead = max(float(half[0]), float(half[1]) / _WIDE)
    for axes in panels:
        axes.set(aspect="equal", ylabel="Ahead (m)")
        axes.set_xlim(-middle[1] - _WIDE * ahead, -middle[1] + _WIDE * ahead)
        axes.set_ylim(middle[0] - ahead, middle[0] + ahead)
    panels[-1].set_xlabel("To starboard (m)")


def _explain(
    figure: "Figure", axes: "Axes", reasons: list[Reason], marks: "Mapping[str, Line2D] | None" = None
) -> None:
    """Say above a figure what colours and marks mean, in the order of the palette and of `_MARKS`."""
    marks = marks or {}
    handles = {
        reason.name.lower().replace("_", " "): axes.plot([], [], "o", markersize=3, color=color)[0]
        for reason, color in palette.REASONS.items()
        if reason in reasons
    }
    for name in (*(name for name, _, _ in _MARKS.values()), _FALSE_ALARM):
        if name in marks:
            handles[name] = marks[name]
    length = 1.4 if marks else 0.8
    figure.legend(
        handles.values(), handles, loc="outside upper center", ncols=4, handlelength=length, columnspacing=1.2
    )
