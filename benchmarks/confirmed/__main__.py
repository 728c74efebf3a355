"""The study of the method ``confirmed`` in docs/reproduction.md, on simulated recordings in memory.

Run as ``python benchmarks/confirmed STUDY``; it prints Markdown tables. Counts can be saved (``--json FILE``) and
printed again without a new run (``python benchmarks/confirmed tables FILE``).
"""

import argparse
import json
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from pictures import Failure, failures
from recordings import SEA_LAYOUTS, marine_scenes
from scores import run
from studies import STUDIES, Options
from variants import CALIBRATED, PAPER

Input = TypeVar("Input")
Output = TypeVar("Output")


def parsed() -> argparse.Namespace:
    """Return the command line."""
    parser = argparse.ArgumentParser(prog="benchmarks/confirmed", description=__doc__.partition("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("--first-seed", type=int, default=1, help="first seed; the others follow it")
    common.add_argument("--frames", type=int, help="maximum number of frames of a recording")
    common.add_argument("--scenes", nargs="+", default=(), help="names of scenes or layouts; all by default")
    common.add_argument("--jobs", type=int, default=2, help="number of processes")
    for name, study in STUDIES.items():
        command = commands.add_parser(name, parents=[common], help=study.about)
        command.add_argument("--seeds", type=int, default=study.seeds, help="number of seeds")
        command.add_argument("--json", type=Path, help="file for the counts")
    command = commands.add_parser("failures", parents=[common], help="pictures of the worst frames")
    command.add_argument("folder", type=Path, help="folder for the pictures")
    command.add_argument("--seeds", type=int, default=2, help="number of seeds")
    command.add_argument("--number", type=int, default=6, help="maximum number of pictures")
    command.add_argument("--each", type=int, default=1, help="maximum number of pictures of one scene")
    command.add_argument("--layouts", action="store_true", help="random layouts instead of scenes")
    command.add_argument("--calibrated", action="store_true", help="calibrated thresholds instead of the paper's")
    command = commands.add_parser("tables", help="the tables of saved counts")
    command.add_argument("file", type=Path, help="file of --json")
    return parser.parse_args()


def parallel(work: Callable[[Input], Output], jobs: Iterable[Input], processes: int) -> Iterator[Output]:
    """Yield the results of jobs in their order."""
    if processes == 1:
        yield from map(work, jobs)
        return
    with ProcessPoolExecutor(processes) as pool:
        yield from pool.map(work, jobs)


def options_of(given: argparse.Namespace) -> Options:
    return Options(range(given.first_seed, given.first_seed + given.seeds), given.frames, given.scenes)


def study(given: argparse.Namespace) -> None:
    """Run a study and print its tables."""
    jobs = STUDIES[given.command].jobs(options_of(given))
    start_s = time.monotonic()
    records = [record for found in parallel(run, jobs, given.jobs) for record in found]
    if given.json:
        given.json.write_text(json.dumps({"study": given.command, "records": records}, indent=1) + "\n")
    show(given.command, records)
    print(f"\n{len(jobs)} recordings with seeds from {given.first_seed}, {time.monotonic() - start_s:.0f} s")


def show(name: str, records: Sequence[dict[str, Any]]) -> None:
    """Print the tables of a study."""
    for title, table in STUDIES[name].tables(records):
        print(f"\n{title}:\n\n{table}")


def draw_failures(given: argparse.Namespace) -> None:
    """Write the pictures of the worst frames and print their captions."""
    recordings = options_of(given).recordings(SEA_LAYOUTS if given.layouts else marine_scenes())
    work = partial(failures, thresholds=CALIBRATED if given.calibrated else PAPER, most=given.each)
    found = [one for several in parallel(work, recordings, given.jobs) for one in several]
    found.sort(key=lambda one: -(one.missed + one.false_alarms))
    given.folder.mkdir(parents=True, exist_ok=True)
    for one in _few_of_each(found, given.each)[: given.number]:
        (given.folder / one.name).write_bytes(one.png)
        print(f"\n![{one.caption}](pictures/{one.name})")


def _few_of_each(found: Sequence[Failure], most: int) -> list[Failure]:
    """Return at most a few failures of each scene."""
    scenes = [one.recording.scene for one in found]
    return [one for k, one in enumerate(found) if scenes[:k].count(one.recording.scene) < most]


def main() -> None:
    given = parsed()
    if given.command == "failures":
        draw_failures(given)
    elif given.command == "tables":
        saved = json.loads(given.file.read_text())
        show(saved["study"], saved["records"])
    else:
        study(given)


if __name__ == "__main__":
    main()
