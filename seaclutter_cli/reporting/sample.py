"""Sample of a frame: a subset of its points with reasons and ground truth, boxes and clusters."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.evaluation.matching import point_truth
from seaclutter_cli.frame import FilterResult, Frame, Reason, WaterState
from seaclutter_cli.reporting.boxes import Described, find_boxes, in_objects
from seaclutter_cli.truth import CLUTTER, IGNORED, Truth

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
    reasons: NDArray[np.uint8]
    truth: NDArray[np.uint8]
    weight: NDArray[np.float32]
    boxes: list[Described]
    clusters: list[list[Described]]
    water: WaterState | None = None

    @property
    def range_m(self) -> NDArray[np.float64]:
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
    priority = in_objects(frame, results) | (frame.valid & (points != CLUTTER) & (points != IGNORED))
    shown, weight = _thin(np.flatnonzero(priority), np.flatnonzero(frame.valid & ~priority), limit)
    reasons = np.full((len(results), len(shown)), Reason.INVALID, np.uint8)
    for row, result in zip(reasons, results, strict=True):
        if result is not None:
            row[:] = result.reason[shown]
    intensity = np.full(frame.size, np.nan) if frame.intensity_name is None else frame.intensity
    return Sample(
        frame.index,
        frame.size,
        int(np.count_nonzero(frame.valid)),
        frame.coordinates[:, shown].T.astype(np.float32),
        intensity[shown].astype(np.float32),
        reasons,
        _truth(points[shown], known=truth is not None),
        weight,
        *find_boxes(frame, results, truth, params),
        next((result.water for result in results if result is not None and result.water is not None), None),
    )


def _thin(
    priority: NDArray[np.int64], others: NDArray[np.int64], limit: int
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Return the indices of at most ``limit`` points, and the number of points that each of them represents."""
    wanted = max(int(_PRIORITY_SHARE * limit), limit - len(others))
    parts = [_subsample(priority, wanted)]
    parts.append(_subsample(others, limit - len(parts[0])))
    weights = [
        np.full(len(part), len(whole) / max(len(part), 1))
        for part, whole in zip(parts, (priority, others), strict=True)
    ]
    return np.concatenate(parts), np.concatenate(weights).astype(np.float32)


def _subsample(members: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Return at most ``count`` points, chosen pseudo-randomly: every n-th point might come from the same beam."""
    if len(members) <= count:
        return members
    keys = np.arange(len(members), dtype=np.uint64) * np.uint64(2654435761) % np.uint64(2**32)
    return members[np.sort(np.argpartition(keys, count)[:count])]


def _truth(points: NDArray[np.int64], *, known: bool) -> NDArray[np.uint8]:
    if not known:
        return np.full(len(points), UNKNOWN, np.uint8)
    return np.select([points == CLUTTER, points == IGNORED], [IS_CLUTTER, IS_IGNORED], IS_TARGET).astype(np.uint8)
