"""The curves of evidence of the method ``confirmed``, learned from labelled logs (``evidence.json``).

Run as ``python benchmarks/train_evidence.py FOLDER … -o evidence.json``: each folder has the logs of one simulator, at
any depth, and labels beside them, as of ``simulate random --physics wide``. All folders have equal weight, and so do
all logs of one. It prints the loss in nats per object, with each folder left out in turn and with each third of the
logs of all.
"""

import argparse
import json
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

import seaclutter
from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.evaluation.matching import point_truth
from seaclutter_cli.filters import confirmed
from seaclutter_cli.filters.confirmation.evidence import FEATURES, OF_SHAPE, OF_TRACKS, track_features
from seaclutter_cli.filters.confirmation.objects import Clusters, features_of
from seaclutter_cli.labels import open_labels
from seaclutter_cli.truth import IGNORED

Floats = NDArray[np.float64]

KNOTS, SMOOTHNESS, SHRINKAGE = 9, 1e-3, 0.02
"""Of the last two, those with the least loss on the logs of a simulator that was left out, in the mean of three."""
STEPS = 20
MARGIN_M = 0.3
MOST = 400
"""Number of objects of one log: more of them resemble each other."""


@dataclass
class Looks:
    """Objects in single frames: features, shape (F, K), whether they are targets and their weights, shape (K,)."""

    features: Floats
    target: NDArray[np.bool_]
    weight: Floats

    @classmethod
    def joined(cls, parts: Sequence["Looks"]) -> "Looks":
        """Return the objects of all parts, each of which has the same weight."""
        return cls(
            np.concatenate([one.features for one in parts], axis=1),
            np.concatenate([one.target for one in parts]),
            np.concatenate([one.weight / one.weight.sum() / len(parts) for one in parts]),
        )


class Recorder(confirmed.Confirmed):
    """The method, which notes the features of all objects, and whether they are targets."""

    def __init__(self, labels: Any, *, intensities: bool) -> None:
        super().__init__(self.Params(use_intensity=intensities))
        self.labels, self.seen = labels, []

    def _examine(self, frame: Any, time_s: float) -> Any:
        truth, find = self.labels.truth(frame), confirmed.find_objects
        points = None if truth is None else point_truth(frame, truth, EvaluationParams())
        known: dict[int, tuple[Floats, bool]] = {}
        ignored = points is not None and (points == IGNORED) | truth.ignored.covers(frame.coordinates, MARGIN_M)

        def noted(sea: Any, echoes: Any, among: Any, heights: Any, *, near: bool) -> Any:
            clusters = Clusters.among(sea, echoes, among, heights)
            if points is not None and len(clusters):
                target, unclear = (
                    clusters.mean(one[echoes.index].astype(float))
                    for one in ((points > 0) & (points != IGNORED), ignored)
                )
                features = features_of(echoes, clusters, heights, sea.beams)
                for k in np.flatnonzero((target > 0.5) | (unclear < 0.5)).tolist():  # no quays and land
                    known[echoes.index[clusters.members(k)].min()] = features[:, k], target[k] > 0.5
            return find(sea, echoes, among, heights, near=near)

        confirmed.find_objects = noted
        try:
            one = super()._examine(frame, time_s)
        finally:
            confirmed.find_objects = find
        for found, track in zip(one.objects, one.tracks, strict=True):
            if seen := known.get(found.points.min()):
                of_track = track_features(np.array([track.error_m]), np.array([track.rate_hz]))[:, 0]
                self.seen.append(((*seen[0], *of_track), seen[1]))
        return one


def looks(path: Path, *, intensities: bool) -> Looks | None:
    """Return the objects of a log; None without any."""
    method = Recorder(open_labels(path.with_name(f"{path.stem}.labels.csv")), intensities=intensities)
    with seaclutter.open_log(path) as log:
        for frame in log.frames():
            method.process(frame)
    method.flush()
    if not method.seen:
        return None
    features, target = (np.array(part) for part in zip(*method.seen, strict=True))
    some = np.random.default_rng(0).permutation(len(target))[:MOST]
    return Looks(features[some].T, target[some], np.ones(len(some)))


