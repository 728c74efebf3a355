"""Separation of airborne tiles into sea and non-sea points."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from time import perf_counter
from typing import Any, Literal

import numpy as np

from seaclutter_cli.airborne.separation import NEVER, WATER, SeaState, separate
from seaclutter_cli.airborne.surface import SeparationParams
from seaclutter_cli.runs.batch import BatchOptions
from seaclutter_cli.runs.classify.batch import TileWork, process_tiles
from seaclutter_cli.runs.classify.tiles import (
    TileSettingsOptions,
    errors_of,
    plan_tiles,
    warn_of_doubts,
    warn_without_classes,
    write_tile,
)
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.recordings import PathLike, Result
from seaclutter_cli.sinks.atomic import OutputGroup
from seaclutter_cli.sinks.las import TextRecord
from seaclutter_cli.sources.tiles import TilePointReader, find_tiles, open_tile
from seaclutter_cli.text import UNKNOWN, share, table

HEIGHT = {"height_above_sea": ("f4", "metres above the sea surface")}
SEA_STATE = TextRecord(1, "sea state of the separation")
"""Record of LAS and LAZ files with a `SeaState` as JSON."""


@dataclass(frozen=True, kw_only=True)
class SeparateTilesOptions:
    """Options of `separate_tiles`.

    Parameters
    ----------
    settings : TileSettingsOptions
        Settings of the separation.
    with_height : bool
        Also write each point's height above the sea surface.
    land : {"keep", "class2", "ignore"} or None
        What low and flat land becomes; None: as in the settings.
    trust_classes : tuple of {2, 9} or None
        Classes of the input that are right: ground (2), water (9); None: as in the settings.
    force : bool
        Replace existing files.
    batch : BatchOptions
        How several tiles are processed.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.SeparateTilesOptions(with_height=True).settings.load().separation.window_m
    20.0
    """

    settings: TileSettingsOptions = field(default_factory=TileSettingsOptions)
    with_height: bool = False
    land: Literal["keep", "class2", "ignore"] | None = None
    trust_classes: tuple[Literal[2, 9], ...] | None = None
    force: bool = False
    batch: BatchOptions = field(default_factory=BatchOptions)


def separate_tiles(
    tiles: Sequence[str], output: PathLike, options: SeparateTilesOptions | None = None, observer: Observer = SILENT
) -> "SeparateResult":
    """Separate tiles into sea and non-sea points, and write them with ASPRS classes.

    Parameters
    ----------
    tiles : sequence of str
        Files, folders or globs.
    output : path
        File for one tile, folder for several or if it is a `str` that ends in a slash.
    options : SeparateTilesOptions, optional
        Settings and outputs.
    observer : Observer, optional
        Receives notes.

    Raises
    ------
    SeaclutterError
        If a tile cannot be separated.

    Examples
    --------
    >>> import seaclutter
    >>> done = seaclutter.separate_tiles(["samples/tile.laz"], folder / "separated.laz")
    >>> [(tile.tile, tile.points) for tile in done.tiles]
    [('tile', 161374)]
    """
    options = options or SeparateTilesOptions()
    settings = options.settings.load()
    params = settings.separation
    params = replace(
        params,
        land=params.land if options.land is None else options.land,
        trust_classes=params.trust_classes if options.trust_classes is None else options.trust_classes,
    )
    paths = find_tiles(tiles)
    targets = plan_tiles(paths, output, {}, {"-c": options.settings.file}, force=options.force, observer=observer)
    works = [
        SeparateWork(path=path, target=target, params=params, with_height=options.with_height)
        for path, target in zip(paths, targets, strict=True)
    ]
    with process_tiles(works, options.batch, observer, replaced=options.force) as (separated, _):
        return SeparateResult(separated)


@dataclass(frozen=True, kw_only=True)
class SeparateWork(TileWork["SeparatedTile"]):
    """Separation of one tile.

    Parameters
    ----------
    params : SeparationParams
        Settings of the separation.
    with_height : bool
        Also write each point's height above the sea surface.
    """

    params: SeparationParams
    with_height: bool

    def process(self, observer: Observer, files: OutputGroup | None) -> "tuple[SeparatedTile, int]":
        """Write the separated tile."""
        started, tile = perf_counter(), open_tile(self.path)
        warn_without_classes(tile, self.params, observer)
        with errors_of(self.path):
            points = TilePointReader(tile)
            found = separate(points, self.params, points.column)
        warn_of_doubts(tile, found, observer)
        columns: dict[str, Any] = {"classification": found.classification}
        if self.with_height:
            columns["height_above_sea"] = found.height_m
        texts = {SEA_STATE: json.dumps(asdict(found.sea))} if self.params.follows_waves else {}
        extra = HEIGHT if self.with_height else {}
        write_tile(tile, self.place, columns, extra, files, texts)
        sea, never = (int(np.count_nonzero(found.classification == code)) for code in (WATER, NEVER))
        other = tile.size - sea - never
        seconds = perf_counter() - started
        return SeparatedTile(self.path.stem, str(self.target), tile.size, sea, other, found.sea, seconds), tile.size


@dataclass(frozen=True)
class SeparatedTile:
    """Separation of one tile.

    Parameters
    ----------
    tile, output : str
        Name of the tile, and path of the written file.
    points, sea, other : int
        Numbers of all points, sea points and non-sea points.
    sea_state : SeaState
        Waves, and the surface and height that separate objects from them.
    seconds : float
        Processing time.
    """

    tile: str
    output: str
    points: int
    sea: int
    other: int
    sea_state: SeaState
    seconds: float


@dataclass(frozen=True)
class SeparateResult(Result):
    """Separation of several tiles.

    Parameters
    ----------
    tiles : sequence of SeparatedTile
        Separation of each tile.
    """

    is_summary = True

    tiles: Sequence[SeparatedTile]

    def as_dict(self) -> list[dict[str, Any]]:
        """Return the result as JSON-compatible data."""
        return [asdict(tile) for tile in self.tiles]

    def as_text(self) -> str:
        """Return the result as human-readable text."""
        head = ("tile", "points", "non-sea", "share", "waves", "length", "seconds")
        return table(head, [_cells(tile) for tile in self.tiles])


def _cells(tile: SeparatedTile) -> tuple[str, ...]:
    counts = f"{tile.points:,}", f"{tile.other:,}", share(tile.other, tile.points)
    height, length = tile.sea_state.wave_height_m, tile.sea_state.wave_length_m
    waves = (UNKNOWN if height is None else f"{height:.1f} m", UNKNOWN if length is None else f"{length:.0f} m")
    return tile.tile, *counts, *waves, f"{tile.seconds:.2f}"
