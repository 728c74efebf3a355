"""Objects and proposed labels against truth: objects.py LOG.mcap…, each with LOG.labels.csv beside it.

For each log: HOTA (mean over overlaps of 5 to 95 %) and MOTA (at 50 %) of the visible targets after the definitions of
TrackEval, without boxes in areas to ignore or at targets that are not visible; ids for each target; medians of the
errors of position, of speed beyond the first second (against relative motion), and of the length of targets seen from
two sides; the share of visible targets with a box (at 50 %) that is not doubtful; and, in a hundred frames, such boxes
at no target (*false*), and second ones at a target (*parts*). Structures at no target are areas to ignore.
"""

import sys
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

import seaclutter
from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.evaluation.matching import overlaps, targets_of
from seaclutter_cli.labels import open_labels
from seaclutter_cli.tracking.boxes import STRUCTURE
from seaclutter_cli.truth import Boxes

Rows = NDArray[Any]
Compared = tuple[float, Boxes, Rows, Rows, Boxes]
ALPHAS = np.arange(0.05, 0.99, 0.05)
WAIT_S, NEAR_M, HALF = 1.0, 2.0, 0.5


def boxes_of(rows: Rows) -> Boxes:
    """Return the rows of a table of objects as boxes."""
    stack = [
        np.column_stack([rows[name] for name in names])
        for names in (("x_m", "y_m", "z_m"), ("length_m", "width_m", "height_m"))
    ]
    return Boxes(tuple(map(str, rows["track_id"])), tuple(rows["state"]), *stack, rows["yaw_rad"])


def frames_of(log: Path) -> Iterator[Compared]:
    """Yield the visible targets of each frame, the objects that count, their overlaps, and the rows of the objects."""
    table = seaclutter.find_objects(log).table()
    labels = open_labels(log.with_suffix(".labels.csv"))
    with seaclutter.open_log(log) as source:
        for frame in source.frames():
            truth = labels.truth(frame)
            visible = targets_of(frame, truth, EvaluationParams()).visible
            rows = table[(table["frame"] == frame.index) & (table["state"] == "confirmed")]
            places = np.column_stack([rows[name] for name in ("x_m", "y_m", "z_m")]).T
            hidden = truth.targets.chosen(np.flatnonzero(~visible))
            out = np.zeros(len(rows), np.bool_)
            for areas in (truth.ignored, hidden):
                flat = Boxes(areas.tracks, areas.classes, areas.centers, areas.sizes + np.array([0, 0, 99]), areas.yaws)
                out |= flat.covers(places, 0.5)
            targets = truth.targets.chosen(np.flatnonzero(visible))
            out |= (rows["class"] == STRUCTURE) & (overlaps(targets, boxes_of(rows)).max(axis=0, initial=0) < HALF)
            yield frame.stamp_ns / 1e9, targets, rows[~out], overlaps(targets, boxes_of(rows[~out])), truth.targets


def hota(frames: Sequence[tuple[Sequence[str], Sequence[str], Rows]]) -> float:
    """Return HOTA of frames, each with the names of targets and objects and their overlaps."""
    targets, objects = (sorted({name for one in frames for name in one[k]}) for k in (0, 1))
    if not targets or not objects:
        return 0.0
    numbers = [{name: k for k, name in enumerate(names)} for names in (targets, objects)]
    shape = len(targets), len(objects)
    common, seen, given = np.zeros(shape), np.zeros(shape[0]), np.zeros(shape[1])
    indexed = [([numbers[0][n] for n in a], [numbers[1][n] for n in b], overlap) for a, b, overlap in frames]
    for a, b, overlap in indexed:
        total = overlap.sum(axis=0, keepdims=True) + overlap.sum(axis=1, keepdims=True) - overlap
        common[np.ix_(a, b)] += np.divide(overlap, total, out=np.zeros_like(overlap), where=total > 0)
        np.add.at(seen, a, 1)
        np.add.at(given, b, 1)
    alignment = common / np.maximum(seen[:, None] + given - common, 1e-12)
    found = np.zeros((len(ALPHAS), *shape))
    for a, b, overlap in indexed:
        rows, columns = linear_sum_assignment(-alignment[np.ix_(a, b)] * overlap)
        for k, alpha in enumerate(ALPHAS):
            good = overlap[rows, columns] >= alpha - 1e-9
            np.add.at(found[k], (np.array(a, int)[rows[good]], np.array(b, int)[columns[good]]), 1)
    hits = found.sum(axis=(1, 2))
    detection = hits / np.maximum(seen.sum() + given.sum() - hits, 1)
    association = (found * found / np.maximum(seen[:, None] + given - found, 1)).sum(axis=(1, 2)) / np.maximum(hits, 1)
    return float(np.sqrt(detection * association).mean())


