"""The tables of docs/reproduction.md: Tables 3, 4 and 5 of [Li2023] on simulated scenes with several seeds.

Run as ``python benchmarks/reproduction.py [SEEDS]``; it uses a temporary folder and takes some minutes.
"""

import json
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np

from seaclutter_cli.config import load_config
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.pipeline import run_each
from seaclutter_cli.selection import Selection
from seaclutter_cli.sources.recordings import find_recordings

SEEDS = int(sys.argv[1]) if len(sys.argv) > 1 else 5
STAGES = {"raw": "none", "after intensity": "ring_intensity", "after outliers": "joint"}
FRAMES = range(40, 80)


def seaclutter(*arguments: object) -> None:
    command = [sys.executable, "-m", "seaclutter_cli", *map(str, arguments)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def simulated(folder: Path, scene: str, seed: int) -> Path:
    log = folder / f"{scene}-{seed}.mcap"
    seaclutter("simulate", scene, "--seed", seed, "-o", log, "-q")
    return log


def spread(values: Sequence[float], digits: int = 1) -> str:
    """Return mean and range."""
    return f"{np.mean(values):.{digits}f} ({min(values):.{digits}f} to {max(values):.{digits}f})"


def row(cells: Iterable[object]) -> None:
    print("| " + " | ".join(map(str, cells)) + " |")


class Stages:
    """Counts of buoy, speedboat and clutter points after each stage, shape (stages, 3)."""

    def __init__(self) -> None:
        self.counts = np.zeros((len(STAGES), 3))

    def add(self, frame: Frame, results: Sequence[FilterResult | None]) -> None:
        if frame.index in FRAMES:
            label = frame.cloud.points["label"]
            for stage, result in enumerate(results):
                assert result is not None
                self.counts[stage] += [np.count_nonzero((label == one) & result.keep) for one in (1, 2, 0)]


def table_3(logs: Sequence[Path]) -> None:
    """Print the points of each target and of clutter per frame after each stage."""
    rows: dict[str, list[tuple[float, ...]]] = defaultdict(list)
    for log in logs:
        stages = Stages()
        filters = [load_config(method=method).make_filter() for method in STAGES.values()]
        with closing(find_recordings([str(log)])[0].open(rate_hz=10.0)) as source:
            for frame, results, _ in run_each(source, filters, Selection()):
                stages.add(frame, results)
        for stage, found in zip(STAGES, stages.counts / len(FRAMES), strict=True):
            rows[stage].append((*found, 100 * found[2] / found.sum()))
    print("\nTable 3\n")
    row(("", "buoy", "speedboat", "clutter", "R_c %"))
    row(["---"] + ["---:"] * 4)
    for stage, found in rows.items():
        row((stage, *(spread(values) for values in zip(*found, strict=True))))


def summaries(log: Path, *options: object) -> Mapping[str, Mapping[str, float]]:
    out = log.with_suffix(".json")
    labels = log.with_suffix(".labels.csv")
    seaclutter("evaluate", log, "--labels", labels, "--summary", out, "--force", "-q", *options)
    return json.loads(out.read_text())["methods"]


def alarms(title: str, runs: Sequence[Mapping[str, Mapping[str, float]]]) -> None:
    print(f"\n{title}\n")
    names = ("N_FP", "N_FN", "R_FP", "R_FN", "f1", "clutter_removal", "target_loss")
    row(("method", "N_FP", "N_FN", "R_FP %", "R_FN %", "F1", "clutter removed %", "target points lost %"))
    row(["---"] + ["---:"] * 7)
    scale = dict.fromkeys(names, 1) | dict.fromkeys(("R_FP", "R_FN", "clutter_removal", "target_loss"), 100)
    digits = dict.fromkeys(names, 1) | {"f1": 3, "R_FP": 2, "R_FN": 2}
    for method in runs[0]:
        cells = (spread([scale[name] * run[method][name] for run in runs], digits[name]) for name in names)
        row((f"`{method}`", *cells))


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        seeds = range(1, SEEDS + 1)
        table_3([simulated(folder, "buoy_speedboat", seed) for seed in seeds])
        config = folder / "calibrated.yaml"
        clutter = simulated(folder, "clutter_only", 1)
        labels = clutter.with_suffix(".labels.csv")
        seaclutter("calibrate", clutter, "--labels", labels, "-s", "filter.end_m=70", "-o", config, "-q")
        print("\nCalibrated thresholds:", load_config(config).as_dict()["filter"]["initial_thresholds"])
        for scene in ("departure", "buoy_speedboat", "passing_speedboat", "occlusion"):
            logs = [simulated(folder, f"{scene}", seed + 100) for seed in seeds]
            published = [summaries(log, "--compare", "paper") for log in logs]
            alarms(f"Tables 4 and 5, {scene}, thresholds of Table 2", published)
            alarms(
                f"Tables 4 and 5, {scene}, calibrated thresholds",
                [summaries(log, "--compare", "paper", "-c", config) for log in logs],
            )


if __name__ == "__main__":
    main()
