"""Simulated recordings in memory, and thresholds calibrated on them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.calibration import Calibration, ClutterSelector
from seaclutter_cli.cloud import from_array
from seaclutter_cli.errors import InputError
from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.filters.joint import RingIntensityParams
from seaclutter_cli.frame import Frame
from seaclutter_cli.simulation.layouts import LAYOUTS, find_scene
from seaclutter_cli.simulation.marine.recording import SimulatedFrame, simulate_frames
from seaclutter_cli.simulation.marine.scene import Scene, builtin_scenes, load_scene
from seaclutter_cli.simulation.marine.sea import SeaParams
from seaclutter_cli.truth import Boxes, Truth

FILTER_RATE = 0.8
SEA_LAYOUTS = tuple(name for name, layout in LAYOUTS.items() if layout.scene_class in ("open", "confined"))


def marine_scenes() -> tuple[str, ...]:
    """Return the names of the built-in scenes at sea."""
    return tuple(name for name in builtin_scenes() if isinstance(load_scene(name).terrain, SeaParams))


@dataclass(frozen=True)
class Recording:
    """A recording to simulate.

    Parameters
    ----------
    scene : str
        Name of a built-in scene or of a layout.
    seed : int
        Its seed.
    lidar : str or None
        Its lidar; None keeps that of the scene.
    frames : int or None
        Maximum number of frames; None for all.
    """

    scene: str
    seed: int
    lidar: str | None = None
    frames: int | None = None

    def description(self) -> Scene:
        """Return the scene to simulate."""
        scene = find_scene(self.scene, self.seed)
        frames = None if self.frames is None else min(self.frames, scene.recording.frames)
        return scene.with_recording(lidar=self.lidar, frames=frames)


@dataclass(frozen=True)
class LabelledFrame:
    """A frame and its ground truth."""

    frame: Frame
    truth: Truth


def simulate(scene: Scene) -> list[LabelledFrame]:
    """Return the frames of a scene."""
    rate_hz = scene.lidar.rate_hz
    return [_labelled(one, rate_hz) for one in simulate_frames(scene)]


def _labelled(simulated: SimulatedFrame, rate_hz: float) -> LabelledFrame:
    stamp_ns = 10**9 + round(simulated.index * 1e9 / rate_hz)
    points = np.ascontiguousarray(simulated.points[["x", "y", "z", "intensity", "label"]])
    frame = Frame(from_array(points, stamp_ns=stamp_ns), stamp_ns=stamp_ns, index=simulated.index)
    boxes, ignored = simulated.boxes, [kind == "ignore" for kind in simulated.boxes.classes]
    targets, areas = (_subset(boxes, np.flatnonzero(np.equal(ignored, value))) for value in (False, True))
    return LabelledFrame(frame, Truth(targets, areas, points["label"].astype(np.int64)))


def _subset(boxes: Boxes, chosen: NDArray[np.intp]) -> Boxes:
    tracks, classes = (tuple(values[k] for k in chosen) for values in (boxes.tracks, boxes.classes))
    return Boxes(tracks, classes, boxes.centers[chosen], boxes.sizes[chosen], boxes.yaws[chosen])


class _FrameLabels:
    """Labels of frames in memory."""

    def __init__(self, frames: Sequence[LabelledFrame]) -> None:
        self._truths: Mapping[int, Truth] = {one.frame.index: one.truth for one in frames}

    def truth(self, frame: Frame) -> Truth:
        return self._truths[frame.index]

    def finish(self) -> None:
        pass


def calibrated_thresholds(frames: Sequence[LabelledFrame]) -> tuple[float, ...]:
    """Return the threshold of each range ring from the clutter of a recording, as ``calibrate`` does.

    The far limit is kept. Without any clutter, thresholds are those of the paper.
    """
    params = RingIntensityParams()
    calibration = Calibration(params, filter_rate=FILTER_RATE, keep_end=True)
    selector = ClutterSelector(params, _FrameLabels(frames), EvaluationParams().box_margin_m)
    for one in frames:
        clutter = selector.clutter(one.frame)
        calibration.add(one.frame.range_m[clutter], one.frame.intensity[clutter])
    try:
        return calibration.thresholds().initial_thresholds
    except InputError:
        return params.initial_thresholds
