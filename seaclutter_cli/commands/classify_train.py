"""What ``seaclutter classify train`` does."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.forest import Samples, class_name, hold_out, join, predict, train
from seaclutter_cli.airborne.model import Model
from seaclutter_cli.airborne.settings import Settings, load_settings
from seaclutter_cli.clustering.euclidean import euclidean_clusters
from seaclutter_cli.commands.console import counted, table, warn
from seaclutter_cli.commands.outputs import refuse_replacing, refuse_twice
from seaclutter_cli.commands.standing import stand_out
from seaclutter_cli.errors import InputError
from seaclutter_cli.evaluation.confusion import Confusion
from seaclutter_cli.plots.figure import check_target, render
from seaclutter_cli.plots.tiles import draw_confusion
from seaclutter_cli.sinks.atomic import AtomicFile
from seaclutter_cli.sources.tiles import find_tiles, open_tile, read_columns
from seaclutter_cli.truth import OBJECT_CLASSES


@dataclass(frozen=True)
class Report:
    """How well a forest names points, and objects, that it has not seen.

    Parameters
    ----------
    codes : tuple of int
        Classes.
    points, objects : Confusion
        By point; and by object, which has the class that most of its points are given.
    importances : dict of str to float
        Of each feature.
    split : str
        What was held out: ``tile`` or ``object``.
    trained, tested : int
        Points of either part.
    """

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
        """Cohen's kappa by point; NaN where points of one class only were tested, of which it says nothing."""
        several = np.count_nonzero(self.points.counts.sum(axis=1)) > 1
        return self.points.kappa if several else float("nan")

    def as_dict(self) -> dict[str, Any]:
        """Return the report as data."""
        points = self.points
        columns = (points.precision, points.recall, points.f1, points.counts.sum(axis=1), self.objects.f1)
        keys = ("precision", "recall", "f1", "points", "object_f1")
        rows = [dict(zip(("class", *keys), (name, *map(_plain, v)), strict=True)) for name, *v in self._rows(columns)]
        summary = {
            "accuracy": _plain(points.accuracy),
            "kappa": _plain(self.kappa),
            "macro_f1": _plain(points.macro_f1),
        }
        return {
            "held_out": self.split if self.tested else None,
            "points_trained": self.trained,
            "points_tested": self.tested,
            **summary,
            "object_macro_f1": _plain(self.objects.macro_f1),
            "classes": rows,
            "confusion": points.counts.tolist(),
            "importances": self.importances,
        }

    def _rows(self, columns: Sequence[NDArray[Any]]) -> list[tuple[Any, ...]]:
        return list(zip(self.names, *columns, strict=True))

    def as_text(self) -> str:
        """Return the report for people; one line if nothing was tested."""
        trained = f"trained on {counted(self.trained, 'point')}"
        if not self.tested:
            return f"{trained}; there is no test, as nothing could be held out"
        points, objects = self.points, self.objects
        columns = (points.precision, points.recall, points.f1, points.counts.sum(axis=1), objects.f1)
        rows = [(n, _3(p), _3(r), _3(f), f"{c:,}", _3(o)) for n, p, r, f, c, o in self._rows(columns)]
        head = ("class", "precision", "recall", "F1", "points", "  F1 of objects")
        rows.append(("mean", "", "", _3(points.macro_f1), f"{points.counts.sum():,}", _3(objects.macro_f1)))
        ranked = sorted(self.importances.items(), key=lambda item: -item[1])
        return "\n".join(
            (
                f"{trained}, tested on {self.tested:,} of other {self.split}s",
                table(head, rows),
                f"overall accuracy {_3(points.accuracy)}, kappa {_3(self.kappa)}",
                fill("importance: " + ", ".join(f"{name} {value:.2f}" for name, value in ranked), 80),
            )
        )


def _3(value: float) -> str:
    return f"{value:.3f}" if np.isfinite(value) else "-"


def _plain(value: Any) -> Any:
    number = value.item() if hasattr(value, "item") else value
    return None if isinstance(number, float) and not np.isfinite(number) else number


