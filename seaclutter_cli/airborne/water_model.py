"""The model that distinguishes water from land: boosted trees over the features of squares, evaluated by numpy."""

from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.squares import Squares
from seaclutter_cli.arrays import Floats

UNIT = 1 / 4096
"""Unit of the values of leaves, which are whole numbers: their sum is the same on every machine."""
_NEAR, _FAR = 2, 8
_SAME_M = 0.15


@dataclass(frozen=True)
class Trees:
    """T trees of at most M nodes; leaves lead to themselves.

    ``feature``, ``child``, shape (T, M) and (T, M, 2): feature that a node compares, and its children: where the
    feature is greater, and where it is not; ``threshold``, shape (T, M): what it compares with; ``missing``, shape (T,
    M): child for a feature that is not known; ``value``, shape (T, M): value of each node in units of log odds.
    """

    feature: NDArray[Any]
    child: NDArray[Any]
    threshold: NDArray[np.float32]
    missing: NDArray[Any]
    value: NDArray[np.int32]

    def log_odds(self, table: NDArray[np.float32]) -> Floats:
        """Return the log odds of water, shape (N,), from features, shape (N, F)."""
        total, row = np.zeros(len(table), np.int64), np.arange(len(table))
        for feature, child, threshold, missing, value in zip(
            self.feature, self.child, self.threshold, self.missing, self.value, strict=True
        ):
            node = np.zeros(len(table), np.intp)
            while True:
                own = table[row, feature[node]]
                way = np.where(np.isnan(own), missing[node], own <= threshold[node])
                deeper = child[node, way]
                if (deeper == node).all():
                    break
                node = deeper
            total += value[node]
        return np.asarray(total * UNIT, np.float64)


@dataclass(frozen=True)
class WaterModel:
    """Trees over the table of features, and others that also know what the first make of the squares around."""

    features: tuple[str, ...]
    first: Trees
    second: Trees

    def log_odds(self, squares: Squares, names: tuple[str, ...], table: NDArray[np.float32], given: Floats) -> Floats:
        """Return the log odds of water of N squares; ``given``, shape (N,): log odds by trusted classes."""
        if names != self.features:
            raise ValueError("the model was trained with other features")
        likely = 1 / (1 + np.exp(-self.first.log_odds(table) - given))
        return self.second.log_odds(np.concatenate((table, around(squares, likely)), axis=1)) + given


def around(squares: Squares, likely: Floats) -> NDArray[np.float32]:
    """Return how likely each square, those around it near and far, at its level, and in the tile are water: (N, 5)."""
    order = np.argsort(squares.level_m, kind="stable")
    level, total = squares.level_m[order], np.concatenate(([0.0], np.cumsum(likely[order])))
    low = np.searchsorted(level, squares.level_m - _SAME_M)
    high = np.searchsorted(level, squares.level_m + _SAME_M, "right")
    mean = float(likely.mean()) if len(likely) else 0.0
    return np.stack(
        (
            likely,
            squares.around(likely, _NEAR),
            squares.around(likely, _FAR),
            (total[high] - total[low]) / (high - low),
            np.full(len(likely), mean),
        ),
        axis=1,
    ).astype(np.float32)


@cache
def water_model(name: str) -> WaterModel:
    """Return a model of the package: ``water``, or ``water_by_shape``, trained with most intensities left out."""
    with (files("seaclutter_cli.airborne") / f"{name}.npz").open("rb") as file, np.load(file) as stored:
        trees = [Trees(*(stored[f"{step}_{name}"] for name in Trees.__dataclass_fields__)) for step in (1, 2)]
        return WaterModel(tuple(stored["features"].tolist()), *trees)
