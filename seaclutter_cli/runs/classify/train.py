"""Training of a random forest on labelled tiles."""

from dataclasses import dataclass
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np

from seaclutter_cli.airborne.forest import Samples, class_name, join, predict, split_samples, train
from seaclutter_cli.airborne.model import ObjectModel, tile_features
from seaclutter_cli.airborne.settings import TileSettings
from seaclutter_cli.buckets import use_case_of
from seaclutter_cli.clustering import euclidean_clusters
from seaclutter_cli.errors import InputError, about
from seaclutter_cli.evaluation.confusion import Confusion
from seaclutter_cli.plots.figure import render
from seaclutter_cli.plots.tiles import draw_confusion
from seaclutter_cli.runs.classify.tiles import warn_of_missing
from seaclutter_cli.runs.options.classifiers import TrainForestOptions
from seaclutter_cli.runs.outputs import prepare_outputs, write_files
from seaclutter_cli.runs.recordings import Result
from seaclutter_cli.sources.tiles import find_tiles, open_tile
from seaclutter_cli.text import UNKNOWN, count, table
from seaclutter_cli.truth import OBJECT_CLASSES

_SCORES = ("class", "precision", "recall", "f1", "points", "object_f1")


@use_case_of(TrainForestOptions)
def train_forest(options: TrainForestOptions) -> "TrainingReport":
    """Train a random forest on labelled tiles, test it on held-out data, and write it.

    Examples
    --------
    >>> import seaclutter
    >>> model = folder / "model.skops"
    >>> report = seaclutter.train_forest("samples/tile.laz", output=model, settings={"forest.trees": 5})
    >>> "ship" in report.names, model.exists()
    (True, True)
    """
    observer, settings, paths = options.observer, options.loaded(), find_tiles(options.tiles)
    inputs = {"TILE": paths, "-c": options.config}
    prepare_outputs(options.outputs, inputs, force=options.force, observer=observer)
    parts = [_samples(number, path, settings, options) for number, path in enumerate(paths)]
    model, report = fit(join(parts), settings)
    files = {options.output: model.to_bytes()}
    if options.plot_file and report.tested:
        content = {"names": report.names, "matrix": report.points.counts}
        files[options.plot_file] = render(draw_confusion, options.plot_file.suffix, aspect=0.85, **content)
    write_files(files, replace=options.force)
    tested = zip(report.names, report.points.counts.sum(axis=1), strict=True)
    if missing := [name for name, points in tested if not points]:
        message = f"no points of {', '.join(missing)} were held out, so the test does not cover them"
        if not report.tested:
            message = "nothing could be held out: no class has two objects"
            if options.plot_file:
                observer.warn(f"{options.plot_file}: not drawn, because there is no test")
        observer.warn(f"{message}; train on more tiles, or on more objects")
    return report


def _samples(number: int, path: Path, settings: TileSettings, options: TrainForestOptions) -> Samples:
    tile = open_tile(path)
    class_field, object_field = options.class_field, options.object_field
    if class_field not in tile.names:
        found = ", ".join(tile.names)
        raise InputError(f"{path}: no field {class_field!r} with ground truth; the tile has {found}")
    warn_of_missing(tile, settings, options.observer)
    with about(path, InputError):
        separation, points, features = tile_features(tile, settings)
    truth = tile.columns((class_field, object_field))
    other = separation.other
    code = truth[class_field][other].astype(np.int64)
    if ((code < 0) | (code > len(OBJECT_CLASSES))).any():
        known = f"classes are 1 to {len(OBJECT_CLASSES)}, 0 for none"
        raise InputError(f"{path}: {class_field} contains {code.max()}; {known}")
    if object_field in truth:
        objects = truth[object_field][other].astype(np.int64)
    else:  # the offset by class separates touching clusters of different classes
        flat = np.vstack((points.xy, 1000.0 * settings.objects.tolerance_m * code))
        objects = euclidean_clusters(flat, settings.objects.tolerance_m, 1)
    return Samples(features, code, np.full(len(code), number), objects)


