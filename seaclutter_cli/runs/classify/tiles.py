"""What all commands for tiles share: tiles, warnings, output files, and work on each tile."""

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from types import MappingProxyType
from typing import Any, ClassVar

from numpy.typing import NDArray

from seaclutter_cli.airborne.objects import doubts_about_sea
from seaclutter_cli.airborne.separation import Separation
from seaclutter_cli.airborne.settings import TileSettings
from seaclutter_cli.errors import InputError, UsageError, about
from seaclutter_cli.jobs.processes import default_jobs
from seaclutter_cli.runs.batch import Work, run_all
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options.classifiers import ClassifyTilesOptions, SeparateTilesOptions, WritingTiles
from seaclutter_cli.runs.outputs import Paths, is_folder, outputs_in, prepare_outputs
from seaclutter_cli.runs.recordings import O
from seaclutter_cli.runs.resume import same_output_accepted
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup
from seaclutter_cli.sinks.las import ExtraDims, TextRecord, with_texts, write_las
from seaclutter_cli.sinks.point_files import POINT_WRITERS, with_columns
from seaclutter_cli.sources.extents import TileHead, read_head, windows_of
from seaclutter_cli.sources.frame_files import FRAME_READERS
from seaclutter_cli.sources.recordings import Recording
from seaclutter_cli.sources.tiles import LAS, CloudTile, Crs, LasTile, find_tiles
from seaclutter_cli.threads import in_threads

_MEMORY_PER_TILE = 1500 * 2**20
"""Memory in bytes that a tile may need: some ten million points."""


def _tiles_of(paths: Sequence[Path], window_m: float | None, observer: Observer) -> list[TileHead]:
    """Return the tiles in files: whole ones, or with ``window_m`` the windows of that width in COPC files.

    Raise `UsageError` if there is no COPC file for windows, `InputError` if the index of one is damaged.
    """
    if window_m is None:
        return in_threads(read_head, paths) if len(paths) > 1 else [TileHead(path, Crs(), None) for path in paths]
    heads: list[TileHead] = []
    for path in paths:
        with about(path, InputError):
            heads += windows_of(path, window_m)
    whole = [head.path.name for head in heads if not head.window]
    if len(whole) == len(heads):
        raise UsageError("--window: only COPC files can be read by window, and no TILE is one")
    if whole:
        observer.warn(f"not read by window, because only COPC files can be: {', '.join(whole)}")
    return heads


def warn_of_missing(
    tile: LasTile | CloudTile, settings: TileSettings, observer: Observer, *, intensity: bool = True
) -> None:
    """Warn if a tile lacks the ``intensity`` that features need, or points of the classes that are to be trusted."""
    if intensity and settings.features.features == "full" and tile.intensity_name is None:
        observer.warn(f"{tile.path}: no intensity field; intensities count as 0")
    if not (trusted := settings.separation.trust_classes):
        return
    given = tile.columns(["classification"]).get("classification")
    if missing := [code for code in trusted if given is None or not (given == code).any()]:
        observer.warn(f"{tile.path.stem}: no points of {' and '.join(f'class {code}' for code in missing)} to trust")


def warn_of_doubts(tile: LasTile | CloudTile, found: Separation, observer: Observer) -> None:
    """Warn about signs that a tile is not of the sea, and say if its unit is not the metre."""
    if tile.crs.is_geographic:
        observer.warn(f"{tile.path}: coordinates are degrees (its CRS is geographic); project the tile first")
        return
    if tile.crs.unit_m != 1:
        observer.note(f"{tile.path.stem}: the unit of its CRS is {tile.crs.unit_m:.6g} m; lengths are in metres")
    for text in doubts_about_sea(tile, found):
        observer.warn(f"{tile.path.stem}: {text}")


