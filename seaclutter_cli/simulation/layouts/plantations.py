"""Layouts of plantations as in [Bi]: rows of trees, measured by a solid-state lidar on a vehicle between the rows."""

from dataclasses import dataclass

import numpy as np

from seaclutter_cli.simulation.layouts.plan import Plan
from seaclutter_cli.simulation.lidar.models import NoiseParams
from seaclutter_cli.simulation.marine.scene import RecordingParams, Scene, VesselParams
from seaclutter_cli.simulation.marine.terrain import GroundParams

_REACH_M = 30.0


@dataclass(frozen=True)
class Trees:
    """Trees of one kind: class in the labels, shape of the labelled part, minima and maxima of distances and sizes.

    Distances are those between rows, and between trees in a row. ``reach_m`` is the distance to either side up to which
    there are rows; farther rows would be hidden by dense ones. The crown above the labelled part, if its width is not
    0, is an area to ignore.
    """

    kind: str
    shape: str
    row_m: tuple[float, float]
    step_m: tuple[float, float]
    width_m: tuple[float, float]
    height_m: tuple[float, float]
    reach_m: float
    crown_m: float
    description: str


APPLE = Trees(
    "apple tree",
    "apple_tree",
    (2.6, 3.8),
    (0.8, 1.2),
    (0.8, 1.2),
    (2.2, 3.2),
    9.0,
    0.0,
    "Dense rows of dwarf apple trees.",
)
POPLAR = Trees("poplar", "trunk", (2.6, 3.6), (2.6, 3.6), (0.16, 0.32), (2.4, 3.2), 16.0, 1.8, "Well-spaced poplars.")
WILLOW = Trees(
    "willow",
    "trunk",
    (3.0, 4.5),
    (3.0, 4.5),
    (0.08, 0.18),
    (1.9, 2.6),
    16.0,
    2.6,
    "Well-spaced willows with thin stems.",
)


def plantation(trees: Trees, plan: Plan) -> Scene:
    """Return rows of trees of one kind."""
    row, step, missing = plan.uniform(*trees.row_m), plan.uniform(*trees.step_m), plan.uniform(0, 0.08)
    rotation = np.radians(plan.uniform(-4, 4) if trees is APPLE else plan.uniform(-30, 30))
    shift = plan.uniform(-0.15, 0.15) * row
    ends = plan.uniform(12, _REACH_M + 4) if plan.bernoulli(0.3) else _REACH_M + 4
    rows = np.arange(-7.5, 8) * row
    for across in rows[np.abs(rows) <= trees.reach_m]:
        for along in np.arange(-2.0, ends, step) + plan.uniform(0, step):
            x, y = float(along) + plan.uniform(-0.1, 0.1), float(across) + shift + plan.uniform(-0.08, 0.08)
            cos, sin = float(np.cos(rotation)), float(np.sin(rotation))
            position = x * cos - y * sin, x * sin + y * cos
            if not plan.bernoulli(missing) and np.hypot(*position) > 1.2:
                _tree(plan, trees, position, step)
    return _scene(plan, trees.description)


def _tree(plan: Plan, trees: Trees, position: tuple[float, float], step_m: float) -> None:
    """Add a tree: its labelled part and its crown."""
    width, height, reflectivity = plan.uniform(*trees.width_m), plan.uniform(*trees.height_m), plan.uniform(0.3, 0.65)
    length = max(width, 1.15 * step_m) if trees is APPLE else width
    heading = 180.0 * plan.integer(0, 1) if trees is APPLE else plan.uniform(-180, 180)
    still = {"class_name": trees.kind, "reflectivity": reflectivity, "wave_response": 0.0}
    plan.add(trees.shape, position, (length, width, height), heading, **still)
    if trees.crown_m:
        crown = trees.crown_m * plan.uniform(0.8, 1.2)
        size = crown, crown, height + plan.uniform(3, 6)
        plan.add_fixed("crown", position, size, class_name="crown", reflectivity=0.3)


def _scene(plan: Plan, description: str) -> Scene:
    """Return the trees added so far as a scene, with a CE30-D on a small vehicle on uneven ground."""
    recording = RecordingParams(description=description, lidar="CE30-D", frames=50, seed=int(plan.rng.integers(2**31)))
    ground = GroundParams(roughness_m=plan.uniform(0.0, 0.03), reflectivity=plan.uniform(0.1, 0.4))
    noise = NoiseParams(
        false_return_share=plan.uniform(0.02, 0.3),
        false_return_reach_m=plan.log_uniform(0.3, 1.2),
        mixed_pixel_share=plan.uniform(0.2, 0.8),
    )
    vehicle = VesselParams(
        path=((0.0, 0.0), (1000.0, plan.uniform(-50, 50))),
        speed_ms=plan.uniform(0.2, 1.5),
        length_m=1.5,
        width_m=1.0,
        lidar_height_m=plan.uniform(0.7, 1.4),
        lidar_forward_m=0.85,
        wave_response=plan.uniform(0.1, 0.6),
    )
    return Scene(recording, ground, vehicle, tuple(plan.objects), noise)
