"""What ``seaclutter classify predict`` does."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.forest import class_name, predict
from seaclutter_cli.airborne.model import Model, load_model
from seaclutter_cli.airborne.objects import Found, as_csv, as_geojson, find_objects
from seaclutter_cli.airborne.separation import WATER
from seaclutter_cli.airborne.settings import load_settings
from seaclutter_cli.commands.console import counted, table
from seaclutter_cli.commands.standing import Stood, stand_out
from seaclutter_cli.commands.tiles import plan_tiles, write_tile
from seaclutter_cli.errors import UsageError
from seaclutter_cli.plots.figure import check_target, render
from seaclutter_cli.plots.tiles import LEFT_OUT, draw_tile
from seaclutter_cli.sinks.atomic import AtomicFile
from seaclutter_cli.sources.tiles import CloudTile, LasTile, find_tiles, open_tile

_INPUTS = ("model", "config_file")
_TABLES = ("csv_file", "geojson_file", "plot_file")
DIMENSIONS = {
    "predicted_class": ("u1", "0 none, 1 ship ... 8 garbage"),
    "probability": ("f4", "of the predicted class"),
    "predicted_object": ("u4", "number of the object, 0 none"),
}


@dataclass(frozen=True)
class Named:
    """A tile whose points have names.

    Parameters
    ----------
    stood : Stood
        What stands out of the sea, N points.
    code : ndarray, shape (N,), int64
        Class of each.
    probability : ndarray, shape (N,), float64
        Of that class.
    number : ndarray, shape (N,), int64
        Object of each; 0 for none.
    left_out : ndarray, shape (N,), int64
        Cluster of each that is too unlikely to be an object; 0 for none.
    objects : list of Found
        The objects.
    """

    stood: Stood
    code: NDArray[np.int64]
    probability: NDArray[np.float64]
    number: NDArray[np.int64]
    left_out: NDArray[np.int64]
    objects: list[Found]

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return what the tile is written with, a value for each of its points."""
        classes = self.stood.separation.classification
        out: dict[str, NDArray[Any]] = {name: np.zeros(len(classes), kind) for name, (kind, _) in DIMENSIONS.items()}
        values = (self.code, self.probability, self.number)
        for column, found in zip(out.values(), values, strict=True):
            column[self.stood.separation.other] = found
        return {"classification": classes, **out}

    def as_dict(self) -> dict[str, Any]:
        """Return the objects as data, and how much was left out."""
        return {
            "objects": [{"class": one.name, **vars(one)} for one in self.objects],
            "clusters_left_out": int(self.left_out.max(initial=0)),
            "points_left_out": int(np.count_nonzero(self.left_out)),
        }


def name_points(tile: LasTile | CloudTile, model: Model, *, quiet: bool) -> Named:
    """Separate a tile, name its points and find its objects."""
    stood = stand_out(tile, model.settings, quiet=quiet)
    probability = predict(model.forest, stood.features)
    classes = [int(code) for code in model.forest.classes_]
    objects, number, left_out = find_objects(stood.points, probability, classes, model.settings.objects)
    code = np.array(classes)[probability.argmax(axis=1)] if len(probability) else np.empty(0, np.int64)
    return Named(stood, code, probability.max(axis=1, initial=0.0), number, left_out, objects)


def run(patterns: Sequence[str], output: Path, options: Mapping[str, Any]) -> None:
    """Name the points of tiles and write them, and their objects."""
    tiles = find_tiles(patterns)
    tables, inputs = ([options[name] for name in names if options[name]] for names in (_TABLES, _INPUTS))
    targets = plan_tiles(tiles, output, tables, inputs, force=options["force"])
    _check_picture(options["plot_file"], len(tiles))
    model = _load(options)
    found: list[tuple[str, list[Found]]] = []
    listed: list[dict[str, Any]] = []
    for path, target in zip(tiles, targets, strict=True):
        started, tile = perf_counter(), open_tile(path)
        named = name_points(tile, model, quiet=options["quiet"])
        write_tile(tile, target, named.columns(), DIMENSIONS)
        found.append((path.stem, named.objects))
        listed.append({"tile": path.stem, **named.as_dict()})
        if options["plot_file"]:
            _write(options["plot_file"], _picture(tile, named, options["plot_file"].suffix))
        if not options["as_json"]:
            click.echo(_shown(path.stem, named, model.settings.objects.min_probability))
            click.echo(f"{counted(tile.size, 'point')} in {perf_counter() - started:.1f} s")
    if options["csv_file"]:
        _write(options["csv_file"], as_csv(found).encode())
    if options["geojson_file"]:
        _write(options["geojson_file"], as_geojson(found).encode())
    if options["as_json"]:
        click.echo(json.dumps(listed, indent=2))


def _load(options: Mapping[str, Any]) -> Model:
    """Return the model, with other settings where they do not change what it was trained on."""
    model: Model = load_model(options["model"])
    settings = load_settings(options["config_file"], options["overrides"], model.settings)
    if settings.features != model.settings.features:
        kept = ", ".join(f"{key}: {value}" for key, value in model.settings.as_dict()["features"].items())
        raise UsageError(f"{options['model']}: the model is for another feature set ({kept}); train one for yours")
    return Model(settings, model.forest)


def _check_picture(plot_file: Path | None, tiles: int) -> None:
    if plot_file:
        check_target(plot_file)
        if tiles > 1:
            raise UsageError("--plot: one tile at a time")


def _picture(tile: LasTile | CloudTile, named: Named, suffix: str) -> bytes:
    places = np.concatenate([tile.xyz(part)[:2] for part in tile.parts()], axis=1)
    sea = places[:, named.stood.separation.classification == WATER]
    xy = named.stood.points.xy
    code = np.array([0, *(one.code for one in named.objects)])[named.number]
    points = {class_name(one): xy[:, code == one] for one in sorted(set(code.tolist()) - {0})}
    if named.left_out.any():
        points[LEFT_OUT] = xy[:, named.left_out > 0]
    boxes = [(one.name, one.corners) for one in named.objects]
    return render(lambda figure: draw_tile(figure, sea, points, boxes), suffix, aspect=0.92)


def _shown(name: str, named: Named, least: float) -> str:
    """Return the objects for people, in lines of 80 characters: places to the metre, which the files have in full."""
    counts = Counter(one.name for one in named.objects)
    lines = [f"{name}: " + (", ".join(f"{many:,} {kind}" for kind, many in counts.items()) or "no objects")]
    if named.objects:
        digits = len(str(len(named.objects)))
        head = (" " * digits + " class", "prob", "points", "x", "y", "length", "width", "height", "area")
        lines.append(table(head, [_cells(one, digits) for one in named.objects]))
    if clusters := int(named.left_out.max(initial=0)):
        points = counted(int(np.count_nonzero(named.left_out)), "point")
        why = f"probability below {least:g} (objects.min_probability)"
        lines.append(f"{counted(clusters, 'cluster')} left out: {points}, {why}")
    return "\n".join(lines)


def _cells(one: Found, digits: int) -> tuple[str, ...]:
    lengths = (f"{value:.1f}" for value in (*one.size, one.height_m))
    place = (f"{value:.0f}" for value in one.center)
    named = f"{one.number:>{digits}} {one.name}"
    return (named, f"{one.probability:.2f}", f"{one.points:,}", *place, *lengths, f"{one.area_m2:,.0f}")


def _write(path: Path, data: bytes) -> None:
    with AtomicFile(path) as file:
        file.stream.write(data)
