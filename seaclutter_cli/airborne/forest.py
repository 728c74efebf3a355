"""Random forest that classifies points."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Interval

from seaclutter_cli.arrays import Floats, Indices, Ints, Mask, group_sizes, group_starts
from seaclutter_cli.errors import InputError, requiring
from seaclutter_cli.params import Count, key
from seaclutter_cli.threads import executor, threads
from seaclutter_cli.truth import OBJECT_CLASSES

_BLOCK = 20_000
_MIN_TILES = 4


@dataclass(frozen=True, kw_only=True)
class ForestParams:
    """Parameters of the random forest and its training."""

    trees: Annotated[int, Interval(ge=1, le=2000)] = key(100, "Number of trees, N_t.")
    features_per_node: Count | None = key(
        None, "Number of features considered at each node, N_f; null: the square root of the number of features."
    )
    min_leaf_points: Count = key(3, "Minimum number of points in a leaf.")
    max_points_per_object: Count = key(
        500,
        "Maximum number of training points of each object, chosen at random; keeps islands from dominating.",
        formerly="points_per_object",
    )
    test_share: Annotated[float, Interval(gt=0, lt=1)] = key(
        0.3, "Share of the tiles, or objects, that is held out for the test.", formerly="held_out"
    )
    seed: Annotated[int, Ge(0)] = key(1, "Seed of all random choices.")


@dataclass(frozen=True)
class Samples:
    """Features and ground truth of N points.

    ``features``, shape (N, F): features of each point; ``code``, shape (N,): class, from 1; 0 for non-sea points that
    belong to no object; ``tile``, ``number``, shape (N,): index of the tile, and number of the object in it.
    """

    features: Floats
    code: Ints
    tile: Ints
    number: Ints

    @property
    def objects(self) -> tuple[Ints, Ints]:
        """Tile, number and class of each object, shape (3, M), and the object index of each point, shape (N,)."""
        found, which = np.unique(np.stack((self.tile, self.number, self.code)), axis=1, return_inverse=True)
        return found, which.reshape(-1)


def join(samples: Sequence[Samples]) -> Samples:
    """Return the labelled points of several tiles as one set.

    Raise `InputError` if there are no labelled points, or all are of one class.
    """
    labelled = [part.code > 0 for part in samples]
    joined = Samples(
        *(
            np.concatenate([getattr(part, name)[known] for part, known in zip(samples, labelled, strict=True)])
            for name in ("features", "code", "tile", "number")
        )
    )
    classes = np.unique(joined.code)
    if not len(classes):
        raise InputError("no labelled points: no non-sea point belongs to an object")
    if len(classes) == 1:
        raise InputError(f"all objects are of one class ({class_name(classes[0])}); training needs at least two")
    return joined


def class_name(code: int) -> str:
    """Return the name of a class.

    Examples
    --------
    >>> class_name(8)
    'garbage patch'
    """
    return OBJECT_CLASSES[code - 1] if 1 <= code <= len(OBJECT_CLASSES) else f"class {code}"


def split_samples(samples: Samples, params: ForestParams) -> tuple[Mask, str]:
    """Return which points are held out for the test, shape (N,), and the unit of the split: ``tile`` or ``object``.

    With four tiles or more, whole tiles are held out; with fewer, whole objects of each class that has at least two.
    Single points are never held out, because they resemble their neighbours too closely.
    """
    rng = np.random.default_rng([params.seed, 1])
    tiles = np.unique(samples.tile)
    if len(tiles) >= _MIN_TILES:
        for _ in range(100):
            chosen = rng.permutation(tiles)[: max(1, round(params.test_share * len(tiles)))]
            test = np.isin(samples.tile, chosen)
            if set(samples.code[~test]) == set(samples.code):
                return test, "tile"
    objects, which = samples.objects
    chosen_objects = np.zeros(objects.shape[1], np.bool_)
    for code in np.unique(objects[2]):
        members = rng.permutation(np.flatnonzero(objects[2] == code))
        if len(members) > 1:
            chosen_objects[members[: min(max(1, round(params.test_share * len(members))), len(members) - 1)]] = True
    return chosen_objects[which], "object"


def train(samples: Samples, params: ForestParams) -> Any:
    """Return a random forest trained on samples.

    Trees grow on bootstrap samples and split by information gain ([Shi2022], Eq. 10 to 12); each node takes the best of
    N_f features chosen at random. Classes have equal weights, regardless of their number of points. The result does
    not depend on the number of threads.

    Raise `MissingExtraError` if scikit-learn is not installed.
    """
    with requiring("classification", "classify"):
        from sklearn.ensemble import RandomForestClassifier  # an optional dependency
    chosen, most = _subsample(samples, params), params.features_per_node
    forest = RandomForestClassifier(
        params.trees,
        criterion="entropy",
        max_features=min(most, samples.features.shape[1]) if most else "sqrt",
        min_samples_leaf=params.min_leaf_points,
        class_weight="balanced",
        random_state=params.seed,
        n_jobs=threads(),
    )
    forest.fit(samples.features[chosen].astype(np.float32), samples.code[chosen])
    forest.n_jobs = None
    return forest


def _subsample(samples: Samples, params: ForestParams) -> Indices:
    """Return indices of at most ``max_points_per_object`` random points of each object, ascending."""
    _, which = samples.objects
    priority = np.random.default_rng([params.seed, 2]).random(len(which))
    order = np.lexsort((priority, which))
    starts = group_starts(which[order])
    rank = np.arange(len(order)) - np.repeat(starts, group_sizes(starts, len(order)))
    return np.sort(order[rank < params.max_points_per_object])


def predict(forest: Any, features: Floats) -> Floats:
    """Return class probabilities, shape (N, C); the result does not depend on the number of threads."""
    parts = [features[start : start + _BLOCK].astype(np.float32) for start in range(0, len(features), _BLOCK)]
    with executor(threads(), "forest") as pool:
        found = list(pool.map(forest.predict_proba, parts))
    return np.concatenate([np.empty((0, len(forest.classes_))), *found])
