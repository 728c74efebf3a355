"""Options of simulations."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Literal

from seaclutter_cli.errors import UsageError
from seaclutter_cli.options import (
    Anything,
    Choice,
    Converted,
    Grouped,
    OptionalPath,
    Parsed,
    Place,
    Whole,
    grouped,
    option,
)
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.options import BatchOptions, Replacing

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seaclutter_cli.urls import PathLike

_RANGE = re.compile(r"\s*(\d{1,9})(?:\s*(?:\.\.|-)\s*(\d{1,9}))?\s*")
_MAX_SEEDS = 100_000


def parse_seeds(text: str) -> tuple[int, ...]:
    """Return the seeds that numbers and ranges describe, each once; raise `UsageError` if the text is something else.

    Examples
    --------
    >>> parse_seeds("1..4,9"), parse_seeds("7-8")
    ((1, 2, 3, 4, 9), (7, 8))
    """
    seeds: dict[int, None] = {}
    for part in text.split(","):
        found = _RANGE.fullmatch(part)
        first = int(found[1]) if found else 0
        last = int(found[2] or first) if found else -1
        if not 0 <= last - first < _MAX_SEEDS - len(seeds):
            raise UsageError(f"--seeds {text}: write numbers and ranges, such as 1..5 or 1,2,7; at most {_MAX_SEEDS:,}")
        seeds.update(dict.fromkeys(range(first, last + 1)))
    return tuple(seeds)


class SimulateOptions(Replacing):
    """Options of a simulation: values that replace those of the scene, and additional output.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.SimulateOptions(frames=10, lidar="RS-LiDAR-16").seed is None
    True
    """

    frames: int | None = option(
        "-n --frames", default=None, kind=Whole(1), help="Number of frames; overrides the scene."
    )
    seed: int | None = option(
        "--seed", default=None, kind=Whole(0), help="Random seed; overrides the scene. 1 by default for a layout."
    )
    physics: Literal["wide"] | None = option(
        "--physics",
        default=None,
        kind=Choice(("wide",)),
        help="Draw water, weather, lidar and own ship from ranges of published physics; with SCENE random, all of it.",
    )
    lidar: str | None = option("--lidar NAME", default=None, help="Lidar model; overrides the scene.")
    form: Literal["mcap", "pcap"] | None = option(
        "--format",
        default=None,
        kind=Choice(("mcap", "pcap")),
        help="MCAP with PointCloud2, or packets of a RoboSense lidar; by default from the suffix of LOG.",
    )
    scene_file: OptionalPath = option(
        "--scene-file YAML",
        default=None,
        kind=Place(output=True),
        help="Save the scene with all defaults and comments, for editing.",
    )


class SimulationOptions(SimulateOptions):
    """Options of a simulation, with its scene and output."""

    scene: PathLike = option(
        "SCENE",
        kind=Anything(),
        help="Scene file (YAML), or the name of a built-in scene, layout or tile scene.",
        kw_only=False,
    )
    output: PathLike = option(
        "-o --output OUT",
        kind=Place(output=True, or_folder=True),
        help="Recording to write; .las or .laz for a tile; with --seeds, a folder.",
        kw_only=False,
    )
    seeds: Converted[str | Sequence[int] | None, tuple[int, ...] | None] = option(
        "--seeds SEEDS",
        default=None,
        kind=Parsed(parse_seeds),
        help="Simulate a recording for each seed, such as 1..5 or 1,2,7.",
    )
    batch: Grouped[BatchOptions] = grouped("resume", "manifest", default=BatchOptions())
    observer: Observer = option(default=SILENT, kind=Anything(is_place=True), help="Receives progress.")
