"""Classification of the points and objects of tiles with a trained model."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from seaclutter_cli.airborne.forest import class_name
from seaclutter_cli.airborne.model import ClassifiedPoints, ObjectModel, classify_points, load_model
from seaclutter_cli.airborne.objects import FoundObject, doubts_about_objects
from seaclutter_cli.airborne.surface import WATER
from seaclutter_cli.buckets import use_case_of
from seaclutter_cli.errors import InputError, UsageError, about
from seaclutter_cli.plots.figure import render
from seaclutter_cli.plots.tiles import LEFT_OUT, draw_tile
from seaclutter_cli.runs.classify.maps import MappedTile, geojson_of
from seaclutter_cli.runs.classify.tiles import TileWork, plan_tiles, run_tiles, warn_of_doubts, warn_of_missing
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options.classifiers import ClassifyTilesOptions
from seaclutter_cli.runs.outputs import Contents, write_files
from seaclutter_cli.runs.recordings import Outcome, RecordingsResult
from seaclutter_cli.sinks.atomic import OutputGroup
from seaclutter_cli.sinks.csv import csv_lines
from seaclutter_cli.sources.tiles import CloudTile, Crs, LasTile, open_tile
from seaclutter_cli.text import count, printable, table

_COLUMNS = (
    *("tile", "object", "class", "probability", "points", "x", "y", "length", "width", "yaw"),
    *("height", "area_m2"),
)
_DIMENSIONS = {
    "predicted_class": ("u1", "0 none, 1 ship ... 8 garbage"),
    "probability": ("f4", "of the predicted class"),
    "predicted_object": ("u4", "number of the object, 0 none"),
}


@use_case_of(ClassifyTilesOptions)
def classify_tiles(options: ClassifyTilesOptions) -> "PredictResult":
    """Classify the points of tiles, find their objects, and write both.

    Examples
    --------
    >>> import seaclutter
    >>> model = folder / "model.skops"
    >>> _ = seaclutter.train_forest("samples/tile.laz", output=model, settings={"forest.trees": 5})
    >>> (tile,) = seaclutter.classify_tiles("samples/tile.laz", folder / "named.laz", model=model).tiles
    >>> tile.points, len(tile.objects) > 3
    (161374, True)
    """
    observer, plot_file = options.observer, options.plot_file
    if options.model.is_dir():
        raise UsageError(f"{options.model}: is a directory; --model takes a file")
    heads, targets = plan_tiles(options, inputs={"--model": options.model})
    if plot_file and len(heads) > 1:
        raise UsageError(f"--plot: needs a single tile, got {len(heads)}")
    model = _load(options, observer)
    works = [_PredictWork(*each, options, model) for each in zip(heads, targets, strict=True)]
    # The tiles are the main output: a single one appears after the tables.
    with OutputGroup(replace=options.force) as files, OutputGroup(files) as tiles:
        found = run_tiles(works, tiles)
        maps, rows = [tile.map for tile in found if not tile.error], (row for tile in found for row in tile.rows())
        contents: Contents = {
            plot_file: found[0].picture,
            options.csv_file: csv_lines([_COLUMNS, *rows]),
            options.geojson_file: lambda it: it.stream.write(geojson_of(maps, observer)),
        }
        write_files(contents, files, outcomes=found, observer=observer)
    return PredictResult(found, model.settings.objects.min_probability)


@dataclass(kw_only=True)
class ClassifiedTile(Outcome):
    """Outcome of the classification of one tile: its objects and, if it is wanted, its picture.

    Clusters that are too unlikely to be objects are left out.
    """

    data = "tile=recording objects=named_objects clusters_left_out points_left_out"

    points: int = 0
    clusters_left_out: int = 0
    points_left_out: int = 0
    map: MappedTile = field(default_factory=lambda: MappedTile("", Crs()), repr=False)
    picture: bytes = field(default=b"", repr=False)

    @property
    def objects(self) -> Sequence[FoundObject]:
        """Objects, with centres in the coordinates of the tile."""
        return self.map.objects

    def figures(self) -> str:
        """Return the number of points and the duration, for a line about the outcome."""
        return f"{count(self.points, 'point')}, {self.seconds:.1f} s"

    def named_objects(self) -> list[dict[str, Any]]:
        """Return the objects with the names of their classes."""
        return [{"class": one.name, **vars(one)} for one in self.objects]

    def rows(self) -> Iterator[tuple[object, ...]]:
        """Yield the row of each object in a table; lengths in metres, yaw in radians."""
        for one in self.objects:
            numbers = [f"{value:.3f}" for value in (*one.center, *one.size)]
            last = [f"{one.yaw:.4f}", f"{one.height_m:.2f}", f"{one.area_m2:.1f}"]
            yield self.recording, one.number, one.name, f"{one.probability:.3f}", one.points, *numbers, *last

    def described(self, min_probability: float) -> str:
        """Return the objects in lines of at most 80 characters; positions are rounded to the metre."""
        counts = Counter(one.name for one in self.objects)
        found = ", ".join(f"{many:,} {kind}" for kind, many in counts.items()) or "no objects"
        lines = [f"{printable(self.recording)}: {found}"]
        if self.objects:
            digits = len(str(len(self.objects)))
            head = (" " * digits + " class", "prob", "points", "x", "y", "length", "width", "height", "area")
            rows = []
            for one in self.objects:
                first = f"{one.number:>{digits}} {one.name}", f"{one.probability:.2f}", f"{one.points:,}"
                center, lengths = map("{:.0f}".format, one.center), map("{:.1f}".format, (*one.size, one.height_m))
                rows.append((*first, *center, *lengths, f"{one.area_m2:,.0f}"))
            lines.append(table(head, rows))
        if self.clusters_left_out:
            points = count(self.points_left_out, "point")
            why = f"probability below {min_probability:g} (objects.min_probability)"
            lines.append(f"{count(self.clusters_left_out, 'cluster')} left out: {points}, {why}")
        lines.append(f"{count(self.points, 'point')} in {self.seconds:.1f} s")
        return "\n".join(lines)


@dataclass(frozen=True)
class _PredictWork(TileWork["ClassifiedTile"]):
    options: ClassifyTilesOptions
    model: ObjectModel
    kind = ClassifiedTile

    def write(self, outcome: "ClassifiedTile", observer: Observer, files: OutputGroup) -> None:
        tile = open_tile(self.tile.path)
        warn_of_missing(tile, self.model.settings, observer)
        with about(self.tile.path, InputError):
            found = classify_points(tile, self.model)
        warn_of_doubts(tile, found.separation, observer)
        for text in doubts_about_objects(found.objects):
            observer.warn(f"{tile.path.stem}: {text}")
        separation, found_of = found.separation, (found.code, found.probability, found.number)
        columns = {"classification": separation.classification}
        for (name, (kind, _)), values in zip(_DIMENSIONS.items(), found_of, strict=True):
            columns[name] = np.zeros(tile.size, kind)
            columns[name][separation.other] = values
        self.save(tile, columns, _DIMENSIONS, files)
        outcome.points = tile.size
        outcome.clusters_left_out = int(found.left_out.max(initial=0))
        outcome.points_left_out = int(np.count_nonzero(found.left_out))
        objects = [one.placed(tile.crs.unit_m) for one in found.objects]
        outcome.map = MappedTile(self.tile.path.stem, tile.crs, objects=objects)
        if self.options.plot_file:
            outcome.picture = _picture(tile, found, self.options.plot_file.suffix)


def _load(options: ClassifyTilesOptions, observer: Observer) -> ObjectModel:
    """Return the model with the settings of the options; raise `UsageError` if they change its features."""
    model = load_model(options.model)
    for text in model.warnings:
        observer.warn(f"{options.model}: {text}")
    settings = options.loaded(model.settings)
    if settings.features != model.settings.features:
        kept = ", ".join(f"{key}: {value}" for key, value in model.settings.as_dict()["features"].items())
        raise UsageError(f"{options.model}: the model was trained with other features ({kept}); train one with yours")
    return ObjectModel(settings, model.forest)


def _picture(tile: LasTile | CloudTile, found: ClassifiedPoints, suffix: str) -> bytes:
    positions = np.concatenate([xyz[:2] for xyz in tile], axis=1)
    sea, xy = positions[:, found.separation.classification == WATER], found.xy
    code = np.array([0, *(one.code for one in found.objects)])[found.number]
    points = {class_name(one): xy[:, code == one] for one in sorted(set(code.tolist()) - {0})}
    if found.left_out.any():
        points[LEFT_OUT] = xy[:, found.left_out > 0]
    boxes = [(one.name, one.corners()) for one in found.objects]
    return render(lambda figure: draw_tile(figure, sea, points, boxes), suffix, aspect=0.92)


@dataclass(frozen=True)
class PredictResult(RecordingsResult[ClassifiedTile]):
    """Objects found in several tiles; clusters with a lower probability were left out."""

    is_summary = True

    min_probability: float

    @property
    def tiles(self) -> list[ClassifiedTile]:
        """Tiles without an error."""
        return [outcome for outcome in self.outcomes if not outcome.error]

    def as_dict(self) -> list[dict[str, Any]]:
        """Return the objects as JSON-compatible data."""
        return [tile.as_dict() for tile in self.tiles]

    def as_text(self) -> str:
        """Return the objects as human-readable text."""
        return "\n".join(tile.described(self.min_probability) for tile in self.tiles)
