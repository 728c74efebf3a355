"""Speed of the adaptive radius filter on one frame, compared with statistical outlier removal and DROR.

Run as ``python benchmarks/adaptive_radius.py``. The methods alternate within one run. Each time is for the whole step
on a frame whose coordinates and ranges are not yet computed.
"""

import statistics
import time
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from clustering import basin
from logs import SHARES, frame

from seaclutter_cli.cloud import Cloud, from_array
from seaclutter_cli.filters import FILTERS
from seaclutter_cli.filters.radius import PRESETS, AdaptiveRadiusParams, Preset
from seaclutter_cli.frame import Frame
from seaclutter_cli.interfaces import Filter

RUNS = 15


def harbour_walls() -> np.ndarray:
    """Return the points of a frame in which every beam has a return."""
    points = np.zeros(57_600, [(axis, "<f4") for axis in "xyz"])
    for axis, values in zip("xyz", basin(), strict=True):
        points[axis] = values
    return points


def methods() -> Mapping[str, Filter]:
    usual = AdaptiveRadiusParams()
    everything = replace(usual, presets={"open": Preset(radius_ratio=1e6, min_neighbors=4)})
    return {
        "sor": FILTERS["sor"](FILTERS["sor"].Params()),
        "open": FILTERS["adaptive_radius"](usual),
        "confined": FILTERS["adaptive_radius"](replace(usual, scene="confined")),
        "huge K": FILTERS["adaptive_radius"](everything),
        "dror": FILTERS["dror"](FILTERS["dror"].Params()),
    }


def timed(method: Filter, cloud: Cloud) -> float:
    started = time.perf_counter()
    method.step(Frame(cloud))
    return 1000 * (time.perf_counter() - started)


def main() -> None:
    frames = {"harbour, all walls": harbour_walls(), **{name: frame(1, share) for name, share in SHARES.items()}}
    compared = methods()
    print(
        f"{'frame':<20}{'points':>8}"
        + "".join(f"{name + ' ms':>14}" for name in compared)
        + "".join(f"{name + ' / sor':>16}" for name in PRESETS)
    )
    for name, points in frames.items():
        cloud = from_array(points)
        rows = [[timed(method, cloud) for method in compared.values()] for _ in range(RUNS)]
        times = "".join(f"{statistics.median(column):>14.1f}" for column in zip(*rows, strict=True))
        ratios = "".join(f"{statistics.median(row[k] / row[0] for row in rows):>16.2f}" for k in (1, 2))
        print(f"{name:<20}{len(points):>8}{times}{ratios}")


if __name__ == "__main__":
    main()
