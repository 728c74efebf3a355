"""Pictures of the frames in which the method ``confirmed`` is wrong most."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from recordings import LabelledFrame, Recording, calibrated_thresholds, simulate
from scores import filtered, matched
from variants import PAPER, of_method

from seaclutter_cli.frame import FilterResult, Reason
from seaclutter_cli.plots.figure import render
from seaclutter_cli.simulation.layouts import scene_class

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
WINDOW_M = 15.0
APART = 10
"""Least number of frames between two pictures of a recording: neighbours look the same."""
COLOURS = {"removed": "0.78", "unconfirmed": "#e69f00", "kept": "#0072b2"}
MISSED, FALSE_ALARM = "#d55e00", "#cc79a7"


@dataclass(frozen=True)
class Failure:
    """A frame with missed targets or false alarms.

    Parameters
    ----------
    recording : Recording
        Its recording.
    index : int
        Its number.
    missed, false_alarms : int
        Numbers of missed targets and of false alarms.
    png : bytes
        The picture.
    """

    recording: Recording
    index: int
    missed: int
    false_alarms: int
    png: bytes

    @property
    def name(self) -> str:
        """Name of the file."""
        return f"confirmed-{self.recording.scene}-{self.recording.seed}-{self.index:03d}.png".replace("_", "-")

    @property
    def caption(self) -> str:
        """Description of the picture."""
        where = f"`{self.recording.scene}`, seed {self.recording.seed}, frame {self.index}"
        return f"{where}: targets missed {self.missed}, false alarms {self.false_alarms}"


@dataclass(frozen=True)
class _Wrong:
    """A frame, its result, and the numbers of the missed targets; the points of these and of the false alarms."""

    one: LabelledFrame
    result: FilterResult
    missed: Indices
    echoes: Sequence[Indices]
    alarms: Sequence[Indices]

    @property
    def errors(self) -> int:
        return len(self.missed) + len(self.alarms)


def failures(recording: Recording, thresholds: str, most: int) -> list[Failure]:
    """Return the frames of a recording with the most errors, the worst first.

    Parameters
    ----------
    recording : Recording
        The recording.
    thresholds : {"paper", "calibrated"}
        Thresholds of the range rings.
    most : int
        Maximum number of frames.
    """
    scene = recording.description()
    frames = simulate(scene)
    calibrated = () if thresholds == PAPER else calibrated_thresholds(frames)
    results = filtered(of_method("confirmed", thresholds), frames, calibrated, scene_class(scene))
    wrong = [found for one, result in zip(frames, results, strict=True) if (found := _wrong(one, result)).errors]
    chosen: list[_Wrong] = []
    for found in sorted(wrong, key=lambda found: -found.errors):
        if all(abs(found.one.frame.index - other.one.frame.index) >= APART for other in chosen):
            chosen.append(found)
    return [
        Failure(recording, one.one.frame.index, len(one.missed), len(one.alarms), _png(one)) for one in chosen[:most]
    ]


def _wrong(one: LabelledFrame, result: FilterResult) -> _Wrong:
    targets, clusters, matches = matched(one, result)
    missed = np.flatnonzero(targets.visible & ~matches.detected)
    alarms = [np.flatnonzero(clusters == number) for number in np.flatnonzero(~matches.belongs)]
    return _Wrong(one, result, missed, [targets.members[k] for k in missed.tolist()], alarms)


def _png(wrong: _Wrong) -> bytes:
    def draw(figure: "Figure") -> None:
        above, below = figure.subplots(2, 1, height_ratios=(3, 1))
        _draw_top(above, wrong)
        _draw_side(below, wrong)
        above.legend(loc="upper right", fontsize=5, markerscale=2)

    return render(draw, ".png", aspect=1.35)


def _window(wrong: _Wrong) -> tuple[float, float, float]:
    """Return the middle, x and y, and the half width of a square that shows all errors of a frame."""
    boxes = wrong.one.truth.targets
    assert boxes is not None
    at = np.concatenate(
        [boxes.centers[wrong.missed, :2], *(wrong.one.frame.coordinates[:2, alarm].T for alarm in wrong.alarms)]
    )
    low, high = at.min(axis=0), at.max(axis=0)
    x, y = (low + high) / 2
    return float(x), float(y), float((high - low).max()) / 2 + WINDOW_M


def _inside(wrong: _Wrong) -> NDArray[np.bool_]:
    x, y, half = _window(wrong)
    points = wrong.one.frame.coordinates
    return np.asarray(wrong.one.frame.valid & (np.abs(points[0] - x) <= half) & (np.abs(points[1] - y) <= half))


def _draw_points(axes: "Axes", wrong: _Wrong, across: Floats, up: Floats) -> None:
    inside, reason = _inside(wrong), wrong.result.reason
    kinds = {
        "kept": reason == Reason.KEPT,
        "unconfirmed": reason == Reason.UNCONFIRMED,
        "removed": ~np.isin(reason, (Reason.KEPT, Reason.UNCONFIRMED)),
    }
    for name, colour in COLOURS.items():
        chosen = inside & kinds[name]
        axes.scatter(across[chosen], up[chosen], s=1.2, c=colour, linewidths=0, label=name)
    for several, colour, name in ((wrong.echoes, MISSED, "missed target"), (wrong.alarms, FALSE_ALARM, "false alarm")):
        if several:
            marked = np.concatenate(several)
            axes.scatter(
                across[marked], up[marked], s=9, facecolors="none", edgecolors=colour, linewidths=0.4, label=name
            )


def _draw_top(axes: "Axes", wrong: _Wrong) -> None:
    x, y, _ = wrong.one.frame.coordinates
    middle_x, middle_y, half = _window(wrong)
    _draw_points(axes, wrong, x, y)
    boxes = wrong.one.truth.targets
    assert boxes is not None
    for k, (center, size, yaw) in enumerate(zip(boxes.centers, boxes.sizes, boxes.yaws, strict=True)):
        corners = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1), (1, 1)]) * size[:2] / 2
        turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
        outline = corners @ turn + center[:2]
        is_missed = k in wrong.missed
        axes.plot(*outline.T, color=MISSED if is_missed else "0.3", linewidth=1.0 if is_missed else 0.5)
    axes.set(aspect="equal", xlabel="x in m", ylabel="y in m")
    axes.set_xlim(middle_x - half, middle_x + half)
    axes.set_ylim(middle_y - half, middle_y + half)


def _draw_side(axes: "Axes", wrong: _Wrong) -> None:
    x, y, z = wrong.one.frame.coordinates
    water = wrong.result.water
    if water is not None:
        slope_x, slope_y = np.tan(np.radians(water.pitch_deg)), -np.tan(np.radians(water.roll_deg))
        z = z - (water.level_m + slope_x * x + slope_y * y)
    _draw_points(axes, wrong, np.hypot(x, y), z)
    axes.set(xlabel="range in m", ylabel="z in m" if water is None else "height in m")
