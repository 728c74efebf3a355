"""Classes of objects over sea states: forests trained on calm tiles, and on tiles of several seas.

Run as ``python benchmarks/classes_in_waves.py FOLDER [SEED]``. The table goes to standard output. The features of the
tiles are computed once and stored in FOLDER (.npz). SEED is that of the first test tile, 60 by default.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tiles import head, mixed, samples_of

from seaclutter_cli.airborne.forest import predict, train
from seaclutter_cli.airborne.settings import TileSettings
from seaclutter_cli.evaluation.confusion import Confusion
from seaclutter_cli.truth import OBJECT_CLASSES

TRAINING_TILES, TEST_TILES = 8, 1
TRAINING_SEAS = ("calm", "wind sea 0.5 m", "wind sea 1.1 m", "swell 1.2 m, 40 m long", "swell 1.5 m, 100 m long")
TEST_SEAS = ("calm", "wind sea 0.8 m", "wind sea 1.5 m", "swell 1.5 m, 60 m long", "both: 1.0 and 1.1 m")
CODES = range(1, len(OBJECT_CLASSES) + 1)


def forest_of(tiles: list[dict[str, Any]]) -> Any:
    return train(samples_of(tiles), TileSettings().forest)


def scores(forest: Any, tiles: list[dict[str, Any]]) -> tuple[float, float, Sequence[float]]:
    """Return the macro F1 of points and of objects, and the F1 of the points of each class."""
    samples = samples_of(tiles)
    predicted = forest.classes_[predict(forest, samples.features).argmax(axis=1)].astype(np.int64)
    points = Confusion.of(samples.code, predicted, CODES)
    objects, which = samples.objects
    votes = np.zeros((objects.shape[1], len(OBJECT_CLASSES) + 1), np.int64)
    np.add.at(votes, (which, predicted), 1)
    return points.macro_f1, Confusion.of(objects[2], votes.argmax(axis=1), CODES).macro_f1, points.f1.tolist()


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
        numbers = [first + TEST_TILES * index + step for step in range(TEST_TILES)]
        tiles = [mixed(folder, number, sea) for number in numbers]
        found = [scores(forest, tiles) for forest in forests.values()]
        values = [f"{value:.3f}" for own in found for value in own[:2]]
        kappas = " ".join(f"{tile['kappa']:.3f}" for tile in tiles)
        share = sum(int((tile["code"] > 0).sum()) for tile in tiles) / sum(int(tile["true"]) for tile in tiles)
        worst = np.argsort(found[-1][2])[:2]
        named = ", ".join(f"{OBJECT_CLASSES[at]} {found[-1][2][at]:.2f}" for at in worst)
        print(f"| {sea} | {kappas} | {100 * share:.1f} % |", " | ".join(values), f"| {named} |", flush=True)


if __name__ == "__main__":
    main()
