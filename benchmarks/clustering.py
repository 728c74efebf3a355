"""Speed of clustering on one frame: Euclidean compared with a scipy tree, DBSCAN compared with scikit-learn.

The tree only counts neighbours within the same distance. The implementations alternate within one run. Run as
``python benchmarks/clustering.py``; without scikit-learn its column is nan.
"""

import statistics
import time
from collections.abc import Callable

import numpy as np
from logs import BEAMS, COLUMNS, POINTS, SHARES, frame
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from seaclutter_cli.clustering import DbscanFinder, euclidean_clusters

try:
    from sklearn.cluster import DBSCAN
except ImportError:
    DBSCAN = None

RUNS = 9
TOLERANCE_M = 1.5
MIN_POINTS = 5


def rays() -> NDArray[np.float64]:
    """Return the directions of the shots of a frame, shape (3, 57600)."""
    azimuth = np.repeat(np.arange(COLUMNS) * np.radians(0.2), BEAMS)
    elevation = np.tile(np.radians(np.linspace(-16, 15, BEAMS)), COLUMNS)
    return np.stack((np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)))


def basin() -> NDArray[np.float64]:
    """Return the points of a harbour with a return for every shot: four quay walls, moored boats, the water."""
    direction = rays()
    with np.errstate(divide="ignore"):
        walls = [np.where(s * direction[a] > 0, d / (s * direction[a]), 200) for a, s, d in WALLS]
        water = np.where(direction[2] < 0, -3 / direction[2], 200)
    sector = np.arctan2(direction[1], direction[0]) // 0.1
    boats = np.where(sector % 3 > 0, 15 + sector * 7 % 11, 200)
    range_m = np.min([*walls, boats, water], axis=0)
    return direction * (range_m + np.random.default_rng(0).normal(0, 0.03, POINTS))


WALLS = ((0, 1, 40.0), (0, -1, 25.0), (1, 1, 18.0), (1, -1, 30.0))


def cloud(share: float, *, bright: bool = False) -> NDArray[np.float64]:
    """Return the points of a synthetic frame; with ``bright``, only those above an intensity threshold."""
    points = frame(1, share)
    points = points[np.isfinite(points["x"]) & ((points["intensity"] > 30) | (not bright))]
    return np.stack([points[axis] for axis in "xyz"]).astype(np.float64)


def open_sea() -> NDArray[np.float64]:
    """Return 3,800 points of waves and two boats."""
    rng = np.random.default_rng(0)
    waves = rng.normal(0, 1, (3, 3000)) * np.array([[25], [25], [0.5]])
    boats = [rng.normal(0, 1, (3, 400)) + np.array([[x], [20], [1]]) for x in (-30, 45)]
    return np.concatenate((waves, *boats), axis=1)


def timed(function: Callable[[], object]) -> float:
    started = time.perf_counter()
    function()
    return 1000 * (time.perf_counter() - started)


def count_neighbors(points: NDArray[np.float64]) -> object:
    return cKDTree(points).query_ball_point(points, TOLERANCE_M, return_length=True)


def dbscan(xyz: NDArray[np.float64], eps_m: float, min_points: int) -> NDArray[np.int64]:
    everything = np.ones(xyz.shape[1], np.bool_)
    return DbscanFinder(xyz, everything, eps_m, min_points).clusters(everything, 1)


def dbscan_of_sklearn(points: NDArray[np.float64]) -> object:
    return DBSCAN(eps=TOLERANCE_M, min_samples=MIN_POINTS, n_jobs=1).fit(points)


def show(title: str, other: str, frames: dict, cluster: Callable, peer: Callable | None) -> None:
    """Print the times of a clustering method and of the implementation it is compared with."""
    print(f"{title:<20}{'points':>8}{'clusters':>10}{'ms':>8}{other:>12}{'ratio':>7}")
    for name, xyz in frames.items():
        points = np.ascontiguousarray(xyz.T)
        found = int(cluster(xyz, TOLERANCE_M, MIN_POINTS).max()) + 1
        rows = []
        for _ in range(RUNS):
            own = timed(lambda xyz=xyz: cluster(xyz, TOLERANCE_M, MIN_POINTS))
            rows.append((own, timed(lambda points=points: peer(points)) if peer else np.nan))
        own, others = (statistics.median(column) for column in zip(*rows, strict=True))
        ratio = statistics.median(row[0] / row[1] for row in rows)
        print(f"{name:<20}{len(points):>8}{found:>10}{own:>8.1f}{others:>12.1f}{ratio:>7.2f}")


def main() -> None:
    frames = {
        "harbour, all walls": basin(),
        "noise, everywhere": cloud(SHARES["harbour"]),
        "harbour, filtered": cloud(SHARES["harbour"], bright=True),
        "open sea": open_sea(),
        "sea, filtered": cloud(SHARES["sea"], bright=True),
    }
    show("Euclidean", "cKDTree ms", frames, euclidean_clusters, count_neighbors)
    show("DBSCAN", "sklearn ms", frames, dbscan, dbscan_of_sklearn if DBSCAN else None)


if __name__ == "__main__":
    main()
