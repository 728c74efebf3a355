"""Frames seen from above: stage by stage, and by two methods (S0, Fig. 8, 10 and 11)."""

from collections.abc import Callable
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

Mask = NDArray[np.bool_]

_WIDE = 1.7
"""Width of a panel by its height."""

_SIZES = {
    Reason.NEAR: 1.4,
    Reason.FAR: 1.4,
    Reason.EXCLUDED: 1.4,
    Reason.LOW_INTENSITY: 1.8,
    Reason.OUTLIER: 3.0,
    Reason.KEPT: 2.6,
}
"""Sizes of points in points of print; what comes later lies on top."""

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
    for letter, axes, (name, left) in zip("abc", panels, STAGES.items(), strict=True):
        shown = left(sample.reasons[0])
        count = round(float(sample.weight[shown].sum()))
        draw_cloud(axes, sample, 0, shown)
        axes.set_title(f"({letter}) {name}: {count:,} points", fontsize=8)
    _finish(figure, panels, sample, [reason for reason in reversed(_SIZES) if (sample.reasons[0] == reason).any()])


def draw_methods(figure: "Figure", collected: Collector) -> None:
    """Draw what the first two methods keep of a frame, with labelled boxes and false alarms."""
    sample = collected.foremost
    panels = figure.subplots(2, 1, sharex=True, sharey=True)
    for number, (letter, axes) in enumerate(zip("ab", panels, strict=True)):
        draw_cloud(axes, sample, number, sample.reasons[number] == Reason.KEPT)
        draw_boxes(axes, sample, number)
        axes.set_title(f"({letter}) {collected.methods[number].name}", fontsize=8)
    marks = draw_marks(panels[0]) if sample.boxes or any(sample.clusters[:2]) else {}
    _finish(figure, panels, sample, [Reason.KEPT], marks)


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


def draw_boxes(axes: "Axes", sample: Sample, method: int) -> None:
    """Draw labelled boxes, those of lost targets dashed, and a ring around every false alarm."""
    for box in sample.boxes:
        state = box["state"][method] if isinstance(box["state"], list) else box["state"]
        corners = _corners(box)
        color = (
            palette.STATES["omitted alarm"]
            if state == "lost"
            else palette.STATES["found"]
            if state == "found"
            else "0.5"
        )
        axes.plot(-corners[:, 1], corners[:, 0], "-" if state == "found" else "--", color=color, linewidth=0.8)
    for cluster in sample.clusters[method]:
        if cluster["kind"] == "false":
            low, high = np.array(cluster["low"]), np.array(cluster["high"])
            middle = (low + high) / 2
            axes.plot(-middle[1], middle[0], "o", color=palette.STATES["false alarm"], markersize=8, fillstyle="none")


def draw_marks(axes: "Axes") -> dict[str, Any]:
    """Return what `draw_boxes` draws, by name, for a legend."""
    found, lost, wrong = (palette.STATES[state] for state in ("found", "omitted alarm", "false alarm"))
    return {
        "target found": axes.plot([], [], "-", color=found, linewidth=0.8)[0],
        "target lost": axes.plot([], [], "--", color=lost, linewidth=0.8)[0],
        "false alarm": axes.plot([], [], "o", color=wrong, markersize=5, fillstyle="none")[0],
    }


def _corners(box: dict[str, Any]) -> NDArray[np.float64]:
    cos, sin = np.cos(box["yaw"]), np.sin(box["yaw"])
    outline = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1], [1, 1]]) / 2 * box["size"][:2]
    turned: NDArray[np.float64] = outline @ np.array([[cos, sin], [-sin, cos]]) + box["center"][:2]
    return turned


def _finish(
    figure: "Figure", panels: Any, sample: Sample, reasons: list[Reason], marks: dict[str, Any] | None = None
) -> None:
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
    handles = {
        reason.name.lower().replace("_", " "): panels[0].plot([], [], "o", markersize=3, color=palette.REASONS[reason])[
            0
        ]
        for reason in reasons
    } | (marks or {})
    length = 1.4 if marks else 0.8
    figure.legend(
        handles.values(), handles, loc="outside upper center", ncols=4, handlelength=length, columnspacing=1.2
    )
