"""Classes of objects over sea states: forests trained on calm tiles, and on tiles of several seas.

Run as ``python benchmarks/classes_in_waves.py FOLDER [FIRST]``. The table goes to standard output. The features of the
tiles are computed once and stored in FOLDER (.npz). FIRST is the number of the first test tile, 60 by default; there
are four test tiles for each sea.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tiles import head, mixed, samples_of, spread

from seaclutter_cli.airborne.forest import Samples, predict, train
from seaclutter_cli.airborne.settings import TileSettings
from seaclutter_cli.evaluation.confusion import Confusion
from seaclutter_cli.truth import OBJECT_CLASSES

TRAINING_TILES, TEST_TILES = 8, 4
TRAINING_SEAS = ("calm", "wind sea 0.5 m", "wind sea 1.1 m", "swell 1.2 m, 40 m long", "swell 1.5 m, 100 m long")
TEST_SEAS = ("calm", "wind sea 0.8 m", "wind sea 1.5 m", "swell 1.5 m, 60 m long", "both: 1.0 and 1.1 m")
CODES = range(1, len(OBJECT_CLASSES) + 1)


def forest_of(tiles: list[dict[str, Any]]) -> Any:
    return train(samples_of(tiles), TileSettings().forest)


def predicted(forest: Any, samples: Samples) -> NDArray[np.int64]:
    return forest.classes_[predict(forest, samples.features).argmax(axis=1)].astype(np.int64)


def scores(forest: Any, tile: dict[str, Any]) -> tuple[float, float]:
    """Return the macro F1 of the points and of the objects of a tile."""
    samples = samples_of([tile])
    found = predicted(forest, samples)
    objects, which = samples.objects
    votes = np.zeros((objects.shape[1], len(OBJECT_CLASSES) + 1), np.int64)
    np.add.at(votes, (which, found), 1)
    points, by_object = Confusion.of(samples.code, found, CODES), Confusion.of(objects[2], votes.argmax(axis=1), CODES)
    return points.macro_f1, by_object.macro_f1


def worst_classes(forest: Any, tiles: list[dict[str, Any]]) -> str:
    """Return the two classes with the lowest F1 over the points of all tiles."""
    samples = samples_of(tiles)
    f1 = Confusion.of(samples.code, predicted(forest, samples), CODES).f1
    return ", ".join(f"{OBJECT_CLASSES[at]} {f1[at]:.2f}" for at in np.argsort(f1)[:2])


def main() -> None:
    folder = Path(sys.argv[1])
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 60
    folder.mkdir(parents=True, exist_ok=True)
    seas = {"calm": ("calm",), "several seas": TRAINING_SEAS}
    training = {
        name: [mixed(folder, number, own[number % len(own)]) for number in range(TRAINING_TILES)]
        for name, own in seas.items()
    }
    forests = {name: forest_of(tiles) for name, tiles in training.items()}
    columns = [f"trained on {name}: {unit}" for name in forests for unit in ("points", "objects")]
    head(
        "Macro F1 over sea states", "sea", "kappa of the separation", "objects' points found", *columns, "worst classes"
    )
    for index, sea in enumerate(TEST_SEAS):
        tiles = [mixed(folder, first + TEST_TILES * index + step, sea) for step in range(TEST_TILES)]
        kappas = [float(tile["kappa"]) for tile in tiles]
        share = sum(int((tile["code"] > 0).sum()) for tile in tiles) / sum(int(tile["true"]) for tile in tiles)
        own = [zip(*(scores(forest, tile) for tile in tiles), strict=True) for forest in forests.values()]
        values = [spread(unit) for pair in own for unit in pair]
        separated = f"{min(kappas):.3f} to {max(kappas):.3f} | {100 * share:.1f} %"
        worst = worst_classes(forests["several seas"], tiles)
        print(f"| {sea} | {separated} |", " | ".join(values), f"| {worst} |", flush=True)


if __name__ == "__main__":
    main()
