"""Samples of frames: a subset of the points with reasons and truth; labelled boxes and clusters, for players, too."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Bytes, Floats, Ints, Mask
from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.evaluation.matching import FrameTargets, Matches, finder_of, match_clusters, point_truth, targets_of
from seaclutter_cli.frame import FilterResult, Frame, Reason, WaterState
from seaclutter_cli.interfaces import Labels
from seaclutter_cli.messages.scene import SceneBox, SceneTrack, SceneUpdate
from seaclutter_cli.reporting import palette
from seaclutter_cli.truth import CLUTTER, IGNORED, Boxes, Truth

_MAX_CLUSTERS = 400

Shown = dict[str, Any]
_CLUSTERS = {
    "target": (palette.STATES["detected"], ""),
    "false": (palette.STATES["false alarm"], "false alarm"),
    "unknown": (palette.TRUTH["clutter"], ""),
    "unconfirmed": (palette.REASONS[Reason.UNCONFIRMED], "unconfirmed"),
}
_BOXES = {
    "detected": (palette.STATES["detected"], "{}"),
    "missed": (palette.STATES["missed target"], "{} (missed)"),
    "hidden": (palette.TRUTH["unknown"], "{} (not visible)"),
    "ignored": (palette.TRUTH["unknown"], ""),
}
"""Colours of clusters by their kind, and of boxes by their state, with texts for players."""


def unconfirmed(result: FilterResult) -> Mask:
    """Return the points of objects that were not confirmed, shape (N,).

    There are none without thresholds: the reason of the water is then the same.
    """
    return np.equal(result.reason, Reason.UNCONFIRMED) & (result.rings is not None)


def find_boxes(
    frame: Frame, results: Sequence[FilterResult | None], truth: Truth | None, params: EvaluationParams
) -> tuple[list[Shown], list[list[Shown]]]:
    """Return labelled boxes and, for each method, the bounding boxes of its clusters.

    A box has ``track``, ``class``, ``center``, ``size``, ``yaw``, and ``state``: ``ignored``; ``hidden`` if not
    visible; otherwise a list with ``detected`` or ``missed`` for each method, None for methods that could not process
    the frame. A cluster has ``low`` and ``high`` corners, ``points`` and ``kind``: ``target``, ``false``, or
    ``unknown`` without labels; ``unconfirmed`` for clusters of unconfirmed points. There are at most the 400 largest
    clusters, and as many unconfirmed.
    """
    targets = None if truth is None else targets_of(frame, truth, params)
    subsets = [mask for result in results if result is not None for mask in (result.keep, unconfirmed(result))]
    finder = finder_of(frame, subsets, params)

    def found_by(result: FilterResult | None) -> tuple[list[Shown], Matches | None]:
        if result is None:
            return [], None
        masks = (points & frame.valid for points in (result.keep, unconfirmed(result)))
        kept, others = (finder.clusters(mask, params.min_cluster_points) for mask in masks)
        matches = None if targets is None else match_clusters(kept, targets, params)
        return _clusters(frame, kept, matches, "unknown") + _clusters(frame, others, None, "unconfirmed"), matches

    clusters, matched = zip(*map(found_by, results), strict=True)
    return _boxes(truth, targets, matched), list(clusters)


def _clusters(frame: Frame, labels: Ints, matches: Matches | None, kind: str) -> list[Shown]:
    """Return the bounding boxes of the clusters, at most the `_MAX_CLUSTERS` largest, of a kind without matches."""
    members = np.flatnonzero(labels >= 0)
    members = members[np.argsort(labels[members], kind="stable")]
    size = np.bincount(labels[members])
    starts = np.cumsum(size) - size
    xyz = frame.coordinates[:, members]
    low, high = (reduce.reduceat(xyz, starts, axis=1).T for reduce in (np.minimum, np.maximum))
    kinds = np.where(matches.belongs, "target", "false").tolist() if matches else [kind] * len(size)
    return [
        {"low": _rounded(low[k]), "high": _rounded(high[k]), "points": int(size[k]), "kind": kinds[k]}
        for k in np.sort(np.argsort(-size, kind="stable")[:_MAX_CLUSTERS]).tolist()
    ]


def _boxes(truth: Truth | None, targets: FrameTargets | None, matches: Sequence[Matches | None]) -> list[Shown]:
    if truth is None or targets is None:
        return []
    boxes = [{**box, "state": "ignored"} for box in _described(truth.ignored)]
    for number, box in enumerate(_described(truth.targets) if truth.targets is not None else ()):
        states = [None if one is None else "detected" if one.detected[number] else "missed" for one in matches]
        boxes.append({**box, "state": states if targets.visible[number] else "hidden"})
    return boxes


def _described(boxes: Boxes) -> list[Shown]:
    rows = zip(boxes.tracks, boxes.classes, boxes.centers, boxes.sizes, boxes.yaws, strict=True)
    return [
        {"track": track, "class": kind, "center": _rounded(center), "size": _rounded(size), "yaw": float(yaw)}
        for track, kind, center, size, yaw in rows
    ]


def _rounded(values: Floats) -> list[float]:
    return [round(float(value), 3) for value in values]


def scene_updates(
    params: EvaluationParams,
    labels: Labels | None,
    tracks: Callable[[FilterResult], tuple[Mapping[str, SceneTrack], Sequence[str]]],
) -> Callable[[FilterResult], SceneUpdate]:
    """Return a function that makes the scene update of a filtered frame: clusters, tracks and, with labels, boxes."""

    def make(result: FilterResult) -> SceneUpdate:
        frame = result.frame
        found = boxes_of(result, labels.truth(frame) if labels else None, params)
        groups = {f"{frame.topic} {name}": boxes for name, boxes in found.items() if labels or name != "labels"}
        return SceneUpdate(frame.stamp_ns, frame.cloud.frame_id, groups, *tracks(result))

    return make


def boxes_of(result: FilterResult, truth: Truth | None, params: EvaluationParams) -> dict[str, list[SceneBox]]:
    """Return the boxes of a filtered frame, those of its ``clusters`` and those of its ``labels``."""
    boxes, clusters = find_boxes(result.frame, [result], truth, params)
    found = []
    for one in clusters[0]:
        sides = list(zip(one["low"], one["high"], strict=True))
        center, size = [(low + high) / 2 for low, high in sides], [high - low for low, high in sides]
        found.append(SceneBox(center, size, 0.0, *_CLUSTERS[one["kind"]]))
    return {"clusters": found, "labels": [_box(one) for one in boxes]}


def _box(one: Shown) -> SceneBox:
    color, text = _BOXES[one["state"][0] if isinstance(one["state"], list) else one["state"]]
    return SceneBox(one["center"], one["size"], one["yaw"], color, text.format(one["class"]))


UNKNOWN, IS_CLUTTER, IS_TARGET, IS_IGNORED = range(4)
"""Codes for the ground truth of a point."""

_PRIORITY_SHARE = 0.75


@dataclass(frozen=True)
class Sample:
    """A frame and n of its points, with M methods.

    ``xyz``, shape (n, 3), is in metres, ``intensity``, shape (n,), in the sensor's unit, NaN if unknown. ``reasons``,
    shape (M, n), are those of each method, ``truth``, shape (n,), is `UNKNOWN`, `IS_CLUTTER`, `IS_TARGET` or
    `IS_IGNORED`. ``weight``, shape (n,), is the number of points of the frame that each point represents. Boxes,
    and the clusters of each method, are those of `find_boxes`; the water is that of the first method that knows it.
    """

    frame: int
    size: int
    valid: int
    xyz: NDArray[np.float32]
    intensity: NDArray[np.float32]
    reasons: Bytes
    truth: Bytes
    weight: NDArray[np.float32]
    boxes: list[Shown]
    clusters: list[list[Shown]]
    water: WaterState | None = None

    @property
    def range_m(self) -> Floats:
        """Distance from the lidar in metres, shape (n,)."""
        return np.asarray(np.linalg.norm(self.xyz.astype(np.float64), axis=1))


def take_sample(
    frame: Frame, results: Sequence[FilterResult | None], truth: Truth | None, params: EvaluationParams, limit: int
) -> Sample:
    """Return a sample of a frame with at most ``limit`` points.

    Points that a method keeps, that are in unconfirmed objects or that belong to a target take priority, so a buoy of
    five points stays visible among tens of thousands. Each of the two groups is subsampled evenly if it does not fit.
    """
    points = np.zeros(frame.size, np.int64) if truth is None else point_truth(frame, truth, params)
    found = [result.keep | unconfirmed(result) for result in results if result is not None]
    priority = frame.valid & np.any([(points != CLUTTER) & (points != IGNORED), *found], axis=0)
    shown, weight = _thin(np.flatnonzero(priority), np.flatnonzero(frame.valid & ~priority), limit)
    invalid = np.full(len(shown), Reason.INVALID, np.uint8)
    reasons = np.array([invalid if result is None else result.reason[shown] for result in results])
    kinds = [np.full(len(shown), truth is None), points[shown] == CLUTTER, points[shown] == IGNORED]
    shown_truth = np.select(kinds, [UNKNOWN, IS_CLUTTER, IS_IGNORED], IS_TARGET).astype(np.uint8)
    intensity = np.full(frame.size, np.nan) if frame.intensity_name is None else frame.intensity
    numbers = frame.index, frame.size, int(np.count_nonzero(frame.valid))
    xyz, bright = (values.astype(np.float32) for values in (frame.coordinates[:, shown].T, intensity[shown]))
    boxes, clusters = find_boxes(frame, results, truth, params)
    water = next((result.water for result in results if result is not None and result.water is not None), None)
    return Sample(*numbers, xyz, bright, reasons, shown_truth, weight, boxes, clusters, water)


def _thin(priority: Ints, others: Ints, limit: int) -> tuple[Ints, NDArray[np.float32]]:
    """Return the indices of at most ``limit`` points, and the number of points that each of them represents."""
    wanted = max(int(_PRIORITY_SHARE * limit), limit - len(others))
    first = _subsample(priority, wanted)
    rest = _subsample(others, limit - len(first))
    pairs = (first, priority), (rest, others)
    weights = [np.full(len(part), len(whole) / max(len(part), 1)) for part, whole in pairs]
    return np.concatenate((first, rest)), np.concatenate(weights).astype(np.float32)


def _subsample(members: Ints, count: int) -> Ints:
    """Return at most ``count`` points, chosen pseudo-randomly: every n-th point might come from the same beam."""
    if len(members) <= count:
        return members
    keys = np.arange(len(members), dtype=np.uint64) * np.uint64(2654435761) % np.uint64(2**32)
    return members[np.sort(np.argpartition(keys, count)[:count])]
