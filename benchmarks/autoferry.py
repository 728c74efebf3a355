"""Tracks of the method ``confirmed`` and of ``objects`` on real detections from a vessel, the Autoferry data set.

Run as ``python benchmarks/autoferry.py FOLDER``; it takes seconds. FOLDER contains the folders ``scenario*`` of
``Autoferry/sensor_fusion_dataset`` (CC0). A detection of its lidar (2 Hz) is the centre of a cluster; the clouds are
not published, so nothing is known of shapes, on which the score rests.
"""

import argparse
import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.filters.confirmation.objects import DetectedObject
from seaclutter_cli.filters.confirmation.tracks import Track
from seaclutter_cli.tracking.detections import Detections
from seaclutter_cli.tracking.tracker import Tracker

Floats = NDArray[np.float64]

LIDAR = 1
GATE_M = 10.0
"""Distance from a target's position within which detections belong to it."""
OTHER = -1
PAUSE_S = 5.0
LEAST_SCORE = 0.5
SETTINGS = {"own ship": False, "world": True}


@dataclass(frozen=True)
class Scan:
    """Detections of one scan of the lidar.

    Parameters
    ----------
    time_s : float
        Its time.
    own, detections, targets : ndarray, shape (2,), (M, 2) and (2, 2), float64
        Positions of own ship, of the detections and of the two target vessels, north and east in metres.
    target : ndarray, shape (M,), int64
        Target to which each detection belongs, or `OTHER`.
    """

    time_s: float
    own: Floats
    detections: Floats
    targets: Floats
    target: NDArray[np.int64]

    def nearest(self, target: int) -> int | None:
        """Return the detection of a target that is nearest to its position."""
        distance = np.hypot(*(self.detections - self.targets[target]).T)
        distance[self.target != target] = np.inf
        return int(distance.argmin()) if np.isfinite(distance).any() else None


def load(folder: Path) -> list[Scan]:
    """Return the lidar scans of a scenario; positions of targets are those of the ground truth with the same index."""
    detections = json.loads(next(folder.glob("*_detections.json")).read_text())
    truths = json.loads(next(folder.glob("*_groundTruth.json")).read_text())
    scans = []
    for record, truth in zip(detections, truths, strict=True):
        if record["sensorID"] != LIDAR:
            continue
        own = np.array(record["ownshipPosition"], np.float64)
        found = np.array(record["measurement"], np.float64).reshape(2, -1).T + own
        by_id = sorted(truth, key=lambda one: one["targetID"])
        targets = np.array([one["position"][:2] for one in by_id], np.float64)
        distance = np.hypot(*(found[:, None] - targets).transpose(2, 0, 1))
        target = np.where(distance.min(axis=1) < GATE_M, distance.argmin(axis=1), OTHER)
        scans.append(Scan(float(record["time"]), own, found, targets, target))
    return scans


def _detected(number: int, position: Floats) -> DetectedObject:
    return DetectedObject(np.array([number]), 0.0, position[None], position)


def innovations(scans: Sequence[Scan], *, world: bool) -> tuple[Floats, Floats]:
    """Return the distances of the targets' detections from where their tracks expect them, and the gates there.

    Here the ground truth associates detections and tracks, so that the gates have no influence.
    """
    distance, gate = [], []
    for target in (0, 1):
        track: Track | None = None
        for before, scan in pairwise(scans):
            if (k := scan.nearest(target)) is None:
                continue
            found = _detected(k, scan.detections[k] - (0 if world else scan.own))
            if track is None or scan.time_s - track.seen_s > PAUSE_S:
                track = Track(found.cells, found.center, scan.time_s, scan.time_s, 0.0, 1, seen_outside=True)
                continue
            distance.append(
                float(np.hypot(*(found.center - track.center - track.velocity * (scan.time_s - track.seen_s))))
            )
            gate.append(track.gate_m(scan.time_s, scan.time_s - before.time_s))
            track.move(found, scan.time_s)
    return np.array(distance), np.array(gate)


def percent(part: float, whole: float) -> str:
    return f"{100 * part / whole:.1f}" if whole else "-"


def row(*cells: object) -> None:
    print("| " + " | ".join(map(str, cells)) + " |")


def innovation_table(scenarios: Mapping[str, Sequence[Scan]]) -> None:
    """Print how far detections are from where tracks expect them."""
    print("\nDistance of the targets' detections from where their tracks expect them, and share outside the gate:\n")
    row("scenario", "coordinates", "median m", "P90 m", "P95 m", "P99 m", "outside %")
    row("---", "---", *["---:"] * 5)
    for setting, world in SETTINGS.items():
        results = {name: innovations(scans, world=world) for name, scans in scenarios.items()}
        together = [np.concatenate(parts) for parts in zip(*results.values(), strict=True)]
        for name, (distance, gate) in (results | {"**all**": (together[0], together[1])}).items():
            quantiles = (f"{value:.2f}" for value in np.quantile(distance, (0.5, 0.9, 0.95, 0.99)))
            row(name, setting, *quantiles, percent(int(np.count_nonzero(distance > gate)), len(distance)))


def ids_of_objects(scans: Sequence[Scan]) -> list[int]:
    """Return how many ids of confirmed objects the detections nearest to each target have, relative to own ship."""
    tracker, before_s, ids = Tracker(), -np.inf, defaultdict(set)
    for scan in scans:
        if scan.time_s - before_s > PAUSE_S:
            tracker.forget()
        before_s, places = scan.time_s, scan.detections - scan.own
        count = len(places)
        found = Detections.made(np.vstack((places.T, np.zeros(count))), np.arange(count), count)
        tracks = tracker.step(found, scan.time_s)
        for target in range(len(scan.targets)):
            k = scan.nearest(target)
            track = None if k is None else tracks[k]
            if track is not None:
                ids[target].add(track)
    return [sum(track.score >= LEAST_SCORE for track in own) for own in ids.values()]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="folder of the folders scenario*")
    folders = sorted(parser.parse_args().folder.glob("scenario*"), key=lambda path: int(path.name[8:]))
    scenarios = {path.name[8:]: load(path) for path in folders}
    innovation_table(scenarios)
    ids = [count for scans in scenarios.values() for count in ids_of_objects(scans)]
    print(f"\nIds of objects for each target: {np.mean(ids):.1f} in the mean, at most {max(ids)}.")


if __name__ == "__main__":
    main()
