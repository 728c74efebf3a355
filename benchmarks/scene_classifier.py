"""The scene classifier: comparison with rules of one feature, speed, and accuracy at fewer classified frames.

Run as ``python benchmarks/scene_classifier.py rules FOLDER`` on the recordings of ``scene_data.py``, or with ``speed``
or ``every [SEQUENCES]``.
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
from seaclutter_cli.scenes.model import SceneModel, SceneTracker, top_view
from seaclutter_cli.simulation.marine.recording import Renderer

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
    """Return how many of 120 sectors contain at least ten points between 4 and 60 m."""
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
    """Print the share of frames classified correctly by the network and by the best threshold of each feature."""
    model = SceneModel("open_confined")
    found = {}
    for part in (name for name in PARTS if name != "plantation"):
        rows = []
        for kind, _, xyz in read(folder / part):
            image = top_view(xyz, model.extent_m)
            predicted = float(np.argmax(model.probabilities(image)))
            rows.append((kind, predicted, *(feature(xyz, image) for feature in FEATURES.values())))
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
    """Print the times for a frame of 57,600 points on one thread."""
    model = SceneModel("open_confined")
    full = frame_of(frame(1, 0.4))
    _ = full.coordinates
    image = top_view(full.coordinates, model.extent_m)
    print(f"image      {timed(lambda: top_view(full.coordinates, model.extent_m)):.3f} ms, {full.size} points")
    print(f"inference  {timed(lambda: model.probabilities(image)):.3f} ms")
    for step in (1, 10):
        tracker = SceneTracker(model, every=step, hold=3)
        started = time.thread_time()
        for _ in range(RUNS):
            tracker.scene(full)
        print(f"every {step:<4} {1000 * (time.thread_time() - started) / RUNS:.3f} ms per frame")


def every(sequences: int) -> None:
    """Print the share of correctly classified frames of held-out layouts, and the number of changes of the class.

    Only every second frame of a sequence is simulated; the printed intervals count all frames.
    """
    model = SceneModel("open_confined")
    part = Part(16, 1.0, True, None, None)
    simulated = []
    for kind in CLASSES:
        for _, scene, _ in scenes(part, kind, sequences):
            renderer = Renderer(scene)
            indices = range(0, scene.recording.frames, STRIDE)
            simulated.append((kind, [frame_of(renderer.frame(index).points, index) for index in indices]))
    total = sum(len(frames) for _, frames in simulated)
    print(f"{'every':>6}{'hold':>6}{'correct':>9}{'changes':>9}   of {total} frames")
    for step in (2, 4, 10, 20, 50):
        for hold in (1, 2, 3):
            correct = changes = 0
            for kind, frames in simulated:
                tracker = SceneTracker(model, every=step // STRIDE, hold=hold)
                predicted = [tracker.scene(frame).name for frame in frames]
                correct += predicted.count(kind)
                changes += sum(one != other for one, other in itertools.pairwise(predicted))
            print(f"{step:>6}{hold:>6}{correct / total:>9.4f}{changes:>9}", flush=True)


if __name__ == "__main__":
    if sys.argv[1] == "rules":
        rules(Path(sys.argv[2]))
    elif sys.argv[1] == "speed":
        speed()
    else:
        every(int(sys.argv[2]) if len(sys.argv) > 2 else 12)
