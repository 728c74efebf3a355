"""Separation of airborne tiles into sea and non-sea points."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from seaclutter_cli.airborne.separation import SeaState, Separation, separate
from seaclutter_cli.airborne.settings import TileSettings, parse_settings
from seaclutter_cli.airborne.surface import NEVER, WATER
from seaclutter_cli.buckets import use_case_of
from seaclutter_cli.documents import load_json
from seaclutter_cli.errors import CloudError, InputError, SelectionError, UsageError, about, requiring
from seaclutter_cli.grids.elevation import LandCells
from seaclutter_cli.interfaces import TilePoints
from seaclutter_cli.runs.classify.maps import MappedTile, map_files, mapped, pixel_of
from seaclutter_cli.runs.classify.tiles import TileWork, plan_tiles, run_tiles, warn_of_doubts, warn_of_missing
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options.classifiers import SeparateTilesOptions
from seaclutter_cli.runs.outputs import write_files, write_manifest
from seaclutter_cli.runs.recordings import Outcome, RecordingsResult, statuses
from seaclutter_cli.runs.resume import RecordedWork, digest_of, digest_of_paths, earlier_outcomes, run_identity
from seaclutter_cli.sinks.atomic import OutputGroup
from seaclutter_cli.sinks.las import TextRecord, text_in
from seaclutter_cli.sources.extents import (
    Margin,
    PointsWithMargin,
    TileHead,
    TilePart,
    neighbors_of,
    open_tile_or_window,
    region_of,
)
from seaclutter_cli.sources.tiles import LAS, CloudTile, LasTile
from seaclutter_cli.text import UNKNOWN, count, share, table
from seaclutter_cli.validation import plain

_HEIGHT = {"height_above_sea": ("f4", "metres above the sea surface")}

_SEA_STATE = TextRecord(1, "sea state of the separation")
"""Record of LAS and LAZ files with a `SeaState` as JSON."""
_RUN = TextRecord(2, "run that wrote this tile")
"""Record of each of several tiles with the identity and the result of the run as JSON."""
_LAND = TextRecord(3, "land of the separation")
"""Record with the `LandCells` of the tile as JSON, by which a later run draws its map."""

_MAX_RECORD_BYTES = 2**16 - 1


@use_case_of(SeparateTilesOptions)
def separate_tiles(options: SeparateTilesOptions) -> "SeparateResult":
    """Separate tiles into sea and non-sea points, and write them with ASPRS classes.

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
    observer, raw = options.observer, options.loaded().as_dict()
    given = {"land": options.land, "trust_classes": options.trust_classes}
    raw["separation"] |= {key: plain(value) for key, value in given.items() if value is not None}
    settings = parse_settings(raw, "options")
    is_mapped = bool(options.plot_file or options.geojson_file)
    if is_mapped:
        with requiring("the shoreline", "geo"):
            import contourpy  # noqa: F401 - availability check
    heads, targets = plan_tiles(options, window_m=options.window_m)
    margins = _margins_of(heads, options.margin_m, observer)
    several, pixel_m = len(heads) > 1, pixel_of(heads) if is_mapped else None
    tiled = zip(heads, targets, [options] * len(heads), margins, strict=True)
    works = [_SeparateWork(*each, settings, several=several, pixel_m=pixel_m) for each in tiled]
    if unfit := [work.target for work in works if options.resume and work.target.suffix.lower() not in LAS]:
        raise UsageError(f"{unfit[0]}: --resume needs LAS or LAZ outputs, which say which run wrote them")
    # The tiles are the main output: a single one appears after its maps.
    with OutputGroup(replace=options.replaces) as files, OutputGroup(files) as tiles:
        earlier = earlier_outcomes(works, observer) if options.resume else None
        outcomes = run_tiles(works, tiles, earlier)
        write_files(map_files(options, [one.map for one in outcomes if one.map], observer), files)
    write_manifest(options.manifest, [work.recording for work in works], outcomes, replace=options.replaces)
    return SeparateResult(outcomes)


