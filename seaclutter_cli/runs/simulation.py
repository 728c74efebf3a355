"""Simulations: options, and results as text and as data."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from seaclutter_cli.runs.recordings import Result
from seaclutter_cli.simulation.airborne.scene import TileScene
from seaclutter_cli.simulation.marine.render import SimulatedFrame
from seaclutter_cli.simulation.marine.scene import Scene
from seaclutter_cli.text import count, indented, printable, table
from seaclutter_cli.truth import CLUTTER, IGNORED, OBJECT_CLASSES

_MAX_TARGETS = 12


@dataclass(frozen=True, kw_only=True)
class SimulateOptions:
    """Options of a simulation: values that replace those of the scene, and additional output.

    Parameters
    ----------
    frames : int or None
        Number of frames; None: that of the scene.
    seed : int or None
        Seed of all random numbers; None: that of the scene, 1 for a layout.
    lidar : str or None
        Lidar; None: that of the scene.
    form : str or None
        Key of `FORMATS`; None: from the suffix of the recording.
    scene_file : Path or None
        File for an editable copy of the scene.
    force : bool
        Replace existing files.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.SimulateOptions(frames=10, lidar="RS-LiDAR-16").seed is None
    True
    """

    frames: int | None = None
    seed: int | None = None
    lidar: str | None = None
    form: str | None = None
    scene_file: Path | None = None
    force: bool = False


class PointTally:
    """Numbers of frames of a recording, and of points by label."""

    def __init__(self) -> None:
        self.frames = 0
        self.points: Counter[int] = Counter()

    def add(self, frame: SimulatedFrame) -> None:
        """Add a frame."""
        self.frames += 1
        labels, counts = np.unique(frame.points["label"], return_counts=True)
        self.points.update(dict(zip(labels.tolist(), counts.tolist(), strict=True)))


@dataclass(frozen=True)
class SimulationResult(Result):
    """A simulated recording.

    Parameters
    ----------
    scene : Scene
        Scene that was recorded.
    tally : PointTally
        Numbers of frames and points.
    log, labels : Path
        Files of the recording and its labels.
    seconds : float
        Duration of the simulation.
    """

    is_summary = True

    scene: Scene
    tally: PointTally
    log: Path
    labels: Path
    seconds: float

    def _rows(self) -> list[tuple[str, int]]:
        points = self.tally.points
        targets = [(f"{item.class_name or item.shape}, track {item.track_id}", item) for item in self.scene.objects]
        shown = [(name, points[item.track_id]) for name, item in targets if not item.ignore]
        if len(shown) > _MAX_TARGETS:
            shown = self._by_class()
        return [("clutter", points[CLUTTER]), *shown, ("own ship or ignored", points[IGNORED])]

    def _by_class(self) -> list[tuple[str, int]]:
        points, targets = Counter[str](), Counter[str]()
        for item in self.scene.objects:
            if not item.ignore:
                name = item.class_name or item.shape
                targets[name] += 1
                points[name] += self.tally.points[item.track_id]
        return [(f"{name} ({count(number, 'object')})", points[name]) for name, number in sorted(targets.items())]

    def as_dict(self) -> dict[str, Any]:
        """Return the result as JSON-compatible data."""
        rows = [{"label": name, "points": points} for name, points in self._rows()]
        return {"output": str(self.log), "labels": str(self.labels), "frames": self.tally.frames, "points": rows}

    def as_text(self) -> str:
        """Return the result as human-readable text."""
        frames = self.tally.frames
        rows = [(name, f"{points / frames:,.0f}") for name, points in self._rows()]
        pace = f"{count(frames, 'frame')} in {self.seconds:.1f} s ({frames / self.seconds:.0f} frames/s)"
        files = printable(f"{self.log}, {self.labels}")
        return f"{files}\n{indented(table(('label', 'points per frame'), rows))}\n{pace}"


@dataclass(frozen=True)
class TileSimulationResult(Result):
    """A simulated tile.

    Parameters
    ----------
    scene : TileScene
        Scene that was recorded.
    points : counter of int
        Number of points by class code; 0 is the sea.
    land : int
        Number of points on land.
    output : Path
        File of the tile.
    seconds : float
        Duration of the simulation.
    """

    is_summary = True

    scene: TileScene
    points: Counter[int]
    land: int
    output: Path
    seconds: float

    def _rows(self) -> list[tuple[str, int, int]]:
        objects = Counter(item.kind for item in self.scene.objects)
        named = enumerate(OBJECT_CLASSES, 1)
        return [(name, objects[name], self.points[code]) for code, name in named if objects[name]]

    def as_dict(self) -> dict[str, Any]:
        """Return the result as JSON-compatible data."""
        listed = [{"class": name, "objects": objects, "points": points} for name, objects, points in self._rows()]
        return {"output": str(self.output), "sea": self.points[0], "land": self.land, "objects": listed}

    def as_text(self) -> str:
        """Return the result as human-readable text."""
        rows = [(name, objects, f"{points:,}") for name, objects, points in self._rows()]
        land = [("land", "", f"{self.land:,}")] if self.scene.land else []
        shown = table(("class", "objects", "points"), [("sea", "", f"{self.points[0]:,}"), *land, *rows])
        output, total = printable(str(self.output)), self.points.total() + self.land
        return f"{output}\n{indented(shown)}\n{count(total, 'point')} in {self.seconds:.1f} s"
