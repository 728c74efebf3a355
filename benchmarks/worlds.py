"""False alarms and missed targets on worlds of wide physics, by family.

Run as ``python benchmarks/worlds.py FOLDER --seeds 1..40``. Worlds of the seeds are simulated into the folder, unless
they are there; ``--families`` draws one of each of these for each seed, and ``--without`` leaves out worlds that are an
example of a family. Worlds of one seed share what their families do not change, so several seeds are needed. Targets
count in frames in which a filter that keeps exactly their echoes would find them. Rates are means over worlds.
"""

import argparse
import csv
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from ideal import unseen

from seaclutter_cli.runs.options.logs import parse_seeds
from seaclutter_cli.simulation.layouts.worlds import FAMILIES, draw_world
from seaclutter_cli.simulation.marine.recording import SimulatedFrame, record

COLUMNS = ("R_FP", "R_FN", "target_loss")

World = tuple[int, str | None]


def parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="benchmarks/worlds.py", description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="folder for the recordings")
    parser.add_argument("--seeds", type=parse_seeds, default=tuple(range(1, 41)), help="such as 1..40 or 3,7")
    parser.add_argument("--families", nargs="*", choices=list(FAMILIES), default=(), help="one world of each per seed")
    parser.add_argument("--without", nargs="*", choices=list(FAMILIES), default=(), help="families to leave out")
    parser.add_argument("--methods", nargs="+", default=("joint", "confirmed", "none"))
    parser.add_argument("--set", nargs="*", default=(), help="settings of the methods, such as filter.start_m=5")
    parser.add_argument("--worst", type=int, default=0, help="also list this many worlds with the most errors")
    parser.add_argument("--jobs", type=int, default=2, help="number of processes")
    return parser.parse_args()


def name_of(world: World) -> str:
    seed, family = world
    return f"{(family or 'world').replace(' ', '_')}_{seed}"


def simulate(world: World, folder: Path) -> None:
    """Write a world to the folder, unless it is there. Targets that no filter could find are ignored in their frame."""
    log = folder / f"{name_of(world)}.mcap"
    labels = log.with_suffix(".labels.csv")
    if log.exists() and labels.exists():
        return
    faint: set[tuple[str, str]] = set()

    def on_frame(frame: SimulatedFrame) -> None:
        faint.update((str(frame.index), track) for track in unseen(frame.points, frame.boxes))

    raw = log.with_suffix(".csv")
    record(draw_world(*world), log, raw, on_frame)
    with raw.open() as source, labels.open("w", newline="") as target:
        rows = csv.DictReader(source)
        writer = csv.DictWriter(target, rows.fieldnames or (), lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow(row | ({"class": "ignore"} if (row["frame"], row["track_id"]) in faint else {}))
    raw.unlink()


def evaluate(worlds: Sequence[World], given: argparse.Namespace) -> Mapping[str, Any]:
    """Return the counts of each world and method."""
    summary = given.folder / "summary.json"
    summary.unlink(missing_ok=True)  # the folder is that of the labels, too
    logs = [given.folder / f"{name_of(world)}.mcap" for world in worlds]
    command = [sys.executable, "-m", "seaclutter_cli", "evaluate", *map(str, logs), "--labels", str(given.folder)]
    command += [part for method in given.methods for part in ("-m", method)]
    command += [part for setting in given.set for part in ("-s", setting)]
    command += ["--summary", str(summary), "--force", "-q", "-j", str(given.jobs)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    recordings = json.loads(summary.read_text())["recordings"]
    return {one["recording"]: one["methods"] for one in recordings}


def rates(results: Sequence[Mapping[str, Any]]) -> str:
    """Return the mean rates of some worlds in percent, as cells of a table."""
    cells = []
    for name in COLUMNS:
        known = [one[name] for one in results if one[name] is not None]
        cells.append(f"{100 * np.mean(known):.1f}" if known else "-")
    return " / ".join(cells)


def print_table(worlds: Sequence[World], counts: Mapping[str, Any], methods: Sequence[str]) -> None:
    of_world = {world: draw_world(*world).physics for world in worlds}
    of_family = {
        family: [world for world, physics in of_world.items() if physics and family in physics.families]
        for family in FAMILIES
    }
    print(f"| family | worlds | {' | '.join(f'`{method}`' for method in methods)} |\n|---|---:|{'---|' * len(methods)}")
    for family, some in {**of_family, "all": list(worlds)}.items():
        cells = [rates([counts[name_of(world)][method] for world in some]) for method in methods]
        if some:
            print(f"| {family} | {len(some)} | {' | '.join(cells)} |")
    print(f"\n{', '.join(COLUMNS)} in %")


def print_worst(worlds: Sequence[World], counts: Mapping[str, Any], method: str, number: int) -> None:
    def errors(world: World) -> float:
        return sum(counts[name_of(world)][method][name] or 0.0 for name in COLUMNS)

    for world in sorted(worlds, key=errors, reverse=True)[:number]:
        scene = draw_world(*world)
        families = scene.physics.families if scene.physics else ()
        print(f"{name_of(world)}: {rates([counts[name_of(world)][method]])}; {scene.recording.lidar}, {families}")


def main() -> None:
    given = parsed()
    given.folder.mkdir(parents=True, exist_ok=True)
    worlds: list[World] = [(seed, family) for seed in given.seeds for family in given.families or (None,)]
    without = set(given.without)
    worlds = [world for world in worlds if not without & set(getattr(draw_world(*world).physics, "families", ()))]
    with ProcessPoolExecutor(given.jobs) as pool:
        for _ in pool.map(partial(simulate, folder=given.folder), worlds):
            pass
    counts = evaluate(worlds, given)
    print_table(worlds, counts, given.methods)
    for method in given.methods if given.worst else ():
        print(f"\n{method}:")
        print_worst(worlds, counts, method, given.worst)


if __name__ == "__main__":
    main()