def _margins_of(heads: Sequence[TileHead], margin_m: float, observer: Observer) -> list[Margin | None]:
    """Return the margin of each tile, wider around small ones; None for those without neighbours, or a width of 0."""
    if len(heads) < 2 or margin_m <= 0:
        return [None] * len(heads)
    if len(systems := {head.crs.by_code for head in heads if head.extent}) > 1:
        observer.warn(f"tiles have {len(systems)} coordinate reference systems; margins come from tiles with the same")
    found = neighbors_of(heads, margin_m)
    pairs = sum(map(len, found)) // 2
    observer.note(f"{count(len(heads), 'tile')}, {count(pairs, 'pair')} of neighbours", detail=True)
    margins: list[Margin | None] = []
    for head, neighbors in zip(heads, found, strict=True):
        region, paths = region_of(head, margin_m), tuple(dict.fromkeys(one.path for one in neighbors))
        margins.append(Margin(region, paths, head.window) if region and paths else None)
    return margins


def _points_of(tile: LasTile | CloudTile, margin: Margin | None, observer: Observer) -> TilePoints:
    """Return the points of a tile, followed by those in its margin; warn of neighbours that cannot be read."""
    if margin is None:
        return tile
    found = []
    for path in margin.neighbors:
        try:
            found.append(TilePart(path, margin.region, margin.window if path == tile.path else None))
        except (CloudError, OSError) as error:
            observer.warn(f"{tile.path.stem}: no margin from {path.name}, which cannot be read ({error})")
    return PointsWithMargin(tile, found)


@dataclass(frozen=True)
class _SeparateWork(TileWork["SeparatedTile"], RecordedWork["SeparatedTile"]):
    """Separation of one tile.

    With ``margin``, points of other tiles count; ``several`` are separated. ``pixel_m`` is the width of the pixels of a
    map, 0 as the tile requires, None without a map.
    """

    verb = "separated"

    options: SeparateTilesOptions
    margin: Margin | None
    settings: TileSettings
    several: bool
    pixel_m: float | None

    @property
    def reads(self) -> Sequence[Path]:
        return self.tile.path, *(self.margin.neighbors if self.margin else ())

    def without_result(self, reason: str | None) -> "SeparatedTile":
        return SeparatedTile(recording=self.recording.name, output=self.target, error=reason)

    def write(self, outcome: "SeparatedTile", observer: Observer, files: OutputGroup) -> None:
        """Write the separated tile; store its figures in the outcome, and its map if there is to be one."""
        tile = open_tile_or_window(self.tile.path, self.tile.window)
        if self.tile.window and not tile.size:
            raise SelectionError(f"{self.tile.path}: no points in this window")
        warn_of_missing(tile, self.settings, observer, intensity=False)
        with about(self.tile.path, InputError):
            points = _points_of(tile, self.margin, observer)
            found = separate(points, self.settings.separation, points.column).first(tile.size)
        warn_of_doubts(tile, found, observer)
        columns: dict[str, Any] = {"classification": found.classification}
        if self.options.with_height:
            columns["height_above_sea"] = found.height_m
        sea, never = (int(np.count_nonzero(found.classification == code)) for code in (WATER, NEVER))
        figures = {"points": tile.size, "sea": sea, "other": tile.size - sea - never, "sea_state": found.sea}
        texts = {_SEA_STATE: json.dumps(asdict(found.sea))} if self.settings.separation.follows_waves else {}
        if self.several or self.options.resume:
            result = {**figures, "sea_state": asdict(found.sea)}
            texts[_RUN] = json.dumps({**self.identity(), "result": result}, sort_keys=True)
            land = found.land.as_text()
            texts[_LAND] = land if len(land) <= _MAX_RECORD_BYTES else ""
        self.save(tile, columns, _HEIGHT if self.options.with_height else {}, files, texts)
        outcome.map = self._mapped(tile, found)
        vars(outcome).update(figures)

    def _mapped(self, tile: LasTile | CloudTile, found: Separation) -> MappedTile | None:
        objects = self.settings.objects if self.options.geojson_file else None
        return None if self.pixel_m is None else mapped(tile, found, self.tile.name, self.pixel_m, objects)

    def identity(self) -> Mapping[str, str]:
        places = (self.margin.region if self.margin else None, self.tile.window)
        options = (self.options.with_height, *map(str, places))
        params = asdict(self.settings.separation)
        parts = {"config": digest_of(params), "options": digest_of(options), "labels": digest_of([])}
        return run_identity(input=digest_of_paths(self.reads), **parts)

    def records(self) -> Sequence[Mapping[str, Any]]:
        text = text_in(LasTile(self.target).header, _RUN)
        return [] if text is None else [load_json(text)]

    def restore(self, outcome: "SeparatedTile", record: Mapping[str, Any]) -> str | None:
        """Store the figures of a record, and the map of the output if there is to be one."""
        found = record["result"]
        sea = outcome.sea_state = SeaState(**found["sea_state"])
        vars(outcome).update({name: found[name] for name in ("points", "sea", "other")})
        if self.pixel_m is not None:
            try:
                tile = LasTile(self.target)
                land = LandCells.from_text(text_in(tile.header, _LAND) or "")
                classes = tile.columns(["classification"]).get("classification", np.empty(0, np.uint8))
                outcome.map = self._mapped(tile, Separation(classes, np.empty(0, np.float32), 0, sea, land))
            except (CloudError, OSError, ValueError) as error:
                return f"a run that recorded no land for the maps ({error})"
        return None


