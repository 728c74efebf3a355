"""Separation of airborne tiles into sea and non-sea points."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from seaclutter_cli.airborne.objects import ObjectFindingParams
from seaclutter_cli.airborne.separation import NEVER, WATER, SeaState, Separation, separate
from seaclutter_cli.airborne.settings import TileSettings, parse_settings
from seaclutter_cli.airborne.surface import SeparationParams
from seaclutter_cli.errors import CloudError, SelectionError, UsageError
from seaclutter_cli.runs.batch import run_batch
from seaclutter_cli.runs.classify.maps import DrawnTile, check_maps, drawn, map_files, pixel_of
from seaclutter_cli.runs.classify.margins import margins_of, points_of, tiles_of
from seaclutter_cli.runs.classify.separated import (
    LAND,
    RUN,
    SEA_STATE,
    SeparatedTile,
    SeparateOutcome,
    SeparateResult,
    land_text,
    record_text,
    recorded_run,
    recorded_separation,
)
from seaclutter_cli.runs.classify.tiles import (
    TileWork,
    errors_of,
    jobs_for,
    plan_tiles,
    warn_of_doubts,
    warn_without_classes,
    write_tile,
)
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.options import BatchOptions, Logs
from seaclutter_cli.runs.options.tiles import MapOptions, SeparateTilesOptions
from seaclutter_cli.runs.outputs import write_files, write_manifest
from seaclutter_cli.runs.recordings import storing_errors
from seaclutter_cli.runs.resume import RunIdentity, digest_of, digest_of_paths, earlier_outcomes, same_output_accepted
from seaclutter_cli.sinks.atomic import OutputGroup
from seaclutter_cli.sources.extents import Margin, open_tile_or_window
from seaclutter_cli.sources.tiles import CloudTile, LasTile, find_tiles
from seaclutter_cli.urls import PathLike
from seaclutter_cli.validation import plain

_HEIGHT = {"height_above_sea": ("f4", "metres above the sea surface")}


def separate_tiles(
    tiles: Logs, output: PathLike, options: SeparateTilesOptions | None = None, observer: Observer = SILENT
) -> SeparateResult:
    """Separate tiles into sea and non-sea points, and write them with ASPRS classes.

    Parameters
    ----------
    tiles : path, or sequence of paths
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
        If the run cannot start, or its only tile cannot be separated; an error of one of several tiles is stored in its
        outcome.

    Notes
    -----
    Several tiles are a survey: each is separated together with the points of its neighbours in a margin around it.

    Examples
    --------
    >>> import seaclutter
    >>> done = seaclutter.separate_tiles("samples/tile.laz", folder / "separated.laz")
    >>> [(tile.tile, tile.points) for tile in done.tiles]
    [('tile', 161374)]
    """
    options = options or SeparateTilesOptions()
    settings = _settings(options)
    batch = options.batch
    replaced = options.force or batch.resume
    inputs, others = {"-c": options.settings.file}, {"--manifest": batch.manifest}
    maps = options.maps
    others |= {"--plot": maps.plot_file, "--geojson": maps.geojson_file, "--gpkg": maps.gpkg_file}
    check_maps(maps)
    heads = tiles_of(find_tiles(tiles), options.window_m, observer)
    targets = plan_tiles(heads, output, others, inputs, force=replaced, observer=observer)
    margins = margins_of(heads, options.margin_m, observer)
    works = [
        _SeparateWork(
            tile=head,
            target=target,
            replaced=replaced,
            params=settings.separation,
            objects=settings.objects if maps.with_geodata else None,
            with_height=options.with_height,
            margin=margin,
            is_recorded=len(heads) > 1 or batch.resume,
            pixel_m=pixel_of(heads) if maps.wanted else None,
        )
        for head, target, margin in zip(heads, targets, margins, strict=True)
    ]
    # The tiles are the main output: a single one appears after its maps.
    with OutputGroup(replace=replaced) as files, OutputGroup(files) as written:
        outcomes = _run(works, batch, observer, written, force=options.force)
        write_files(_map_files(maps, outcomes, observer), files)
    write_manifest(batch.manifest, [work.recording for work in works], outcomes, replace=replaced)
    return SeparateResult(outcomes)


def _settings(options: SeparateTilesOptions) -> TileSettings:
    """Return the settings, with those that are options of their own; check all of them."""
    raw = options.settings.load().as_dict()
    given = {"land": options.land, "trust_classes": options.trust_classes}
    raw["separation"] |= {key: plain(value) for key, value in given.items() if value is not None}
    return parse_settings(raw, "options")


def _run(
    works: "Sequence[_SeparateWork]", batch: BatchOptions, observer: Observer, files: OutputGroup, *, force: bool
) -> list[SeparateOutcome]:
    """Separate tiles whose outputs are not complete; each of several appears at once, a single one with ``files``."""
    if not batch.resume and batch.runs_here(len(works)):
        return [works[0].alone(observer, files)]
    if batch.resume:
        _check_resumable(works, force=force)
    earlier = earlier_outcomes(works, observer, "separated") if batch.resume else [None] * len(works)
    todo = [work for work, outcome in zip(works, earlier, strict=True) if outcome is None]
    done = iter(run_batch(todo, jobs_for(batch, len(todo)), observer) if todo else [])
    return [outcome or next(done) for outcome in earlier]


def _map_files(options: MapOptions, outcomes: Sequence[SeparateOutcome], observer: Observer) -> dict[Path, bytes]:
    found = [(one.map, one.result.sea_state) for one in outcomes if one.map and one.result]
    return map_files(options, [one for one, _ in found], [sea for _, sea in found], observer)


def _check_resumable(works: "Sequence[_SeparateWork]", *, force: bool) -> None:
    for work in works:
        if work.target.suffix.lower() not in (".las", ".laz"):
            raise UsageError(f"{work.target}: --resume needs LAS or LAZ outputs, which say which run wrote them")
        if not force:
            recorded_run(work.target)


@dataclass(frozen=True, kw_only=True)
class _SeparateWork(TileWork[SeparateOutcome]):
    """Separation of one tile.

    With ``margin``, points of other tiles count. If it ``is_recorded``, a later run recognises the output. ``pixel_m``
    is the width of the pixels of a map, 0 as the tile requires, None without a map; ``objects`` are searched for the
    geodata.
    """

    replaced: bool
    params: SeparationParams
    objects: ObjectFindingParams | None
    with_height: bool
    margin: Margin | None = None
    is_recorded: bool = False
    pixel_m: float | None = None

    @property
    def reads(self) -> Sequence[Path]:
        """The tile and its neighbours."""
        return self.path, *(self.margin.neighbors if self.margin else ())

    @property
    def writes(self) -> Sequence[Path]:
        """The separated tile."""
        return (self.target,)

    def without_result(self, reason: str | None) -> SeparateOutcome:
        """Return an outcome without a result."""
        return SeparateOutcome(recording=self.recording.name, output=self.target, error=reason)

    def run(self, observer: Observer) -> SeparateOutcome:
        """Separate the tile; store an error in the outcome."""
        outcome = self.without_result(None)
        with storing_errors(outcome, observer), same_output_accepted(self), OutputGroup(replace=self.replaced) as files:
            self._into(outcome, observer, files)
        return outcome

    def alone(self, observer: Observer, files: OutputGroup) -> SeparateOutcome:
        """Separate the only tile of a run, whose output appears with other files; raise its error."""
        outcome = self.without_result(None)
        self._into(outcome, observer, files)
        return outcome

    def _into(self, outcome: SeparateOutcome, observer: Observer, files: OutputGroup) -> None:
        outcome.result, outcome.map = self._separate(observer, files)
        outcome.points = outcome.result.points

    def identity(self) -> RunIdentity:
        """Return what the separated tile depends on."""
        places = (self.margin.region if self.margin else None, self.tile.window)
        options = (self.with_height, *map(str, places))
        files = [place for place in self.reads if isinstance(place, Path)]
        return RunIdentity(digest_of_paths(files), digest_of(asdict(self.params)), digest_of(options), digest_of([]))

    def earlier(self) -> tuple[SeparateOutcome | None, str]:
        """Return the outcome of an earlier run whose output is complete; otherwise None, and what differs."""
        try:
            record = recorded_run(self.target)
        except UsageError:  # may be replaced, or is refused before
            return None, ""
        if record is None:
            return None, ""
        difference = self.identity().difference(record)
        outcome = self.without_result(None)
        try:
            found = dict(record["result"])
            state = SeaState(**found.pop("sea_state"))
            outcome.result = SeparatedTile(self.tile.name, str(self.target), **found, sea_state=state, seconds=0.0)
        except (KeyError, TypeError, ValueError) as error:
            difference = difference or f"incomplete record: {error!r}"
        else:
            outcome.points, outcome.skipped = outcome.result.points, True
            difference = difference or self._redraw(outcome, state)
        return (None, f"the earlier output is of {difference}") if difference else (outcome, "")

    def _redraw(self, outcome: SeparateOutcome, sea: SeaState) -> str | None:
        """Draw the map of a complete output if there is to be one; return what its record lacks for it."""
        if self.pixel_m is not None:
            try:
                outcome.map = self._drawn(*recorded_separation(self.target, sea), self.pixel_m)
            except (CloudError, OSError, ValueError) as error:
                return f"a run that recorded no land for the maps ({error})"
        return None

    def _separate(self, observer: Observer, files: OutputGroup | None) -> tuple[SeparatedTile, DrawnTile | None]:
        """Write the separated tile; return its figures, and its map if there is to be one."""
        started = perf_counter()
        tile = open_tile_or_window(self.path, self.tile.window)
        if self.tile.window and not tile.size:
            raise SelectionError(f"{self.path}: no points in this window")
        warn_without_classes(tile, self.params, observer)
        with errors_of(self.path):
            points = points_of(tile, self.margin, observer)
            found = separate(points, self.params, points.column).first(tile.size)
        warn_of_doubts(tile, found, observer)
        columns: dict[str, Any] = {"classification": found.classification}
        if self.with_height:
            columns["height_above_sea"] = found.height_m
        sea, never = (int(np.count_nonzero(found.classification == code)) for code in (WATER, NEVER))
        counts = {"points": tile.size, "sea": sea, "other": tile.size - sea - never}
        texts = {SEA_STATE: json.dumps(asdict(found.sea))} if self.params.follows_waves else {}
        if self.is_recorded:
            texts[RUN] = record_text(self.identity(), {**counts, "sea_state": asdict(found.sea)})
            texts[LAND] = land_text(found.land)
        write_tile(tile, self.target, columns, _HEIGHT if self.with_height else {}, files, texts)
        own_map = None if self.pixel_m is None else self._drawn(tile, found, self.pixel_m)
        seconds = perf_counter() - started
        result = SeparatedTile(self.tile.name, str(self.target), **counts, sea_state=found.sea, seconds=seconds)
        return result, own_map

    def _drawn(self, tile: LasTile | CloudTile, found: Separation, pixel_m: float) -> DrawnTile:
        return drawn(tile, found, self.tile.name, pixel_m, self.objects)
