"""Classification of the points and objects of tiles with a trained model."""

from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.classification import ClassifiedPoints, classify_points
from seaclutter_cli.airborne.forest import class_name
from seaclutter_cli.airborne.model import ObjectModel, load_model
from seaclutter_cli.airborne.objects import as_csv, as_geojson
from seaclutter_cli.airborne.plausibility import doubts_about_objects
from seaclutter_cli.airborne.separation import WATER
from seaclutter_cli.errors import UsageError
from seaclutter_cli.plots.figure import check_target, render
from seaclutter_cli.plots.tiles import LEFT_OUT, draw_tile
from seaclutter_cli.runs.batch import BatchOptions
from seaclutter_cli.runs.classify.batch import TileWork, process_tiles
from seaclutter_cli.runs.classify.geodata import NOT_WGS84, TileGeodata, check_geodata, conversions, geopackage_of
from seaclutter_cli.runs.classify.maps import shoreline_in
from seaclutter_cli.runs.classify.predict_result import DIMENSIONS, PredictResult, TileObjects, columns_of
from seaclutter_cli.runs.classify.survey import tiles_of
from seaclutter_cli.runs.classify.tiles import (
    TileSettingsOptions,
    errors_of,
    plan_tiles,
    warn_of_doubts,
    warn_without_classes,
    warn_without_intensity,
    write_tile,
)
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.outputs import write_files
from seaclutter_cli.runs.recordings import Logs, PathLike
from seaclutter_cli.sinks.atomic import OutputGroup
from seaclutter_cli.sources.tiles import CloudTile, LasTile, TilePointReader, find_tiles, open_tile


@dataclass(frozen=True, kw_only=True)
class ClassifyTilesOptions:
    """Options of `classify_tiles`: the model, its settings and additional outputs.

    Parameters
    ----------
    model : Path
        Trained model.
    settings : TileSettingsOptions
        Settings that override the ones stored in the model, except for the features.
    csv_file : Path or None
        CSV table with a line for each object.
    geojson_file : Path or None
        GeoJSON file with the boxes of the objects.
    gpkg_file : Path or None
        GeoPackage with these boxes and the shoreline, in WGS 84.
    plot_file : Path or None
        Picture of the tile in top view; for a single tile.
    force : bool
        Replace existing files.
    batch : BatchOptions
        How several tiles are processed.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.ClassifyTilesOptions(model=folder / "model.skops", csv_file=folder / "objects.csv").force
    False
    """

    model: Path
    settings: TileSettingsOptions = field(default_factory=TileSettingsOptions)
    csv_file: Path | None = None
    geojson_file: Path | None = None
    gpkg_file: Path | None = None
    plot_file: Path | None = None
    force: bool = False
    batch: BatchOptions = field(default_factory=BatchOptions)


def classify_tiles(
    tiles: Logs, output: PathLike, options: ClassifyTilesOptions, observer: Observer = SILENT
) -> PredictResult:
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
        PredictWork(
            tile=head,
            target=target,
            model=model,
            plot_file=options.plot_file,
            with_shoreline=options.gpkg_file is not None,
        )
        for head, target in zip(heads, targets, strict=True)
    ]
    # The tiles are the main output: they appear after the tables.
    with process_tiles(works, options.batch, observer, replaced=options.force) as (found, files):
        result = PredictResult([tile for tile, *_ in found], model.settings.objects.min_probability)
        if options.plot_file:
            write_files({options.plot_file: found[0][1]}, files)
        tables = _tables(result, options, observer)
        if options.gpkg_file:
            places = [TileGeodata(tile.name, tile.crs, lines, tile.objects) for tile, _, lines in found]
            tables[options.gpkg_file] = geopackage_of(places, observer, classified=True)
        write_files(tables, files)
    return result


@dataclass(frozen=True, kw_only=True)
class PredictWork(TileWork[tuple[TileObjects, bytes, list[NDArray[np.float64]]]]):
    """Classification of one tile; the result has the objects, the picture if there is to be one, and the shoreline.

    Parameters
    ----------
    model : ObjectModel
        Trained model.
    plot_file : Path or None
        File for a picture of the tile.
    with_shoreline : bool
        Whether the shoreline is wanted.
    """

    model: ObjectModel
    plot_file: Path | None
    with_shoreline: bool = False

    def process(
        self, observer: Observer, files: OutputGroup | None
    ) -> tuple[tuple[TileObjects, bytes, list[NDArray[np.float64]]], int]:
        """Write the classified tile."""
        started, tile = perf_counter(), open_tile(self.path)
        warn_without_intensity(tile, self.model.settings, observer)
        warn_without_classes(tile, self.model.settings.separation, observer)
        with errors_of(self.path):
            found = classify_points(TilePointReader(tile), self.model)
        warn_of_doubts(tile, found.tile.separation, observer)
        for text in doubts_about_objects(found.objects):
            observer.warn(f"{tile.path.stem}: {text}")
        write_tile(tile, self.place, columns_of(found), DIMENSIONS, files)
        picture = _picture(tile, found, self.plot_file.suffix) if self.plot_file else b""
        objects = TileObjects.of(self.path.stem, found, perf_counter() - started, tile.crs)
        lines = shoreline_in(tile, found.tile.separation) if self.with_shoreline else []
        return (objects, picture, lines), objects.points


def _tables(result: PredictResult, options: ClassifyTilesOptions, observer: Observer) -> dict[Path, bytes]:
    objects = [(tile.name, tile.objects) for tile in result.tiles]
    tables: dict[Path, bytes] = {}
    if options.csv_file:
        tables[options.csv_file] = as_csv(objects).encode()
    if options.geojson_file:
        ways = conversions([(tile.name, tile.crs) for tile in result.tiles], NOT_WGS84, observer)
        places = [(tile.crs.unit_m, way) for tile, way in zip(result.tiles, ways, strict=True)]
        tables[options.geojson_file] = as_geojson(objects, places).encode()
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
