"""Tables and figures of [Shi2022] on simulated tiles.

Run as ``python benchmarks/tiles.py FOLDER [SEEDS]``. Tables go to standard output, figures and a model to FOLDER. The
features of the tiles are computed once and stored in FOLDER (.npz).
"""

import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from seas import SEAS, column_of, with_sea

from seaclutter_cli.airborne.features import FEATURES, NonSeaPoints, features_of
from seaclutter_cli.airborne.forest import Samples, class_name, predict, split_samples, train
from seaclutter_cli.airborne.model import ObjectModel
from seaclutter_cli.airborne.objects import FoundObject, find_objects
from seaclutter_cli.airborne.separation import Separation, separate
from seaclutter_cli.airborne.settings import TileSettings
from seaclutter_cli.airborne.surface import OTHER, WATER, SeparationParams
from seaclutter_cli.evaluation.confusion import Confusion
from seaclutter_cli.grids.opening import SurfaceParams
from seaclutter_cli.plots.figure import render
from seaclutter_cli.plots.tiles import COLORS, LEFT_OUT, draw_confusion, draw_tile
from seaclutter_cli.runs.classify.train import TrainingReport, fit
from seaclutter_cli.simulation.airborne.recording import simulate_strips
from seaclutter_cli.simulation.airborne.scene import TileScene, load_tile_scene
from seaclutter_cli.truth import OBJECT_CLASSES

WINDOWS_M = (4, 8, 12, 16, 20, 24, 30, 40, 60, 80)
THRESHOLDS_M = (0.5, 0.8, 1.2, "auto")
FRESH = (50, 51, 52, 53)
TABLE_1 = ("calm_ships", "reefs", "farms", "high")
HEIGHTS_M = (300, 500, 800, 1200, 400, 600, 1000, 2000, 500, 350, 3000, 700, 250, 1500)
PULSES_M2 = (1.6, 1.6, 1.2, 1.2, 2.4, 1.6, 1.2, 1.0, 2.0, 1.6, 1.0, 1.5, 2.0, 1.2)


def points_of(scene: TileScene) -> tuple[Any, Any]:
    points = np.concatenate(list(simulate_strips(scene)))
    return points, np.stack([points[axis] for axis in "xyz"])


def head(title: str, *columns: str) -> None:
    """Print the title and the head of a table."""
    print(f"\n## {title}\n\n| {' | '.join(columns)} |\n|{' --- |' * len(columns)}")


def kappa(points: Any, classification: Any) -> float:
    return Confusion.of(points["classification"], classification, (OTHER, WATER)).kappa


def windows() -> None:
    """Print Table 1, kappa over the window: the method of the paper, and what was added to it step by step."""
    head("Table 1: kappa over the window (m)", "tile", "method", *map(str, WINDOWS_M))
    fixed = SeparationParams(height_m=0.5, land="ignore")
    methods = {
        "as published": SurfaceParams(),
        "without echoes from below": replace(fixed, island_m=None),
        "with islands detected": fixed,
        "with waves and land": TileSettings().separation,
    }
    scenes = {name: load_tile_scene(name) for name in TABLE_1}
    farms = scenes["farms"]
    scenes["farms, swell"] = replace(farms, water=replace(farms.water, swell_m=0.4, wave_m=0.12))
    for name, scene in scenes.items():
        points, xyz = points_of(scene)
        for method, params in methods.items():
            windows_m = [replace(params, window_m=float(window_m)) for window_m in WINDOWS_M]
            found = [separate([xyz], own, column_of(points)) for own in windows_m]
            row = [f"{kappa(points, one.classification):.3f}" for one in found]
            print(f"| {name} | {method} |", " | ".join(row), "|", flush=True)


def rough() -> None:
    """Print kappa over the threshold in rougher water, on a tile that was not used to choose parameters."""
    head("Kappa over the threshold (m)", "swell, wind sea (m)", *map(str, THRESHOLDS_M))
    scene = load_tile_scene("mixed").with_tile(seed=21)
    for swell_m, wave_m in ((0.25, 0.1), (0.4, 0.12), (0.6, 0.2), (1.0, 0.3)):
        points, xyz = points_of(replace(scene, water=replace(scene.water, swell_m=swell_m, wave_m=wave_m)))
        heights = [replace(TileSettings().separation, height_m=height_m) for height_m in THRESHOLDS_M]
        found = [separate([xyz], own, column_of(points)) for own in heights]
        row = [f"{kappa(points, one.classification):.3f}" for one in found]
        print(f"| {swell_m:g}, {wave_m:g} |", " | ".join(row), "|", flush=True)


def non_sea(points: Any, xyz: Any) -> tuple[Separation, NonSeaPoints, Any]:
    """Return the separation of a tile, its non-sea points, and their records."""
    found = separate([xyz], TileSettings().separation, column_of(points))
    other = found.other
    part = points[other]
    remaining = NonSeaPoints(
        xyz[:2, other], found.height_m[other].astype(float), part["intensity"].astype(float), found.points_per_cell
    )
    return found, remaining, part