def errors(frames: Sequence[Compared]) -> tuple[Any, ...]:
    """Return ids by target, errors of position, of speed and of length, hits, false boxes, and changes of id."""
    ids, position, speed, length, sides = (defaultdict(list) for _ in range(5))
    first, places = {}, defaultdict(dict)
    for k, (time_s, _, _, _, targets) in enumerate(frames):
        for name, center in zip(targets.tracks, targets.centers[:, :2], strict=True):
            places[name][k] = time_s, center
    hits = wrong = stray = parts = 0
    for k, (time_s, targets, rows, overlap, _) in enumerate(frames):
        apart = np.linalg.norm(targets.centers[:, None, :2] - np.column_stack((rows["x_m"], rows["y_m"])), axis=2)
        score = overlap + 0.01 * (apart < NEAR_M)
        pairs = [(m, n) for m, n in zip(*linear_sum_assignment(-score), strict=True) if score[m, n] > 0]
        good = [(m, n) for m, n in pairs if overlap[m, n] >= HALF]
        hits += len(good)
        wrong += len(rows) - len(good)
        single = np.setdiff1d(np.arange(len(rows)), [n for _, n in pairs]).astype(np.int64)
        here = targets.covers(np.column_stack([rows[name] for name in ("x_m", "y_m", "z_m")]).T, NEAR_M)
        at_target = (overlap > 0).any(axis=0) | here
        parts += np.count_nonzero(at_target[single])
        stray += np.count_nonzero(~at_target[single])
        for m, n in pairs:
            name, row = targets.tracks[m], rows[n]
            first.setdefault(name, time_s)
            ids[name].append(row["track_id"])
            position[name].append(apart[m, n])
            length[name].append(row["length_m"] / targets.sizes[m, 0] - 1)
            sides[name].append(row["sides"])
            around = [places[name].get(k + step) for step in (-1, 1)]
            if all(around) and time_s - first[name] > WAIT_S and row["velocity"] == "own_ship":
                (before_s, before), (after_s, after) = around
                speed[name].append(row["speed_ms"] - np.hypot(*(after - before)) / (after_s - before_s))
    from_two = [abs(np.median(length[name])) for name in length if np.mean(sides[name]) > 1.5]
    changes = sum(int(np.count_nonzero(np.diff(own))) for own in ids.values())
    pooled = (np.concatenate([[], *values.values()]) for values in (position, speed))
    return ids, *pooled, from_two, (hits, wrong, stray, parts, changes)


def median(values: Sequence[float]) -> str:
    return f"{np.median(np.abs(values)):.2f}" if len(values) else "-"


def main(logs: Sequence[str]) -> None:
    print(f"{'log':24} frames  HOTA  MOTA  ids  position m  speed m/s  length  boxed %  false/100  parts/100")
    pooled = [[], [], [], 0, 0, 0, 0, 0]
    for log in map(Path, logs):
        frames = list(frames_of(log))
        total = sum(len(targets) for _, targets, *_ in frames)
        ids, position, speed, length, (hits, wrong, stray, parts, changes) = errors(frames)
        score = hota([(t.tracks, tuple(map(str, rows["track_id"])), o) for _, t, rows, o, _ in frames])
        mota = 1 - (total - hits + wrong + changes) / max(total, 1)
        each = np.mean([len(set(own)) for own in ids.values()]) if ids else 0
        columns = (f"{log.stem:24} {len(frames):6} {score:5.2f} {mota:5.2f} {each:4.1f} {median(position):>11}",)
        columns += (f"{median(speed):>10} {median(length):>7} {100 * hits / max(total, 1):8.1f}",)
        print(*columns, f"{100 * stray / len(frames):10.1f} {100 * parts / len(frames):10.1f}", flush=True)
        for known, new in zip(pooled[:3], (position, speed, length), strict=True):
            known.extend(new)
        pooled[3:] = [a + b for a, b in zip(pooled[3:], (hits, stray, parts, total, len(frames)), strict=True)]
    position, speed, length, hits, stray, parts, total, count = pooled
    text = f"{median(position)} m, {median(speed)} m/s, length {median(length)}"
    boxes = f"{100 * hits / max(total, 1):.1f} % boxed"
    wrong = f"{100 * stray / max(count, 1):.1f} false, {100 * parts / max(count, 1):.1f} parts"
    print(f"all: {text}, {boxes}; in 100 frames {wrong}")


if __name__ == "__main__":
    main(sys.argv[1:])
