"""Classification of the points and objects of tiles with a trained model."""

import shutil
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.classification import ClassifiedPoints, classify_points
from seaclutter_cli.airborne.forest import class_name
from seaclutter_cli.airborne.model import ObjectModel, load_model
from seaclutter_cli.airborne.objects import FoundObject, as_csv
from seaclutter_cli.airborne.plausibility import doubts_about_objects
from seaclutter_cli.airborne.separation import WATER
from seaclutter_cli.errors import OutputError, UsageError
from seaclutter_cli.parts import part_path, release
from seaclutter_cli.plots.figure import check_target, render
from seaclutter_cli.plots.tiles import LEFT_OUT, draw_tile
from seaclutter_cli.runs.batch import run_batch
from seaclutter_cli.runs.classify.maps import TileGeodata, check_geodata, geojson_of, geopackage_of, shoreline_in
from seaclutter_cli.runs.classify.margins import tiles_of
from seaclutter_cli.runs.classify.tiles import (
    TileOutcome,
    TileWork,
    errors_of,
    jobs_for,
    plan_tiles,
    warn_of_doubts,
    warn_without_classes,
    warn_without_intensity,
    write_tile,
)
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.options import BatchOptions, Logs
from seaclutter_cli.runs.options.tiles import ClassifyTilesOptions
from seaclutter_cli.runs.outputs import write_files
from seaclutter_cli.runs.recordings import Result, storing_errors
from seaclutter_cli.sinks.atomic import CompleteFile, OutputGroup
from seaclutter_cli.sources.crs import Crs
from seaclutter_cli.sources.tiles import CloudTile, LasTile, TilePointReader, find_tiles, open_tile
from seaclutter_cli.text import count, printable, table
from seaclutter_cli.urls import PathLike

_DIMENSIONS = {
    "predicted_class": ("u1", "0 none, 1 ship ... 8 garbage"),
    "probability": ("f4", "of the predicted class"),
    "predicted_object": ("u4", "number of the object, 0 none"),
}


def classify_tiles(
    tiles: Logs, output: PathLike, options: ClassifyTilesOptions, observer: Observer = SILENT
) -> "PredictResult":
    """Classify the points of tiles, find their objects, and write both.

    Parameters
    ----------
    tiles : path, or sequence of paths
        Files, folders or globs.
    output : path
        File for one tile, folder for several or if it is a `str` that ends in a slash.
    options : ClassifyTilesOptions
        Model, settings and additional outputs.
    observer : Observer, optional
        Receives warnings.

    Raises
    ------
    SeaclutterError
        If the model or a tile cannot be used.

    Examples
    --------
    >>> import seaclutter
    >>> few = seaclutter.TileSettingsOptions(overrides=("forest.trees=5",))
    >>> training = seaclutter.TrainForestOptions(output=folder / "model.skops", settings=few)
    >>> _ = seaclutter.train_forest(["samples/tile.laz"], training)
    >>> options = seaclutter.ClassifyTilesOptions(model=folder / "model.skops")
    >>> (tile,) = seaclutter.classify_tiles(["samples/tile.laz"], folder / "named.laz", options).tiles
    >>> tile.points, len(tile.objects) > 3
    (161374, True)
    """
    paths = find_tiles(tiles)
    if options.model.is_dir():
        raise UsageError(f"{options.model}: is a directory; --model takes a file")
    others = {"--csv": options.csv_file, "--geojson": options.geojson_file, "--plot": options.plot_file}
    others["--gpkg"] = options.gpkg_file
    inputs = {"--model": options.model, "-c": options.settings.file}
    heads = tiles_of(paths, None, observer)
    targets = plan_tiles(heads, output, others, inputs, force=options.force, observer=observer)
    check_geodata(shoreline=options.gpkg_file is not None, package=options.gpkg_file is not None)
    if options.plot_file:
        check_target(options.plot_file)
        if len(paths) > 1:
            raise UsageError(f"--plot: needs a single tile, got {len(paths)}")
    model = _load(options, observer)
    works = [
        _PredictWork(
            tile=head,
            target=target,
            model=model,
            plot_file=options.plot_file,
            with_shoreline=options.gpkg_file is not None,
        )
        for head, target in zip(heads, targets, strict=True)
    ]
    # The tiles are the main output: they appear after the tables.
    with _classified(works, options.batch, observer, replaced=options.force) as (found, files):
        if options.plot_file:
            write_files({options.plot_file: found[0].picture}, files)
        write_files(_tables(found, options, observer), files)
    return PredictResult(found, model.settings.objects.min_probability)