def plan_tiles(
    options: WritingTiles, *, window_m: float | None = None, inputs: Paths = MappingProxyType({})
) -> tuple[list[TileHead], list[Path]]:
    """Return tiles, and the output of each: ``output`` itself for one, files named after the tiles in it for several.

    ``output`` is a folder if there are several tiles, or if it is a `str` that ends in a slash. Additional input files
    are given by option. Raise `UsageError` if an output is an input, exists and may not be replaced, would
    be written twice, or has a format to which the tile cannot be converted.
    """
    tiles = _tiles_of(find_tiles(options.tiles), window_m, options.observer)
    targets, paths = [Path(options.output)], [tile.path for tile in tiles]
    if is_folder(options.output, len(tiles)):  # formats without a writer become PCD
        names = [Path(tile.file_name) for tile in tiles]
        names = [one if one.suffix.lower() in (*LAS, *POINT_WRITERS) else one.with_suffix(".pcd") for one in names]
        targets = outputs_in(targets[0], names, paths, "tile", "rename one, or leave one out")
    read: Paths = {"TILE": paths, "-c": options.config, **inputs}
    prepare_outputs({"-o": targets, **options.outputs}, read, force=options.replaces, observer=options.observer)
    for tile, target in zip(tiles, targets, strict=True):
        suffix = target.suffix.lower()
        if suffix not in (*LAS, *POINT_WRITERS):
            raise UsageError(f"{target}: unknown format; tiles can be written as {', '.join((*LAS, *POINT_WRITERS))}")
        if suffix in LAS and tile.path.suffix.lower() not in LAS:
            raise UsageError(f"{target}: only LAS and LAZ tiles can become LAS or LAZ; use {', '.join(POINT_WRITERS)}")
    return tiles, targets


@dataclass(frozen=True)
class _Window(Recording):
    tile: TileHead = field(kw_only=True)

    @property
    def name(self) -> str:
        return self.tile.name


@dataclass(frozen=True)
class TileWork(Work[O]):
    """Work on one tile, and its output."""

    noun: ClassVar[str] = "tile"

    tile: TileHead
    target: Path
    options: SeparateTilesOptions | ClassifyTilesOptions

    @property
    def writes(self) -> Sequence[Path]:
        """The output."""
        return (self.target,)

    @property
    def input_bytes(self) -> int:
        """Size of the tile in bytes: that of its file, or of the part that is its window."""
        return self.tile.size or super().input_bytes

    def fill(self, outcome: O, observer: Observer) -> None:
        """Write the output, which appears by itself."""
        with same_output_accepted(self), OutputGroup(replace=self.options.replaces) as files:
            self.write(outcome, observer, files)

    @abstractmethod
    def write(self, outcome: O, observer: Observer, files: OutputGroup) -> None:
        """Write the output, which appears with ``files``; store its figures in the outcome."""

    def save(
        self,
        tile: LasTile | CloudTile,
        columns: Mapping[str, NDArray[Any]],
        extra: ExtraDims,
        files: OutputGroup,
        texts: Mapping[TextRecord, str] = MappingProxyType({}),
    ) -> None:
        """Write a tile with replaced or additional columns, and LAS with text records; everything else is kept."""
        if isinstance(tile, LasTile) and self.target.suffix.lower() in LAS:
            if tile.header.global_encoding.waveform_data_packets_internal:
                text = "internal waveform packets cannot be copied; store them in a separate file"
                raise InputError(f"{tile.path}: {text}")
            header = with_texts(tile.header, texts) if texts else tile.header
            whole = all(len(values) == tile.header.point_count for values in columns.values())
            write_las(self.target, header, _changed(tile, columns), extra, whole=whole, group=files)
            return
        cloud = FRAME_READERS[tile.path.suffix.lower()](tile.path) if isinstance(tile, LasTile) else tile.cloud
        with AtomicFile(self.target, files) as file:
            POINT_WRITERS[self.target.suffix.lower()](file.stream, with_columns(cloud, columns))

    @property
    def recording(self) -> Recording:  # type: ignore[override]
        """The tile."""
        return _Window((self.tile.path,), tile=self.tile) if self.tile.window else Recording((self.tile.path,))


def _changed(tile: LasTile, columns: Mapping[str, NDArray[Any]]) -> Iterator[tuple[Any, dict[str, NDArray[Any]]]]:
    """Yield the points of a tile in parts, with their values of the columns."""
    start = 0
    for part in tile.parts():
        end = start + len(part)
        yield part, {name: values[start:end] for name, values in columns.items()}
        start = end


def run_tiles(works: Sequence[TileWork[O]], files: OutputGroup, earlier: list[O | None] | None = None) -> list[O]:
    """Do the work on tiles, but not where an outcome is ``earlier``; several appear at once, one with ``files``.

    There are as many processes as the memory is enough for, unless a number is given.
    """
    options, observer = works[0].options, works[0].options.observer
    if not earlier and options.runs_here(len(works)):
        outcome, started = works[0].without_result(None), perf_counter()
        works[0].write(outcome, observer, files)
        outcome.seconds = perf_counter() - started
        return [outcome]
    if options.jobs is None and options.cluster is None:
        options = replace(options, jobs=default_jobs(len(works), _MEMORY_PER_TILE))
    return run_all(works, options, observer, earlier=earlier)