def mixed(folder: Path, number: int, sea: str = "calm") -> dict[str, Any]:
    """Return the samples of a tile with individual height, density and gain, and the kappa of its separation."""
    path = folder / f"mixed{number}-{list(SEAS).index(sea)}.npz"
    if not path.exists():
        scene = with_sea(load_tile_scene("mixed").with_tile(seed=number + 1), SEAS[sea])
        at = number % len(HEIGHTS_M)
        gain = 7000.0 + 200 * (3 * number % 10)
        lidar = replace(scene.lidar, height_m=float(HEIGHTS_M[at]), pulses_m2=PULSES_M2[at], gain=gain)
        points, xyz = points_of(replace(scene, lidar=lidar))
        found, remaining, part = non_sea(points, xyz)
        features = features_of(remaining, TileSettings().features)
        np.savez(
            path,
            features=features,
            code=part["object_class"],
            number=part["object_id"],
            kappa=kappa(points, found.classification),
            size=len(points),
            true=np.count_nonzero(points["object_class"]),
            height=HEIGHTS_M[at],
        )
    return dict(np.load(path))


def samples_of(tiles: list[dict[str, Any]]) -> Samples:
    columns = [np.concatenate([tile[name] for tile in tiles]) for name in ("features", "code", "number")]
    tile = np.repeat(np.arange(len(tiles)), [len(one["code"]) for one in tiles])
    known = columns[1] > 0
    return Samples(columns[0][known], columns[1][known].astype(int), tile[known], columns[2][known].astype(int))


def only(samples: Samples, names: Sequence[str]) -> Samples:
    at = [FEATURES["full"].index(name) for name in names]
    return replace(samples, features=samples.features[:, at])


def spread(values: Sequence[float]) -> str:
    return f"{np.mean(values):.3f} ({min(values):.3f} to {max(values):.3f})"


def classes(folder: Path, seeds: int) -> tuple[Samples, ObjectModel]:
    """Print scores of models trained on some tiles and tested on others, with texture only and with all features."""
    tiles = [mixed(folder, number) for number in range(len(HEIGHTS_M))]
    head("Tiles `mixed`", "seed", "height (m)", "points", "non-sea points", "kappa, 20 m")
    for number, tile in enumerate(tiles):
        print(f"| {number + 1} | {tile['height']} | {tile['size']:,} | {len(tile['code']):,} | {tile['kappa']:.3f} |")
    samples = samples_of(tiles)
    for name in ("texture", "full"):
        chosen = only(samples, FEATURES[name])
        runs = [fit(chosen, settings_of(name, seed)) for seed in range(1, seeds + 1)]
        print_scores(folder, name, [report for _, report in runs])
    first = runs[0][0]
    (folder / "model.skops").write_bytes(first.to_bytes())
    alone = {name: of_one(only(samples, [name])) for name in FEATURES["full"]}
    print("\nmacro F1 of one feature alone:", ", ".join(f"{name} {value:.2f}" for name, value in alone.items()))
    return samples, first


def settings_of(features: str, seed: int) -> TileSettings:
    base = TileSettings()
    chosen: Any = features
    return replace(base, features=replace(base.features, features=chosen), forest=replace(base.forest, seed=seed))


def print_scores(folder: Path, name: str, reports: Sequence[TrainingReport]) -> None:
    """Print the scores of several divisions and draw the confusion matrix of all of them."""
    seeds = f"{name}: {len(reports)} divisions of the tiles"
    head(seeds, "macro F1, points", "macro F1, objects", "accuracy", "kappa")
    columns = [(r.points.macro_f1, r.objects.macro_f1, r.points.accuracy, r.points.kappa) for r in reports]
    print("|", " | ".join(spread(values) for values in zip(*columns, strict=True)), "|")
    head(f"{name}: classes, all divisions", "class", "precision", "recall", "F1", "F1, objects")
    total, objects = (Confusion(sum(getattr(r, kind).counts for r in reports)) for kind in ("points", "objects"))
    for row in zip(OBJECT_CLASSES, total.precision, total.recall, total.f1, objects.f1, strict=True):
        print(f"| {row[0]} |", " | ".join(f"{value:.3f}" for value in row[1:]), "|")
    print("\nimportances:", reports[0].importances, flush=True)
    picture = render(lambda figure: draw_confusion(figure, OBJECT_CLASSES, total.counts), ".png", aspect=0.85)
    (folder / f"confusion_{name}.png").write_bytes(picture)


def of_one(samples: Samples) -> float:
    """Return the macro F1 of a forest with a single feature."""
    params = replace(TileSettings().forest, trees=30)
    test, _ = split_samples(samples, params)
    columns = ("features", "code", "tile", "number")
    seen, unseen = (Samples(*(getattr(samples, name)[part] for name in columns)) for part in (~test, test))
    forest = train(seen, params)
    predicted = forest.classes_[predict(forest, unseen.features).argmax(axis=1)]
    return Confusion.of(unseen.code, predicted, range(1, len(OBJECT_CLASSES) + 1)).macro_f1


