"""How well suspects and indications do without labels, on simulated logs whose truth is known.

Run as ``python benchmarks/suspects.py LOG.mcap...``, simulated recordings with their labels beside them. A
target is lost to a method if it is missed in five frames or more, as `evaluate` counts, in which a filter that keeps
exactly the points of targets would find it, without those that the configuration removes. The table has, for each
method, the rank of the first suspect at a lost target in logs with one, and the number of suspects that are at no
target; then rank correlations of indications with true scores.
"""

import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from ideal import EVALUATION as PARAMS
from ideal import detected
from scipy.stats import spearmanr

from seaclutter_cli.config import load_config
from seaclutter_cli.evaluation.matching import point_truth, targets_of
from seaclutter_cli.evaluation.scores import Summary, score_frame
from seaclutter_cli.labels import open_labels
from seaclutter_cli.pipeline import run_each
from seaclutter_cli.selection import Selection
from seaclutter_cli.sources.formats import open_source
from seaclutter_cli.suspects.finder import CHOSEN, Suspect, SuspectFinder
from seaclutter_cli.suspects.indications import Indications
from seaclutter_cli.truth import CLUTTER, IGNORED, Boxes

METHODS = ("joint", "confirmed", "sor", "ror", "lior", "none")
FRAMES, LEAST_FRAMES = 60, 5
PAIRS = {"doubtful_per_frame": "false_alarms_per_frame", "targets_lost": "target_loss", "f1": "f1"}


@dataclass
class Study:
    """Suspects of each method, frames in which each method lost each target, boxes by frame, and scores."""

    suspects: list[Sequence[Suspect]] = field(default_factory=list)
    lost: list[Counter[str]] = field(default_factory=lambda: [Counter() for _ in METHODS])
    boxes: dict[int, Boxes] = field(default_factory=dict)
    summaries: list[Summary] = field(default_factory=lambda: [Summary() for _ in METHODS])
    indications: Indications | None = None


def study(log: Path) -> Study:
    """Return the suspects and scores of a log."""
    source, labels = open_source(log), open_labels(log.with_suffix(".labels.csv"))
    filters = [load_config(None, method=name).make_filter() for name in METHODS]
    finders, indicator, found = [SuspectFinder() for _ in METHODS], SuspectFinder(len(METHODS)), Study()
    for frame, results, _ in run_each(source, filters, Selection(frames=FRAMES)):
        truth = labels.truth(frame)
        if truth is None or truth.targets is None:
            continue
        found.boxes[frame.index] = truth.targets
        perfect = ~np.isin(point_truth(frame, truth, PARAMS), (CLUTTER, IGNORED))
        targets = targets_of(frame, truth, PARAMS)
        for m, (result, score) in enumerate(zip(results, score_frame(frame, results, truth, PARAMS), strict=True)):
            if result is None or score is None:
                continue
            found.summaries[m].add(score, None)
            finders[m].add(frame, [result])
            possible = targets.visible & detected(frame, targets, perfect & ~np.isin(result.reason, CHOSEN))
            missed = np.flatnonzero(possible & ~detected(frame, targets, result.keep))
            found.lost[m].update(truth.targets.tracks[k] for k in missed)
        indicator.indicate(frame, results)
    found.suspects = [finder.finish()["removed"] for finder in finders]
    indicator.finish()
    found.indications = indicator.tally
    return found


def at(suspect: Suspect, boxes: Boxes, margin_m: float = 1.0) -> set[str]:
    """Return the targets at whose box, from above, a suspect is."""
    place = np.array([[suspect.x_m], [suspect.y_m], [0.0]])
    flat = Boxes(boxes.tracks, boxes.classes, boxes.centers * (1, 1, 0), boxes.sizes, boxes.yaws)
    return {track for track, inside in zip(boxes.tracks, flat.members(place, margin_m), strict=True) if len(inside)}


def correlation(one: Sequence[Any], other: Sequence[Any]) -> float:
    """Return the rank correlation; NaN if it is not defined."""
    values = np.array([one, other], np.float64)
    if not np.isfinite(values).all() or (np.ptp(values, axis=1) == 0).any():
        return np.nan
    return float(spearmanr(*values)[0])


def main() -> None:
    """Print the figures of each log, and those of all."""
    ranks: list[list[float]] = [[] for _ in METHODS]
    false: list[list[int]] = [[] for _ in METHODS]
    related: list[list[float]] = []
    for log in map(Path, sys.argv[1:]):
        found = study(log)
        for m, suspects in enumerate(found.suspects):
            lost = {track for track, frames in found.lost[m].items() if frames >= LEAST_FRAMES}
            places = [at(one, found.boxes[one.frame]) for one in suspects]
            hits = [bool(lost & place) for place in places]
            false[m].append(sum(not place for place in places))
            if lost:
                ranks[m].append(hits.index(True) + 1 if True in hits else np.inf)
        scores = [one.as_dict() for one in found.summaries]
        guesses = [found.indications.of_method(m) for m in range(len(METHODS))] if found.indications else []
        related.append(
            [correlation([one[a] for one in guesses], [one.get(b) for one in scores]) for a, b in PAIRS.items()]
        )
        print(log.stem, [one[-1:] for one in ranks], [one[-1] for one in false], np.round(related[-1], 2), flush=True)
    for name, own, none in zip(METHODS, ranks, false, strict=True):
        first, three = (sum(rank <= most for rank in own) for most in (1, 3))
        listed = f"first {first}, among three {three}, not listed {sum(map(np.isinf, own))}"
        print(f"{name}: logs with a lost target {len(own)}: {listed}; suspects at no target {np.mean(none):.2f} a log")
    for (guess, true), values in zip(PAIRS.items(), np.array(related).T, strict=True):
        print(f"{guess} and {true}: median {np.nanmedian(values):.2f}, mean {np.nanmean(values):.2f}")


if __name__ == "__main__":
    main()
