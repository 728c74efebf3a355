"""The command line that the simulators of labelled logs at sea share."""

import argparse
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from seaclutter_cli.runs.options.logs import parse_seeds


def parser_of(script: str, description: str, families: Iterable[str]) -> argparse.ArgumentParser:
    """Return a parser with the options that all simulators have; the description is the first line of a text."""
    names = list(families)
    parser = argparse.ArgumentParser(prog=f"benchmarks/{script}", description=description.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="folder for the logs")
    parser.add_argument("--seeds", type=parse_seeds, default=(1,), help="such as 1..40 or 3,7")
    parser.add_argument("--families", nargs="+", choices=names, default=names, help="one log of each per seed")
    parser.add_argument("--jobs", type=int, default=1, help="number of processes")
    return parser


def record_all(record: Callable[..., None], logs: Iterable[tuple[Any, ...]], folder: Path, jobs: int) -> None:
    """Record logs, of each of which the arguments are given, in a folder that need not exist."""
    folder.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(jobs) as pool:
        list(pool.map(partial(record, folder=folder), *zip(*logs, strict=True)))
