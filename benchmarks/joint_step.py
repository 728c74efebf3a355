"""Speed of the joint method on one frame, compared with statistical outlier removal by scipy and Open3D.

Outlier removal uses the whole frame. Run as ``python benchmarks/joint_step.py``; without Open3D its columns are nan.
"""

import statistics
import time
from collections.abc import Callable

import numpy as np
from logs import SHARES, frame, share_above_threshold
from scipy.spatial import cKDTree

from seaclutter_cli.cloud import from_array
from seaclutter_cli.filters import FILTERS
from seaclutter_cli.frame import Frame

RUNS = 15
NEIGHBORS = 30


def scipy_sor(points: np.ndarray) -> np.ndarray:
    distance = cKDTree(points).query(points, NEIGHBORS + 1, workers=-1)[0][:, 1:].mean(axis=1)
    return distance > distance.mean() + distance.std(ddof=1)


def open3d_sor() -> Callable[[np.ndarray], object] | None:
    try:
        import open3d
    except ImportError:
        return None

    def run(points: np.ndarray) -> object:
        cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
        return cloud.remove_statistical_outlier(NEIGHBORS, 1.0)

    return run


def timed(function: Callable[[], object]) -> float:
    started = time.perf_counter()
    function()
    return 1000 * (time.perf_counter() - started)


def compare(points: np.ndarray, other: Callable[[np.ndarray], object] | None) -> list[tuple[float, float, float]]:
    """Return the milliseconds of the joint method, of scipy and of Open3D, run by run."""
    cloud = from_array(points)
    method = FILTERS["ring_intensity_outlier"]
    joint = method(method.Params())  # the work of the joint method on a first frame, in every run
    xyz = np.stack([points[axis] for axis in "xyz"], axis=1).astype(np.float64)
    xyz = xyz[np.isfinite(xyz).all(axis=1)]
    rows = []
    for _ in range(RUNS):
        mine = timed(lambda: joint.step(Frame(cloud)))
        sor = timed(lambda: scipy_sor(xyz))
        rows.append((mine, sor, timed(lambda: other(xyz)) if other else float("nan")))
    return rows


def main() -> None:
    print(f"{'frame':<10}{'above':>8}{'joint ms':>10}{'scipy SOR ms':>14}{'ratio':>8}{'Open3D SOR ms':>15}{'ratio':>8}")
    other = open3d_sor()
    for name, share in SHARES.items():
        rows = compare(frame(1, share), other)
        mine, sor, theirs = (statistics.median(column) for column in zip(*rows, strict=True))
        ratio, against = (statistics.median(row[0] / row[column] for row in rows) for column in (1, 2))
        above = share_above_threshold(share)
        print(f"{name:<10}{above:>8.1%}{mine:>10.2f}{sor:>14.1f}{ratio:>8.3f}{theirs:>15.1f}{against:>8.3f}")


if __name__ == "__main__":
    main()