@dataclass(kw_only=True)
class SeparatedTile(Outcome):
    """Outcome of the separation of one tile: numbers of sea and non-sea points, the sea, and its part of the maps."""

    data = "tile output=written_to points sea other sea_state seconds status error"
    listed = "output=written_to points_in=points points_out=other"

    output: Path
    points: int = 0
    sea: int = 0
    other: int = 0
    sea_state: SeaState | None = None
    map: MappedTile | None = None

    @property
    def tile(self) -> str:
        """Name of the tile."""
        return self.recording

    def figures(self) -> str:
        """Return points and share of the non-sea points, for a line about the outcome."""
        if self.skipped:
            return f"{count(self.points, 'point')}; skipped, the output was complete"
        return f"{count(self.points, 'point')}, {share(self.other, self.points)} non-sea, {self.seconds:.1f} s"

    @property
    def written_to(self) -> str | None:
        """Path of the output; None after an error."""
        return None if self.error else str(self.output)

    def cells(self) -> tuple[str, ...]:
        """Return the row of the table."""
        known = self.sea_state
        height, length = (known.wave_height_m, known.wave_length_m) if known else (None, None)
        waves = (UNKNOWN if height is None else f"{height:.1f} m", UNKNOWN if length is None else f"{length:.0f} m")
        counts = f"{self.points:,}", f"{self.other:,}", share(self.other, self.points)
        return self.tile, *counts, *waves, f"{self.seconds:.2f}"


class SeparateResult(RecordingsResult[SeparatedTile]):
    """Separation of several tiles."""

    is_summary = True

    @property
    def tiles(self) -> list[SeparatedTile]:
        """Tiles without an error."""
        return [outcome for outcome in self.outcomes if not outcome.error and outcome.sea_state]

    def as_text(self) -> str:
        """Return the result as human-readable text: a table, and of several tiles how many were done."""
        head = ("tile", "points", "non-sea", "share", "waves", "length", "seconds")
        rows = [table(head, [tile.cells() for tile in self.tiles])] if self.tiles else []
        return "\n".join([*rows, *([statuses(self.outcomes)] if len(self.outcomes) > 1 else [])])
