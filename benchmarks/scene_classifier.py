"""The scene classifier: rules of one feature beside it, its time, and what looking at fewer frames costs.

Run as ``python benchmarks/scene_classifier.py rules FOLDER`` on the recordings of ``scene_data.py``, ``speed``, or
``every [SEQUENCES]``.
"""

import itertools
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from logs import frame
from numpy.typing import NDArray
from scene_data import CLASSES, PARTS, Part, scenes

from seaclutter_cli.cloud import from_array
from seaclutter_cli.frame import Frame
from seaclutter_cli.scenes.image import top_view
from seaclutter_cli.scenes.model import SceneModel
from seaclutter_cli.scenes.tracker import SceneTracker
from seaclutter_cli.simulation.marine.render import Renderer

Floats = NDArray[np.float64]
RUNS = 200
STRIDE = 2

FEATURES: dict[str, Callable[[Floats, NDArray[np.uint8]], float]] = {
    "points": lambda xyz, _: float(xyz.shape[1]),
    "points in view": lambda xyz, _: float((np.abs(xyz[:2]) < 60).all(axis=0).sum()),
    "full cells": lambda _, image: float(image.sum()),
    "mean range": lambda xyz, _: float(np.sqrt((xyz**2).sum(axis=0)).mean()) if xyz.size else 0.0,
    "mean height": lambda xyz, _: float(xyz[2].mean()) if xyz.size else 0.0,
    "full rows and columns": lambda _, image: float(image.any(axis=0).sum() + image.any(axis=1).sum()),
    "closed bearings": lambda xyz, _: closed_bearings(xyz),
}


def closed_bearings(xyz: Floats) -> float:
    """Return how many of 120 bearings hold ten points or more beyond 4 m and within 60 m."""
    away = np.hypot(xyz[0], xyz[1])
    near = (away > 4) & (away < 60)
    bearing = ((np.arctan2(xyz[1, near], xyz[0, near]) / np.pi + 1) * 60).astype(int)
    return float((np.bincount(bearing, minlength=121) >= 10).sum())


def read(folder: Path) -> Iterator[tuple[int, str, Floats]]:
    """Yield class, recording and points of each frame."""
    for kind, name in enumerate(CLASSES):
        for recording in sorted((folder / name).iterdir()):
            for file in sorted(recording.glob("*.npy")):
                points = np.load(file)
                yield kind, f"{name}/{recording.name}", np.stack([points[axis] for axis in "xyz"]).astype(float)


def rules(folder: Path) -> None:
    """Print the share of frames told right by the network, and by the best threshold of each feature alone."""
    model = SceneModel("open_confined")
    found = {}
    for part in (name for name in PARTS if name != "plantation"):
        rows = []
        for kind, _, xyz in read(folder / part):
            image = top_view(xyz, model.extent_m)
            told = float(np.argmax(model.probabilities(image)))
            rows.append((kind, told, *(feature(xyz, image) for feature in FEATURES.values())))
        found[part] = np.array(rows)
    print(f"{'':<24}" + "".join(f"{part.removeprefix('test/'):>10}" for part in found))
    shares = (float((rows[:, 1] == rows[:, 0]).mean()) for rows in found.values())
    print(f"{'network':<24}" + "".join(f"{share:>10.3f}" for share in shares))
    for column, name in enumerate(FEATURES, 2):
        kinds, values = found["train"][:, 0], found["train"][:, column]
        tried = [(np.mean((values > t) == (kinds == more)), t, more) for t in np.unique(values) for more in (0, 1)]
        _, threshold, more = max(tried)
        shares = (float(np.mean((rows[:, column] > threshold) == (rows[:, 0] == more))) for rows in found.values())
        print(f"{name:<24}" + "".join(f"{share:>10.3f}" for share in shares))


def timed(task: Callable[[], object]) -> float:
    """Return the median processor time of a task in milliseconds."""
    times = []
    for _ in range(RUNS):
        started = time.thread_time()
        task()
        times.append(1000 * (time.thread_time() - started))
    return statistics.median(times)


def frame_of(points: NDArray[np.void], index: int = 0) -> Frame:
    cloud = from_array(points)
    return Frame(cloud, index=index)


def speed() -> None:
    """Print the times of a frame of 57,600 points; all of it runs on one thread."""
    model = SceneModel("open_confined")
    full = frame_of(frame(1, 0.4))
    _ = full.coordinates
    image = top_view(full.coordinates, model.extent_m)
    print(f"image      {timed(lambda: top_view(full.coordinates, model.extent_m)):.3f} ms, {full.size} points")
    print(f"inference  {timed(lambda: model.probabilities(image)):.3f} ms")
    for step in (1, 10):
        judge = SceneTracker(model, every=step, hold=3)
        started = time.thread_time()
        for _ in range(RUNS):
            judge.scene(full)
        print(f"every {step:<4} {1000 * (time.thread_time() - started) / RUNS:.3f} ms a frame")


def every(sequences: int) -> None:
    """Print the share of frames right on sequences of held-out layouts, and how often the scene changed.

    Every second frame of a sequence is simulated; what is printed counts all of them.
    """
    model = SceneModel("open_confined")
    part = Part(16, 1.0, True, None, None)
    looks = []
    for kind in CLASSES:
        for _, scene, _ in scenes(part, kind, sequences):
            renderer = Renderer(scene)
            turns = range(0, scene.recording.frames, STRIDE)
            looks.append((kind, [frame_of(renderer.turn(index).points, index) for index in turns]))
    print(f"{'every':>6}{'hold':>6}{'right':>9}{'changes':>9}   of {sum(len(turns) for _, turns in looks)} frames")
    for step in (2, 4, 10, 20, 50):
        for hold in (1, 2, 3):
            right, changes, frames = 0, 0, 0
            for kind, turns in looks:
                judge = SceneTracker(model, every=step // STRIDE, hold=hold)
                told = [judge.scene(turn).name for turn in turns]
                right += told.count(kind)
                changes += sum(one != other for one, other in itertools.pairwise(told))
                frames += len(told)
            print(f"{step:>6}{hold:>6}{right / frames:>9.4f}{changes:>9}", flush=True)


if __name__ == "__main__":
    if sys.argv[1] == "rules":
        rules(Path(sys.argv[2]))
    elif sys.argv[1] == "speed":
        speed()
    else:
        every(int(sys.argv[2]) if len(sys.argv) > 2 else 12)