class Curves:
    """One curve of straight pieces for each feature, fitted by logistic regression with smoothness as penalty [1]_.

    A feature that is NaN, as the error of a new track, says nothing.

    .. [1] Hastie, Tibshirani (1986). "Generalized additive models". Statistical Science 1(3).
    """

    def __init__(self, seen: Looks, names: Sequence[str]) -> None:
        self.names = names
        quantiles = np.linspace(0.01, 0.99, KNOTS)
        self.knots = [np.unique(np.nanquantile(values, quantiles).round(3)) for values in seen.features]
        basis, weight = self._basis(seen.features), seen.weight / seen.weight.sum()
        penalty = np.zeros((basis.shape[1], basis.shape[1]))
        for start, knots in self._spans():
            bend = np.diff(np.eye(len(knots)), 2, axis=0)
            own = slice(start, start + len(knots))
            penalty[own, own] = SMOOTHNESS * (bend.T @ bend + SHRINKAGE * np.eye(len(knots)))
        self.values = np.zeros(basis.shape[1])
        for _ in range(STEPS):
            odds = expit(basis @ self.values)
            gradient = basis.T @ (weight * (seen.target - odds)) - penalty @ self.values
            curvature = (basis * (weight * np.maximum(odds * (1 - odds), 1e-4))[:, None]).T @ basis + penalty
            self.values += np.linalg.solve(curvature + 1e-9 * np.eye(len(curvature)), gradient)

    def loss(self, seen: Looks) -> float:
        """Return the mean loss in nats."""
        signed = np.where(seen.target, 1, -1) * (self._basis(seen.features) @ self.values)
        return float((seen.weight * np.logaddexp(0, -signed)).sum() / seen.weight.sum())

    def table(self) -> dict[str, Any]:
        """Return what the method reads."""
        curves = {
            name: {"value": knots.tolist(), "log_odds": self.values[start : start + len(knots)].round(3).tolist()}
            for name, (start, knots) in zip(self.names, self._spans(), strict=True)
        }
        return {"offset": round(float(self.values[0]), 3), "curves": curves}

    def _spans(self) -> Iterator[tuple[int, Floats]]:
        start = 1
        for knots in self.knots:
            yield start, knots
            start += len(knots)

    def _basis(self, features: Floats) -> Floats:
        hats = [
            np.nan_to_num([np.interp(x, k, row) for row in np.eye(len(k))])
            for x, k in zip(features, self.knots, strict=True)
        ]
        return np.concatenate([np.ones((1, features.shape[1])), *hats]).T


def picture(table: dict[str, Any], path: Path) -> None:
    """Draw all curves."""
    plt.rcParams.update({"svg.hashsalt": "evidence", "svg.fonttype": "none"})
    figure, axes = plt.subplots(2, 6, figsize=(13, 4), sharey=True, layout="constrained")
    for axis, name in zip(axes.flat, table["curves"], strict=False):
        axis.axhline(0, color="0.8")
        axis.plot(*table["curves"][name].values(), marker=".")
        axis.set_title(name, fontsize=9)
    for axis in axes.flat[len(table["curves"]) :]:
        axis.set_axis_off()
    figure.supylabel("log-odds of a target")
    figure.savefig(path, metadata={"Date": None})


def learned(folders: Sequence[Path], *, intensities: bool) -> Curves:
    """Return the curves learned from all logs of some folders; print how they do on what was left out."""
    with ProcessPoolExecutor(2) as pool:
        of_log = partial(looks, intensities=intensities)
        found = [list(pool.map(of_log, sorted(folder.rglob("*.mcap")))) for folder in folders]
    logs = [[one for one in some if one is not None] for some in found]
    names = (*FEATURES[: None if intensities else OF_SHAPE], *OF_TRACKS)
    every = Looks.joined([Looks.joined(some) for some in logs])
    print("with" if intensities else "without", "intensities:", end=" ")
    print(f"{sum(map(len, logs))} logs, {len(every.target):,} objects, {every.target.mean():.0%} of targets")
    for number, folder in enumerate(folders if len(logs) > 1 else ()):
        others = Looks.joined([Looks.joined(some) for other, some in enumerate(logs) if other != number])
        print(f"without {folder.name}: {Curves(others, names).loss(Looks.joined(logs[number])):.4f} on its logs")
    for third in range(3):
        rest = Looks.joined([Looks.joined([one for k, one in enumerate(some) if k % 3 != third]) for some in logs])
        out = Looks.joined([Looks.joined(some[third::3]) for some in logs])
        print(f"third {third + 1} of all logs left out: {Curves(rest, names).loss(out):.4f}")
    curves = Curves(every, names)
    print(f"all: {curves.loss(every):.4f}")
    return curves


def main() -> None:
    """Learn the curves, print how they do on what was left out, and write them."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folders", nargs="+", type=Path, help="folders of logs with labels, one for each simulator")
    parser.add_argument("-o", "--output", type=Path, required=True, help="file of the curves")
    parser.add_argument("--plot", type=Path, help="picture of the curves")
    given = parser.parse_args()
    curves = learned(given.folders, intensities=True)
    tables = {"version": 6, "all": curves.table(), "shape": learned(given.folders, intensities=False).table()}
    given.output.write_text(json.dumps(tables, indent=1) + "\n", "utf-8")
    if given.plot:
        picture(curves.table(), given.plot)


if __name__ == "__main__":
    main()