def run(patterns: Sequence[str], output: Path, options: Mapping[str, Any]) -> None:
    """Train a forest on labelled tiles, test it on what was held out, and write both."""
    settings = load_settings(options["config_file"], options["overrides"])
    tiles = find_tiles(patterns)
    plot_file: Path | None = options["plot_file"]
    if plot_file:
        check_target(plot_file)
    config = [options["config_file"]] if options["config_file"] else []
    outputs = [output, *([plot_file] if plot_file else [])]
    refuse_twice(outputs)
    refuse_replacing(outputs, [*tiles, *config], force=options["force"])
    parts = [_samples(number, path, settings, options) for number, path in enumerate(tiles)]
    model, report = fit(join(parts), settings)
    files = {output: model.to_bytes()}
    if plot_file and report.tested:
        files[plot_file] = render(
            lambda figure: draw_confusion(figure, report.names, report.points.counts), plot_file.suffix, aspect=0.85
        )
    for path, data in files.items():
        with AtomicFile(path) as file:
            file.stream.write(data)
    _warn_of_untested(report, plot_file, quiet=options["quiet"])
    click.echo(json.dumps(report.as_dict(), indent=2) if options["as_json"] else report.as_text())


def _warn_of_untested(report: Report, plot_file: Path | None, *, quiet: bool) -> None:
    missing = [name for name, points in zip(report.names, report.points.counts.sum(axis=1), strict=True) if not points]
    if not missing:
        return
    said = f"nothing of {', '.join(missing)} could be held out, so the test says nothing of that"
    if not report.tested:
        said = "nothing could be held out: no class has two objects"
        if plot_file:
            warn(f"{plot_file}: not drawn, as there is no test", quiet=quiet)
    warn(f"{said}; train on more tiles, or on more objects", quiet=quiet)


def _samples(number: int, path: Path, settings: Settings, options: Mapping[str, Any]) -> Samples:
    """Return the points of a tile that are no sea, with their truth."""
    tile = open_tile(path)
    class_field, object_field = options["class_field"], options["object_field"]
    if class_field not in tile.names:
        found = ", ".join(tile.names)
        raise InputError(f"{path}: no ground truth: no field {class_field!r} with classes; it has {found}")
    stood = stand_out(tile, settings, quiet=options["quiet"])
    truth = read_columns(tile, (class_field, object_field))
    code = truth[class_field][stood.separation.other].astype(np.int64)
    if ((code < 0) | (code > len(OBJECT_CLASSES))).any():
        raise InputError(
            f"{path}: {class_field} holds {code.max()}; classes are 1 to {len(OBJECT_CLASSES)}, 0 for none"
        )
    if object_field in truth:
        objects = truth[object_field][stood.separation.other].astype(np.int64)
    else:  # without numbers, clusters of a class are taken for objects
        flat = np.vstack((stood.points.xy, 1000.0 * settings.objects.tolerance_m * code))
        objects = euclidean_clusters(flat, settings.objects.tolerance_m, 1)
    return Samples(stood.features, code, np.full(len(code), number), objects)


def fit(samples: Samples, settings: Settings) -> tuple[Model, Report]:
    """Return a model trained on a part of the samples, and its report on the rest."""
    test, split = hold_out(samples, settings.forest)
    names = ("features", "code", "tile", "number")
    seen, unseen = (Samples(*(getattr(samples, name)[part] for name in names)) for part in (~test, test))
    forest = train(seen, settings.forest)
    codes = tuple(int(code) for code in np.unique(samples.code))
    called = forest.classes_[predict(forest, unseen.features).argmax(axis=1)].astype(np.int64)
    importances = dict(zip(settings.features.names, map(float, forest.feature_importances_.round(4)), strict=True))
    report = Report(
        codes,
        Confusion.of(unseen.code, called, codes),
        Confusion.of(*_by_object(unseen, called), codes),
        importances,
        split,
        len(seen.code),
        len(unseen.code),
    )
    return Model(settings, forest), report


def _by_object(samples: Samples, called: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the class of each object, and what most of its points were called, shape (M,) each."""
    objects, which = samples.objects
    votes = np.zeros((objects.shape[1], len(OBJECT_CLASSES) + 1), np.int64)
    np.add.at(votes, (which, called), 1)
    return objects[2], votes.argmax(axis=1)
