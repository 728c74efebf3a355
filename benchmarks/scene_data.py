"""Recordings for training and testing the scene classifier: random scenes of every layout, a folder of frames each.

Run as ``python benchmarks/scene_data.py FOLDER [RECORDINGS]``. FOLDER/train is for training. FOLDER/test/NAME contains
layouts, lidars, rough seas, and all of these together that the network does not see in training. FOLDER/plantation has
a quarter as many recordings, for the case of [Bi]. Each contains a folder for each scene.

In a quarter of the recordings own ship is exactly parallel to the longest object around it, as if moored alongside.
Existing recordings are kept, so an interrupted run can be continued.
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from seaclutter_cli.simulation.layouts import LAYOUTS
from seaclutter_cli.simulation.marine.recording import Renderer
from seaclutter_cli.simulation.marine.scene import Scene

CLASSES = ("open", "confined")
PLANTATIONS = ("dense", "sparse")
HELD_LAYOUTS = {"regatta", "pile_field", "lock_chamber", "river"}
HELD_LIDARS = {"VLP-16", "OS1-64"}
ROUGH = 3.8
"""Minimum sea state of the rough seas, which are only used for testing."""
FRAMES = 3


class Part(NamedTuple):
    """A set of recordings; a property is held out (True), not held out (False), or either (None)."""

    seed: int
    share: float
    layout: bool | None
    lidar: bool | None
    rough: bool | None

    def has(self, layout: str, scene: Scene) -> bool:
        held = (
            layout in HELD_LAYOUTS,
            scene.recording.lidar in HELD_LIDARS,
            getattr(scene.terrain, "sea_state", 0.0) >= ROUGH,
        )
        return all(want is None or want == has for want, has in zip(self[2:], held, strict=True))


PARTS = {
    "train": Part(1, 1.0, False, False, False),
    "test/layouts": Part(12, 0.0625, True, False, False),
    "test/lidars": Part(13, 0.0625, False, True, False),
    "test/rough": Part(14, 0.0625, False, False, True),
    "test/all": Part(15, 0.0625, True, True, None),
    "plantation": Part(7, 0.25, None, None, None),
}


def scenes(part: Part, kind: str, number: int) -> Iterator[tuple[str, Scene, bool]]:
    """Yield layout, random scene, and whether own ship is parallel, alternating between the layouts of a class."""
    names = [name for name, layout in LAYOUTS.items() if layout.scene_class == kind]
    names = [name for name in names if part.layout is None or (name in HELD_LAYOUTS) == part.layout]
    for index in range(number):
        name = names[index % len(names)]
        rng = np.random.default_rng([part.seed, (*CLASSES, *PLANTATIONS).index(kind), index])
        scene = LAYOUTS[name].make(rng)
        while not part.has(name, scene):
            scene = LAYOUTS[name].make(rng)
        yield name, scene, index // len(names) % 4 == 3


def relative_heading(scene: Scene, time_s: float) -> float:
    """Return the heading of the longest object relative to own ship in radians."""
    item = max(scene.objects, key=lambda one: one.size_m[0], default=None)
    if item is None:
        return 0.0
    time = np.array([time_s])
    return float(item.track.at(time)[2][0] - scene.vessel.track.at(time)[2][0])


def write(scene: Scene, folder: Path, *, parallel: bool) -> None:
    """Write a few frames of a scene, seconds apart."""
    renderer = Renderer(scene)
    folder.mkdir(parents=True, exist_ok=True)
    for index in np.linspace(0, scene.recording.frames - 1, FRAMES).astype(int).tolist():
        points = renderer.frame(index).points
        angle = relative_heading(scene, index / 10) if parallel else 0.0
        kept = np.empty(len(points), [(axis, "<f4") for axis in "xyz"])
        kept["x"] = np.cos(angle) * points["x"] + np.sin(angle) * points["y"]
        kept["y"] = np.cos(angle) * points["y"] - np.sin(angle) * points["x"]
        kept["z"] = points["z"]
        np.save(folder / f"{index:04d}.npy", kept)


def main(folder: Path, recordings: int) -> None:
    for name, part in PARTS.items():
        for kind in PLANTATIONS if name == "plantation" else CLASSES:
            number = round(part.share * recordings / 2)
            for index, (layout, scene, parallel) in enumerate(scenes(part, kind, number)):
                target = folder / name / kind / f"{layout}-{index:04d}"
                if not target.exists() or len(list(target.glob("*.npy"))) < FRAMES:
                    write(scene, target, parallel=parallel)
            print(f"{name}, {kind}: {number} recordings", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 1600)
