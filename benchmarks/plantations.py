"""Tables as in [Bi], Table 2: three filters with their best parameters, objects found by DBSCAN.

Run as ``python benchmarks/plantations.py [-n FRAMES] [-s KEY=VALUE] SCENE_OR_LOG…``, for plantations with
``-s evaluation.cluster_tolerance_m=0.5 -s evaluation.box_margin_m=0.3 poplar willow``.

A scene is simulated twice, with one seed for tuning and one for testing. A log is divided: the first two fifths of its
duration are for tuning; its labels must be in the file that ``simulate`` writes next to it. The parameters of each
filter are those of the grid below for which ``tune`` finds the best F1 over objects.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

GRIDS = {
    "sor": ("neighbors=5,10,30,60", "std_ratio=0,0.25,0.5,1,2,3,5"),
    "ror": ("radius_m=0.1,0.2,0.35,0.5,0.8,1.2,2", "min_neighbors=2,4,8,12,20,30"),
    "adaptive_radius": (
        "presets.{scene}.radius_ratio=0.0075,0.01,0.015,0.02,0.03,0.05,0.08",
        "presets.{scene}.min_neighbors=2,4,6,9,12,20,30",
    ),
}
TRAINING_PART = 0.4
TRAINING_SEED, TEST_SEED = 101, 201


def seaclutter(*arguments: object) -> str:
    command = [sys.executable, "-m", "seaclutter_cli", *map(str, arguments)]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


@dataclass(frozen=True)
class Part:
    """A part of a recording: the log and the options that select the part."""

    log: Path
    selection: tuple[object, ...]

    @property
    def arguments(self) -> tuple[object, ...]:
        return (self.log, "--labels", self.log.with_suffix(".labels.csv"), *self.selection, "-q")


def parts(name: str, folder: Path, frames: int | None) -> tuple[Part, Part]:
    """Return the parts for tuning and for testing."""
    some = ("-n", frames) if frames else ()
    if Path(name).suffix == ".mcap":
        (info,) = json.loads(seaclutter("info", name, "--json"))
        middle = TRAINING_PART * info["duration_s"]
        return Part(Path(name), ("--end", middle, *some)), Part(Path(name), ("--start", middle, *some))
    logs = [folder / f"{name}-{seed}.mcap" for seed in (TRAINING_SEED, TEST_SEED)]
    for log, seed in zip(logs, (TRAINING_SEED, TEST_SEED), strict=True):
        if not log.exists():
            seaclutter("simulate", name, "--seed", seed, "-o", log, "-q")
    return Part(logs[0], some), Part(logs[1], some)


def measured(method: str, scene: str, training: Part, test: Part, overrides: Sequence[str]) -> dict[str, object]:
    """Return the scores of a filter with the parameters that are best on the training part."""
    settings = [item for override in overrides for item in ("-s", override)]
    swept = [item.format(scene=scene) for item in GRIDS[method]]
    sweeps = [item for sweep in swept for item in ("--sweep", sweep)]
    if method == "adaptive_radius":
        settings += ["-s", f"filter.scene={scene}"]
    settings += ["-s", "evaluation.clustering=dbscan", "-m", method, "--json"]
    tuning = ("--hold-out", "0", *sweeps, *settings)  # the test part is another recording
    combinations = json.loads(seaclutter("tune", *training.arguments, *tuning))["combinations"]
    chosen = max(combinations, key=lambda found: found["f1"] or 0)
    best = {key: chosen[key] for key in (item.partition("=")[0] for item in swept)}
    settings += [item for key, value in best.items() for item in ("-s", f"filter.{key}={value}")]
    found = json.loads(seaclutter("evaluate", *test.arguments, *settings))["methods"][method]
    return {**found, "best": best}


def row(cells: Iterable[object]) -> None:
    print("| " + " | ".join(map(str, cells)) + " |", flush=True)


def show(method: str, found: dict) -> None:
    shares = (f"{100 * (found[name] or 0):.1f}" for name in ("precision", "recall"))
    counts = (f"{found[name]:.2f}" for name in ("false_alarms_per_frame", "unclustered_points_per_frame"))
    best = ", ".join(f"{key.rpartition('.')[2]} {value}" for key, value in found["best"].items())
    row((f"`{method}`", best, *shares, f"{found['f1'] or 0:.3f}", *counts, f"{found['filter_ms']['median']:.1f}"))


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("-n", "--frames", type=int, help="frames of each part (default: all)")
    parser.add_argument("-s", "--set", dest="overrides", action="append", default=[])
    parser.add_argument("--scene", default="open", help="preset of the adaptive radius filter to tune")
    parser.add_argument("--folder", type=Path, help="folder for simulated logs, to reuse them")
    parser.add_argument("names", nargs="+", metavar="SCENE_OR_LOG")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        for name in given.names:
            training, test = parts(name, given.folder or Path(temporary), given.frames)
            print(f"\n### {Path(name).stem}\n")
            row(("method", "best parameters", "precision %", "recall %", "F1", "noise clusters", "unclustered", "ms"))
            row(("---", "---", *["---:"] * 6))
            for method in GRIDS:
                show(method, measured(method, given.scene, training, test, given.overrides))


if __name__ == "__main__":
    main()
