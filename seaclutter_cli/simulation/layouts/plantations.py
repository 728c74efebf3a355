"""Plantations as in S3: trees in rows, seen by a solid-state lidar on a vehicle between them."""

from dataclasses import dataclass

import numpy as np

from seaclutter_cli.simulation.layouts.plan import Plan
from seaclutter_cli.simulation.lidar.noise import NoiseParams
from seaclutter_cli.simulation.marine.ground import GroundParams
from seaclutter_cli.simulation.marine.scene import RecordingParams, Scene, VesselParams

_REACH_M = 30.0


@dataclass(frozen=True)
class Trees:
    """Trees of one kind.

    Parameters
    ----------
    kind : str
        Class in the labels.
    shape : str
        What of them is labelled.
    row_m, step_m : tuple of (float, float)
        Distance between rows, and between trees in a row: least and most.
    wide_m, high_m : tuple of (float, float)
        Width and height of what is labelled: least and most.
    aside_m : float
        How far to either side there are rows; those behind dense ones cannot be seen.
    crown_m : float
        Width of the crown above it, an area to ignore; 0 where there is none.
    """

    kind: str
    shape: str
    row_m: tuple[float, float]
    step_m: tuple[float, float]
    wide_m: tuple[float, float]
    high_m: tuple[float, float]
    aside_m: float
    crown_m: float = 0.0


APPLE = Trees("apple tree", "apple_tree", (2.6, 3.8), (0.8, 1.2), (0.8, 1.2), (2.2, 3.2), 9.0)
POPLAR = Trees("poplar", "trunk", (2.6, 3.6), (2.6, 3.6), (0.16, 0.32), (2.4, 3.2), 16.0, 1.8)
WILLOW = Trees("willow", "trunk", (3.0, 4.5), (3.0, 4.5), (0.08, 0.18), (1.9, 2.6), 16.0, 2.6)


def apple_rows(rng: np.random.Generator) -> Scene:
    """Make dense rows of dwarf apple trees, which touch each other at breast height."""
    return _plantation(Plan(rng), APPLE, "Dense rows of dwarf apple trees.")


def poplar_grove(rng: np.random.Generator) -> Scene:
    """Make a grove of poplars that stand apart."""
    return _plantation(Plan(rng), POPLAR, "Poplars that stand apart.")


def willow_grove(rng: np.random.Generator) -> Scene:
    """Make a grove of willows that stand apart, with thin stems."""
    return _plantation(Plan(rng), WILLOW, "Willows that stand apart.")


def _plantation(plan: Plan, trees: Trees, about: str) -> Scene:
    row, step, missing = plan.uniform(*trees.row_m), plan.uniform(*trees.step_m), plan.uniform(0, 0.08)
    turned = np.radians(plan.uniform(-4, 4) if trees is APPLE else plan.uniform(-30, 30))
    shift = plan.uniform(-0.15, 0.15) * row
    ends = plan.uniform(12, _REACH_M + 4) if plan.chance(0.3) else _REACH_M + 4
    rows = np.arange(-7.5, 8) * row
    for aside in rows[np.abs(rows) <= trees.aside_m]:
        for along in np.arange(-2.0, ends, step) + plan.uniform(0, step):
            x, y = float(along) + plan.uniform(-0.1, 0.1), float(aside) + shift + plan.uniform(-0.08, 0.08)
            place = x * float(np.cos(turned)) - y * float(np.sin(turned)), x * np.sin(turned) + y * np.cos(turned)
            if not plan.chance(missing) and np.hypot(*place) > 1.2:
                _tree(plan, trees, place, step)
    return _seen(plan, about)


def _tree(plan: Plan, trees: Trees, place: tuple[float, float], step_m: float) -> None:
    """Add a tree: what is labelled of it, and its crown."""
    wide, high, bright = plan.uniform(*trees.wide_m), plan.uniform(*trees.high_m), plan.uniform(0.3, 0.65)
    long = max(wide, 1.15 * step_m) if trees is APPLE else wide
    heading = 180.0 * plan.count(0, 1) if trees is APPLE else plan.uniform(-180, 180)
    plan.add(
        trees.shape, place, (long, wide, high), heading, class_name=trees.kind, reflectivity=bright, wave_response=0.0
    )
    if trees.crown_m:
        crown = trees.crown_m * plan.uniform(0.8, 1.2)
        plan.fixed("crown", place, (crown, crown, high + plan.uniform(3, 6)), class_name="crown", reflectivity=0.3)


def _seen(plan: Plan, about: str) -> Scene:
    """Return the scene: what was gathered, with a CE30-D on a small vehicle on uneven ground."""
    recording = RecordingParams(description=about, lidar="CE30-D", frames=50, seed=int(plan.rng.integers(2**31)))
    ground = GroundParams(roughness_m=plan.uniform(0.0, 0.03), reflectivity=plan.uniform(0.1, 0.4))
    noise = NoiseParams(
        false_return_share=plan.uniform(0.02, 0.3),
        false_return_reach_m=plan.log(0.3, 1.2),
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
