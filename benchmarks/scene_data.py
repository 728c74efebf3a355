"""Recordings to train and test the scene classifier on: random scenes of every layout, a folder of frames each.

Run as ``python benchmarks/scene_data.py FOLDER [RECORDINGS]``. Makes FOLDER/train and FOLDER/test/NAME for what the
network never sees in training: layouts, lidars, rough seas, all of these together. In each, a folder for each scene.
What is there already is kept, so an interrupted run can be taken up again.
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from seaclutter_cli.simulation.layouts import LAYOUTS
from seaclutter_cli.simulation.render import Renderer
from seaclutter_cli.simulation.scene import Scene

CLASSES = ("open", "confined")
HELD_LAYOUTS = {"regatta", "pile_field", "lock_chamber", "river"}
HELD_LIDARS = {"VLP-16", "OS1-64"}
ROUGH = 3.8
"""Sea state from which on seas are left to the test."""
FRAMES = 3


class Part(NamedTuple):
    """Recordings by what of them is held out: True only what is, False only what is not, None both."""

    seed: int
    share: float
    layout: bool | None
    lidar: bool | None
    rough: bool | None

    def has(self, layout: str, scene: Scene) -> bool:
        held = (layout in HELD_LAYOUTS, scene.recording.lidar in HELD_LIDARS, scene.sea.sea_state >= ROUGH)
        return all(want is None or want == has for want, has in zip(self[2:], held, strict=True))


PARTS = {
    "train": Part(1, 1.0, False, False, False),
    "test/layouts": Part(2, 0.15, True, False, False),
    "test/lidars": Part(3, 0.15, False, True, False),
    "test/rough": Part(4, 0.15, False, False, True),
    "test/all": Part(5, 0.15, True, True, None),
}


def scenes(part: Part, kind: str, number: int) -> Iterator[tuple[str, Scene]]:
    """Yield random scenes of a class, layout by layout in turn."""
    rng = np.random.default_rng([part.seed, CLASSES.index(kind)])
    names = [name for name, layout in LAYOUTS.items() if layout.scene_class == kind]
    names = [name for name in names if part.layout is None or (name in HELD_LAYOUTS) == part.layout]
    for index in range(number):
        name = names[index % len(names)]
        scene = LAYOUTS[name].make(rng)
        while not part.has(name, scene):
            scene = LAYOUTS[name].make(rng)
        yield name, scene


def write(scene: Scene, folder: Path) -> None:
    """Write a few turns of a scene, seconds apart."""
    renderer = Renderer(scene)
    folder.mkdir(parents=True, exist_ok=True)
    for index in np.linspace(0, scene.recording.frames - 1, FRAMES).astype(int).tolist():
        points = renderer.turn(index).points
        kept = np.empty(len(points), [(axis, "<f4") for axis in "xyz"])
        for axis in "xyz":
            kept[axis] = points[axis]
        np.save(folder / f"{index:04d}.npy", kept)


def main(folder: Path, recordings: int) -> None:
    for name, part in PARTS.items():
        for kind in CLASSES:
            number = round(part.share * recordings / len(CLASSES))
            for index, (layout, scene) in enumerate(scenes(part, kind, number)):
                target = folder / name / kind / f"{layout}-{index:04d}"
                if not target.exists() or len(list(target.glob("*.npy"))) < FRAMES:
                    write(scene, target)
            print(f"{name}, {kind}: {number} recordings", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 800)