def fresh(folder: Path, model: ObjectModel) -> None:
    """Print the scores of the model on tiles that were not used for training or for choosing parameters."""
    tiles = [mixed(folder, number) for number in FRESH]
    samples = samples_of(tiles)
    predicted = model.forest.classes_[predict(model.forest, samples.features).argmax(axis=1)]
    points = Confusion.of(samples.code, predicted, range(1, len(OBJECT_CLASSES) + 1))
    objects, which = samples.objects
    votes = np.zeros((objects.shape[1], len(OBJECT_CLASSES) + 1), np.int64)
    np.add.at(votes, (which, predicted), 1)
    by_object = Confusion.of(objects[2], votes.argmax(axis=1), range(1, len(OBJECT_CLASSES) + 1))
    head("Fresh tiles", "macro F1, points", "macro F1, objects", "accuracy", "kappa", "kappa of the separation")
    values = (points.macro_f1, by_object.macro_f1, points.accuracy, points.kappa)
    kappas = " ".join(f"{tile['kappa']:.3f}" for tile in tiles)
    print("|", " | ".join(f"{value:.3f}" for value in values), "|", kappas, "|", flush=True)


def textures(folder: Path, samples: Samples) -> None:
    """Print and draw Fig. 2, the distribution of texture in each class."""
    head("Fig. 2: texture by class, quartiles", "class", "homogeneity", "dissimilarity", "second moment")
    groups = [samples.features[samples.code == code, :3] for code in range(1, len(OBJECT_CLASSES) + 1)]
    for name, values in zip(OBJECT_CLASSES, groups, strict=True):
        cells = ["{:.2f} {:.2f} {:.2f}".format(*np.quantile(values[:, k], (0.25, 0.5, 0.75))) for k in range(3)]
        print(f"| {name} |", " | ".join(cells), "|")

    def draw(figure: Any) -> None:
        for row, title in enumerate(("homogeneity", "dissimilarity", "second moment")):
            axes = figure.add_subplot(3, 1, row + 1)
            top = np.quantile(samples.features[:, row], 0.99)
            for name, values in zip(OBJECT_CLASSES, groups, strict=True):
                share, edges = np.histogram(values[:, row], 40, (0, top), density=True)
                axes.plot((edges[1:] + edges[:-1]) / 2, share, color=COLORS[name], linewidth=0.8, label=name)
            axes.set_xlabel(title)
            axes.set_yticks([])
        handles, labels = axes.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=4, handlelength=1.0, columnspacing=1.0)

    (folder / "fig2.png").write_bytes(render(draw, ".png", aspect=1.3))


def figure_3(folder: Path, model: ObjectModel, seeds: int) -> None:
    """Print and draw Fig. 3, the objects that are found and correctly classified."""
    head("Fig. 3: 4 ships, 2 farms, 1 garbage patch", "seed", "correctly classified", "other objects", "probability")
    for seed in range(77, 77 + seeds):
        points, xyz = points_of(load_tile_scene("fig3").with_tile(seed=seed))
        found, remaining, part = non_sea(points, xyz)
        probability = predict(model.forest, features_of(remaining, model.settings.features))
        objects, number, left_out = find_objects(
            remaining, probability, model.forest.classes_.tolist(), model.settings.objects
        )
        correct, other, probabilities = Counter(), Counter(), []
        for one in objects:
            own = part[number == one.number]
            pairs = Counter(zip(own["object_id"].tolist(), own["object_class"].tolist(), strict=True))
            truth = pairs.most_common(1)[0][0]
            if truth[1] == one.code:
                correct[truth] += 1
                probabilities.append(one.probability)
            else:
                other[f"{one.name} ({class_name(truth[1]) if truth[1] else 'sea'})"] += 1
        named = Counter(class_name(code) for _, code in correct)
        shown = ", ".join(f"{number} {name}" for name, number in sorted(named.items()))
        extent = f"{min(probabilities):.2f} to {max(probabilities):.2f}"
        print(f"| {seed} | {shown} | {dict(other) or 'none'} | {extent} |", flush=True)
        if seed == 77:
            sea, removed = xyz[:2, found.classification == WATER], remaining.xy[:, left_out > 0]
            _draw(folder, sea, removed, remaining.xy, number, objects)


def _draw(folder: Path, sea: Any, removed: Any, points_xy: Any, number: Any, objects: list[FoundObject]) -> None:
    code = np.array([0, *(one.code for one in objects)])[number]
    points = {class_name(one): points_xy[:, code == one] for one in sorted(set(code.tolist()) - {0})}
    if removed.size:
        points[LEFT_OUT] = removed
    boxes = [(one.name, one.corners()) for one in objects]
    (folder / "fig3.png").write_bytes(render(lambda figure: draw_tile(figure, sea, points, boxes), ".png", aspect=0.92))


def main() -> None:
    folder, seeds = Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 5
    folder.mkdir(parents=True, exist_ok=True)
    windows()
    rough()
    samples, model = classes(folder, seeds)
    fresh(folder, model)
    textures(folder, samples)
    figure_3(folder, model, seeds)


if __name__ == "__main__":
    main()
