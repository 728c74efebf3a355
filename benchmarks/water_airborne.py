"""The table of real water in docs/reproduction.md: level, attitude and wave height from airborne points.

Run as ``python benchmarks/water_airborne.py TILE.laz``; class 9 of the tile is water. A virtual lidar stands 2.5 m
above the water at every 15 m and receives all points within 45 m, as one frame. The truth is the points of class 9
among them that belong to its own basin: their median, and four times their standard deviation.
"""

import sys
from collections import defaultdict
from dataclasses import astuple, dataclass

import laspy
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from seaclutter_cli.water import Faces, WaterTracker

WATER = 9
MAST_M, REACH_M, SPACING_M, MARGIN_M = 2.5, 45.0, 15.0, 15.0
BASIN_M = -0.6
"""Elevation between the two basins of the sluice."""
WRONG_M = 0.1


@dataclass(frozen=True)
class Estimate:
    """Estimate at one position; errors are estimate minus truth."""

    level_m: float
    tilt_deg: float
    wave_height_m: float
    true_wave_height_m: float


def surroundings(own: NDArray[np.bool_], water: NDArray[np.bool_]) -> str:
    """Return what is around a position, from masks of the water of its own basin and of all water."""
    if (water & ~own).any():
        return "both basins in view"
    for least, name in ((0.995, "open water"), (0.8, "up to a fifth is land"), (0.5, "up to half is land")):
        if own.mean() >= least:
            return name
    return "more land than water"


def estimate(xyz: NDArray[np.float64], own: NDArray[np.bool_]) -> Estimate | None:
    """Return the estimate from points around a virtual lidar, shape (3, N); None without water."""
    surface = WaterTracker().step(xyz, Faces.of(xyz), 0.0)
    if surface is None:
        return None
    state, deviation_m = surface.state, float(np.std(xyz[2, own]))
    tilt_deg = float(np.hypot(state.roll_deg, state.pitch_deg))
    return Estimate(state.level_m + MAST_M, tilt_deg, state.significant_wave_height_m, 4 * deviation_m)


def estimates(path: str) -> dict[tuple[str, str], list[Estimate | None]]:
    """Return the estimates at all positions over water, by basin and surroundings."""
    tile = laspy.read(path)
    xyz = np.stack([tile.x, tile.y, tile.z]).astype(np.float64)
    is_water = np.asarray(tile.classification) == WATER
    tree = cKDTree(xyz[:2].T)
    (west, south), (east, north) = xyz[:2].min(axis=1) + MARGIN_M, xyz[:2].max(axis=1) - MARGIN_M
    found = defaultdict(list)
    for x in np.arange(west, east, SPACING_M):
        for y in np.arange(south, north, SPACING_M):
            below = tree.query_ball_point((x, y), 5.0)
            if len(below) < 10 or not is_water[below].all():
                continue
            is_upper = np.median(xyz[2, below]) > BASIN_M
            around = np.sort(tree.query_ball_point((x, y), REACH_M))
            water = is_water[around]
            own = water & ((xyz[2, around] > BASIN_M) == is_upper)
            level_m = float(np.median(xyz[2, around[own]]))
            points = xyz[:, around] - np.array([[x], [y], [level_m + MAST_M]])
            name = "upper, -0.25 m" if is_upper else "lower, -0.9 m"
            found[name, surroundings(own, water)].append(estimate(points, own))
    return found


def row(key: tuple[str, str], items: list[Estimate | None]) -> str:
    known = [one for one in items if one is not None]
    error, tilt, height, true_height = np.array([astuple(one) for one in known]).T
    cells = (
        *key,
        len(items),
        len(items) - len(known),
        f"{100 * np.median(error):+.1f}",
        f"{100 * np.quantile(np.abs(error), 0.9):.1f}",
        np.count_nonzero(np.abs(error) > WRONG_M),
        f"{np.median(tilt):.2f}",
        f"{np.median(true_height):.2f}",
        f"{np.median(height):.2f}",
    )
    return f"| {' | '.join(map(str, cells))} |"


def main() -> None:
    names = (
        "basin",
        "surroundings",
        "positions",
        "no water found",
        "level error: median cm",
        "90 % of sizes below cm",
        "above 10 cm",
    )
    names += ("tilt: median °", "wave height: truth m", "estimate m")
    print(f"| {' | '.join(names)} |")
    print("| --- | --- |" + " ---: |" * (len(names) - 2))
    for key, items in sorted(estimates(sys.argv[1]).items()):
        print(row(key, items))


if __name__ == "__main__":
    main()