@dataclass(frozen=True, kw_only=True)
class _PredictWork(TileWork[TileOutcome["TileObjects"]]):
    """Classification of one tile, whose output may be staged until those of all tiles are complete."""

    model: ObjectModel
    plot_file: Path | None
    with_shoreline: bool
    staged: Path | None = None

    def run(self, observer: Observer) -> TileOutcome["TileObjects"]:
        """Classify the tile; store an error in the outcome."""
        outcome = self.without_result(None)
        with storing_errors(outcome, observer):
            try:
                with OutputGroup(replace=True) as files:
                    outcome.result = self.process(observer, files)
                    outcome.points = outcome.result.points
            except OutputError as error:
                raise OutputError(str(error).replace(str(self.staged), str(self.target))) from error
        return outcome

    def without_result(self, reason: str | None) -> TileOutcome["TileObjects"]:
        """Return an outcome without a result."""
        return TileOutcome(recording=self.recording.name, error=reason)

    def process(self, observer: Observer, files: OutputGroup) -> "TileObjects":
        """Write the classified tile; return its objects."""
        started, tile = perf_counter(), open_tile(self.path)
        warn_without_intensity(tile, self.model.settings, observer)
        warn_without_classes(tile, self.model.settings.separation, observer)
        with errors_of(self.path):
            found = classify_points(TilePointReader(tile), self.model)
        warn_of_doubts(tile, found.tile.separation, observer)
        for text in doubts_about_objects(found.objects):
            observer.warn(f"{tile.path.stem}: {text}")
        write_tile(tile, self.staged or self.target, _columns_of(found), _DIMENSIONS, files)
        picture = _picture(tile, found, self.plot_file.suffix) if self.plot_file else b""
        objects = TileObjects.of(self.path.stem, found, perf_counter() - started, tile.crs)
        lines = shoreline_in(tile, found.tile.separation) if self.with_shoreline else []
        return replace(objects, picture=picture, shoreline=lines)


@contextmanager
def _classified(
    works: Sequence[_PredictWork], batch: BatchOptions, observer: Observer, *, replaced: bool
) -> Iterator[tuple[list["TileObjects"], OutputGroup]]:
    """Classify tiles; yield their results, and the files that appear at the end of the context."""
    if len(works) == 1:
        with OutputGroup(replace=replaced) as files, OutputGroup(files) as written:
            yield [works[0].process(observer, written)], files
        return
    with _staging(works[0].target.parent) as folder, OutputGroup(replace=replaced) as files:
        staged = [replace(work, staged=folder / work.target.name) for work in works]
        outcomes = run_batch(staged, jobs_for(batch, len(works)), observer, together=True)
        with OutputGroup(files) as written:
            for work in staged:
                written.add(CompleteFile(folder / work.target.name, work.target))
            yield [outcome.result for outcome in outcomes if outcome.result is not None], files


@contextmanager
def _staging(folder: Path) -> Iterator[Path]:
    """Return a folder for complete files in the folder of the outputs; it is removed at the end."""
    part = part_path(folder / "tiles")
    try:
        try:
            folder.mkdir(exist_ok=True)
            part.mkdir()
        except OSError as error:
            raise OutputError(f"{folder}: cannot be written ({error.strerror})") from error
        yield part
    finally:
        shutil.rmtree(part, ignore_errors=True)
        release(part)


def _tables(tiles: Sequence["TileObjects"], options: ClassifyTilesOptions, observer: Observer) -> dict[Path, bytes]:
    tables: dict[Path, bytes] = {}
    if options.csv_file:
        tables[options.csv_file] = as_csv([(tile.name, tile.objects) for tile in tiles]).encode()
    if options.geojson_file:
        boxes = [TileGeodata(tile.name, tile.crs, (), tile.objects) for tile in tiles]
        tables[options.geojson_file] = geojson_of(boxes, observer)
    if options.gpkg_file:
        places = [TileGeodata(tile.name, tile.crs, tile.shoreline, tile.objects) for tile in tiles]
        tables[options.gpkg_file] = geopackage_of(places, observer, classified=True)
    return tables


def _load(options: ClassifyTilesOptions, observer: Observer) -> ObjectModel:
    """Return the model with the settings of the options; raise `UsageError` if they change its features."""
    model = load_model(options.model)
    for text in model.warnings:
        observer.warn(f"{options.model}: {text}")
    settings = options.settings.load(model.settings)
    if settings.features != model.settings.features:
        kept = ", ".join(f"{key}: {value}" for key, value in model.settings.as_dict()["features"].items())
        raise UsageError(f"{options.model}: the model was trained with other features ({kept}); train one with yours")
    return ObjectModel(settings, model.forest)


