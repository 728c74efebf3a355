"""The point-level table of docs/reproduction.md: every method on frames of WADS, with and without duplicate points.

Run as ``python benchmarks/wads.py FOLDER``; FOLDER contains ``velodyne/*.bin`` and ``labels/*.label`` of a sequence.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np


def without_duplicates(folder: Path, target: Path) -> None:
    """Write the frames with only the first of equal points."""
    for name in ("velodyne", "labels"):
        (target / name).mkdir(parents=True)
    for file in sorted((folder / "velodyne").glob("*.bin")):
        points = np.fromfile(file, np.float32).reshape(-1, 4)
        labels = np.fromfile(folder / "labels" / f"{file.stem}.label", np.uint32)
        _, first = np.unique(points, axis=0, return_index=True)
        first.sort()
        points[first].tofile(target / "velodyne" / file.name)
        labels[first].tofile(target / "labels" / f"{file.stem}.label")


def methods(folder: Path) -> dict[str, dict[str, float]]:
    command = ["evaluate", folder, "--labels", folder, "--compare", "all", "-c", "snow", "--json", "-q"]
    done = subprocess.run([sys.executable, "-m", "seaclutter_cli", *map(str, command)], check=True, capture_output=True)
    return json.loads(done.stdout)["methods"]


def main() -> None:
    folder = Path(sys.argv[1])
    with tempfile.TemporaryDirectory() as name:
        without_duplicates(folder, Path(name) / "distinct")
        runs = {"all points": methods(folder), "distinct points": methods(Path(name) / "distinct")}
    print("| method | " + " | ".join(f"{run}: precision % | recall % | F1 % | ms" for run in runs) + " |")
    print("| --- |" + " ---: |" * 4 * len(runs))
    for method in next(iter(runs.values())):
        cells = []
        for run in runs.values():
            found = run[method]
            rates = (found["point_precision"], found["point_recall"], found["point_f1"])
            cells += ["-" if rate is None else f"{100 * rate:.1f}" for rate in rates]
            cells.append(f"{found['filter_ms']['median']:.0f}")
        print(f"| `{method}` | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
