"""What ``seaclutter classify separate`` does."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import click
import numpy as np

from seaclutter_cli.airborne.separation import OTHER, WATER, Separation, separate
from seaclutter_cli.airborne.settings import load_settings
from seaclutter_cli.airborne.surface import SeparationParams
from seaclutter_cli.commands.console import share, table
from seaclutter_cli.commands.tiles import plan_tiles, write_tile
from seaclutter_cli.errors import InputError
from seaclutter_cli.sources.tiles import CloudTile, LasTile, find_tiles, open_tile

HEIGHT = {"height_above_sea": ("f4", "metres above the sea surface")}


@dataclass(frozen=True)
class _Row:
    """What was found in one tile."""

    tile: str
    output: str
    points: int
    sea: int
    other: int
    seconds: float


class TileParts:
    """The coordinates of a tile's parts, each time that they are asked for."""

    def __init__(self, tile: LasTile | CloudTile) -> None:
        self._tile = tile

    def __iter__(self) -> Any:
        """Yield coordinates, shape (3, n)."""
        return (self._tile.xyz(part) for part in self._tile.parts())


def separate_tile(tile: LasTile | CloudTile, params: SeparationParams) -> Separation:
    """Return the separation of a tile; `InputError`, with its name, if that cannot be done."""
    try:
        return separate(TileParts(tile), params)
    except InputError as error:
        raise InputError(f"{tile.path}: {error}") from error


def run(patterns: Sequence[str], output: Path, options: Mapping[str, Any]) -> None:
    """Separate tiles and print what was found."""
    settings = load_settings(options["config_file"], options["overrides"])
    tiles = find_tiles(patterns)
    config = [options["config_file"]] if options["config_file"] else []
    targets = plan_tiles(tiles, output, inputs=config, force=options["force"])
    rows = [
        _separate(path, target, settings.separation, with_height=options["with_height"])
        for path, target in zip(tiles, targets, strict=True)
    ]
    if options["as_json"]:
        click.echo(json.dumps([vars(row) for row in rows], indent=2))
        return
    shown = [(r.tile, f"{r.points:,}", f"{r.other:,}", share(r.other, r.points), f"{r.seconds:.2f}") for r in rows]
    click.echo(table(("tile", "points", "not sea", "share", "seconds"), shown))


def _separate(path: Path, target: Path, params: SeparationParams, *, with_height: bool) -> _Row:
    started = perf_counter()
    tile = open_tile(path)
    found = separate_tile(tile, params)
    columns: dict[str, Any] = {"classification": found.classification}
    if with_height:
        columns["height_above_sea"] = found.height_m
    write_tile(tile, target, columns, HEIGHT if with_height else {})
    sea, other = (int(np.count_nonzero(found.classification == code)) for code in (WATER, OTHER))
    return _Row(path.stem, str(target), tile.size, sea, other, perf_counter() - started)