def _picture(tile: LasTile | CloudTile, found: ClassifiedPoints, suffix: str) -> bytes:
    positions = np.concatenate([xyz[:2] for xyz in TilePointReader(tile)], axis=1)
    sea = positions[:, found.tile.separation.classification == WATER]
    xy = found.tile.points.xy
    code = np.array([0, *(one.code for one in found.objects)])[found.number]
    points = {class_name(one): xy[:, code == one] for one in sorted(set(code.tolist()) - {0})}
    if found.left_out.any():
        points[LEFT_OUT] = xy[:, found.left_out > 0]
    boxes = [(one.name, one.corners) for one in found.objects]
    return render(lambda figure: draw_tile(figure, sea, points, boxes), suffix, aspect=0.92)


def _columns_of(found: ClassifiedPoints) -> dict[str, NDArray[Any]]:
    """Return the columns to write to a tile, a value for each of its points."""
    separation = found.tile.separation
    classes = separation.classification
    out: dict[str, NDArray[Any]] = {name: np.zeros(len(classes), kind) for name, (kind, _) in _DIMENSIONS.items()}
    for column, values in zip(out.values(), (found.code, found.probability, found.number), strict=True):
        column[separation.other] = values
    return {"classification": classes, **out}


@dataclass(frozen=True)
class TileObjects:
    """Objects found in one tile, with centres in its coordinates; and its shoreline and picture, if they are wanted.

    Clusters that are too unlikely to be objects are left out.
    """

    name: str
    points: int
    objects: list[FoundObject]
    clusters_left_out: int
    points_left_out: int
    seconds: float
    crs: Crs = field(default_factory=Crs)
    shoreline: Sequence[NDArray[np.float64]] = field(default=(), repr=False)
    picture: bytes = field(default=b"", repr=False)

    @classmethod
    def of(cls, name: str, found: ClassifiedPoints, seconds: float, crs: Crs) -> Self:
        """Return the objects of a classified tile."""
        left_out = found.left_out
        clusters, points = int(left_out.max(initial=0)), int(np.count_nonzero(left_out))
        size = len(found.tile.separation.classification)
        objects = [one.placed(crs.unit_m) for one in found.objects]
        return cls(name, size, objects, clusters, points, seconds, crs)

    def as_dict(self) -> dict[str, Any]:
        """Return the objects as JSON-compatible data."""
        return {
            "tile": self.name,
            "objects": [{"class": one.name, **vars(one)} for one in self.objects],
            "clusters_left_out": self.clusters_left_out,
            "points_left_out": self.points_left_out,
        }

    def as_text(self, min_probability: float) -> str:
        """Return the objects in lines of at most 80 characters; positions are rounded to the metre."""
        counts = Counter(one.name for one in self.objects)
        found = ", ".join(f"{many:,} {kind}" for kind, many in counts.items()) or "no objects"
        lines = [f"{printable(self.name)}: {found}"]
        if self.objects:
            digits = len(str(len(self.objects)))
            head = (" " * digits + " class", "prob", "points", "x", "y", "length", "width", "height", "area")
            lines.append(table(head, [_cells(one, digits) for one in self.objects]))
        if self.clusters_left_out:
            points = count(self.points_left_out, "point")
            why = f"probability below {min_probability:g} (objects.min_probability)"
            lines.append(f"{count(self.clusters_left_out, 'cluster')} left out: {points}, {why}")
        lines.append(f"{count(self.points, 'point')} in {self.seconds:.1f} s")
        return "\n".join(lines)


def _cells(one: FoundObject, digits: int) -> tuple[str, ...]:
    lengths = (f"{value:.1f}" for value in (*one.size, one.height_m))
    center = (f"{value:.0f}" for value in one.center)
    label = f"{one.number:>{digits}} {one.name}"
    return (label, f"{one.probability:.2f}", f"{one.points:,}", *center, *lengths, f"{one.area_m2:,.0f}")


@dataclass(frozen=True)
class PredictResult(Result):
    """Objects found in several tiles; clusters with a lower probability were left out."""

    is_summary = True

    tiles: list[TileObjects]
    min_probability: float

    def as_dict(self) -> list[dict[str, Any]]:
        """Return the objects as JSON-compatible data."""
        return [tile.as_dict() for tile in self.tiles]

    def as_text(self) -> str:
        """Return the objects as human-readable text."""
        return "\n".join(tile.as_text(self.min_probability) for tile in self.tiles)