def fit(samples: Samples, settings: TileSettings) -> "tuple[ObjectModel, TrainingReport]":
    """Return a model trained on a part of the samples, and a report of its test on the rest."""
    test, split = split_samples(samples, settings.forest)
    names = ("features", "code", "tile", "number")
    seen, unseen = (Samples(*(getattr(samples, name)[part] for name in names)) for part in (~test, test))
    forest = train(seen, settings.forest)
    codes = tuple(int(code) for code in np.unique(samples.code))
    predicted = forest.classes_[predict(forest, unseen.features).argmax(axis=1)].astype(np.int64)
    # Of each object, the true class, and the most frequent predicted class of its points.
    objects, which = unseen.objects
    votes = np.zeros((objects.shape[1], len(OBJECT_CLASSES) + 1), np.int64)
    np.add.at(votes, (which, predicted), 1)
    importances = dict(zip(settings.features.names, map(float, forest.feature_importances_.round(4)), strict=True))
    pairs = (unseen.code, predicted), (objects[2], votes.argmax(axis=1))
    of_points, of_objects = (Confusion.of(true, found, codes) for true, found in pairs)
    report = TrainingReport(codes, of_points, of_objects, importances, split, len(seen.code), len(unseen.code))
    return ObjectModel(settings, forest), report


@dataclass(frozen=True)
class TrainingReport(Result):
    """Test report of a forest on held-out points, and on objects with the class predicted for most of their points.

    ``split`` is the unit that was held out, ``tile`` or ``object``; ``trained`` and ``tested`` are numbers of points.
    """

    is_summary = True
    data = (
        "held_out points_trained=trained points_tested=tested accuracy=points.accuracy kappa macro_f1=points.macro_f1 "
        "object_macro_f1=objects.macro_f1 classes confusion=points.counts importances"
    )

    codes: tuple[int, ...]
    points: Confusion
    objects: Confusion
    importances: dict[str, float]
    split: str
    trained: int
    tested: int

    @property
    def names(self) -> list[str]:
        """Names of the classes."""
        return [class_name(code) for code in self.codes]

    @property
    def kappa(self) -> float:
        """Cohen's kappa of points; NaN if all tested points are of one class, where it is meaningless."""
        several = np.count_nonzero(self.points.counts.sum(axis=1)) > 1
        return self.points.kappa if several else float("nan")

    @property
    def held_out(self) -> str | None:
        """What was held out; None if nothing was tested."""
        return self.split if self.tested else None

    def classes(self) -> list[dict[str, Any]]:
        """Return the scores and the number of the points of each class, and the F1 of its objects."""
        points = self.points
        columns = (points.precision, points.recall, points.f1, points.counts.sum(axis=1), self.objects.f1)
        return [dict(zip(_SCORES, row, strict=True)) for row in zip(self.names, *columns, strict=True)]

    def as_text(self) -> str:
        """Return the report as human-readable text; one line if nothing was tested."""
        trained = f"trained on {count(self.trained, 'point')}"
        if not self.tested:
            return f"{trained}; no test, because nothing could be held out"
        points, objects = self.points, self.objects
        every = (one.values() for one in self.classes())
        rows = [(n, _3(p), _3(r), _3(f), f"{c:,}", _3(o)) for n, p, r, f, c, o in every]
        head = ("class", "precision", "recall", "F1", "points", "  object F1")
        rows.append(("mean", "", "", _3(points.macro_f1), f"{points.counts.sum():,}", _3(objects.macro_f1)))
        ranked = sorted(self.importances.items(), key=lambda item: -item[1])
        return "\n".join(
            (
                f"{trained}, tested on {count(self.tested, 'point')} of other {self.split}s",
                table(head, rows),
                f"overall accuracy {_3(points.accuracy)}, kappa {_3(self.kappa)}",
                fill("importance: " + ", ".join(f"{name} {value:.2f}" for name, value in ranked), 80),
            )
        )


def _3(value: float) -> str:
    return f"{value:.3f}" if np.isfinite(value) else UNKNOWN
