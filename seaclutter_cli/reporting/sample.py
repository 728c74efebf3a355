"""One frame to look at: its points, thinned, with reasons, truth, boxes and clusters."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.evaluation.matching import point_truth
from seaclutter_cli.frame import FilterResult, Frame, Reason
from seaclutter_cli.reporting.objects import Described, Objects, objects_later
from seaclutter_cli.truth import CLUTTER, IGNORED, Truth

UNKNOWN, IS_CLUTTER, IS_TARGET, IS_IGNORED = range(4)
"""What a point truly is."""

_FIRST_SHARE = 0.75


@dataclass(frozen=True)
class Sample:
    """A frame to look at, n of its points.

    Parameters
    ----------
    frame : int
        Number of the frame in its topic.
    size, valid : int
        Points of the frame, and those of them that are returns.
    xyz : ndarray, shape (n, 3), float32
        Metres.
    intensity : ndarray, shape (n,), float32
        In the sensor's unit; NaN where there is none.
    reasons : ndarray, shape (methods, n), uint8
        `Reason` by each method.
    truth : ndarray, shape (n,), uint8
        `UNKNOWN`, `IS_CLUTTER`, `IS_TARGET` or `IS_IGNORED`.
    weight : ndarray, shape (n,), float32
        Points of the frame that a shown one stands for.
    find_objects : callable
        Returns what `objects_in` does; called when boxes or clusters are first asked for.
    """

    frame: int
    size: int
    valid: int
    xyz: NDArray[np.float32]
    intensity: NDArray[np.float32]
    reasons: NDArray[np.uint8]
    truth: NDArray[np.uint8]
    weight: NDArray[np.float32]
    find_objects: Callable[[], Objects]

    @cached_property
    def _objects(self) -> Objects:
        return self.find_objects()

    @property
    def boxes(self) -> list[Described]:
        """Labelled objects and areas to ignore, as `objects_in` describes them."""
        return self._objects[0]

    @property
    def clusters(self) -> list[list[Described]]:
        """Clusters of each method, likewise."""
        return self._objects[1]

    @property
    def range_m(self) -> NDArray[np.float64]:
        """Distance from the lidar in metres, shape (n,)."""
        return np.asarray(np.linalg.norm(self.xyz.astype(np.float64), axis=1))


def take_sample(
    frame: Frame, results: Sequence[FilterResult | None], truth: Truth | None, params: EvaluationParams, limit: int
) -> Sample:
    """Return what there is to see in a frame, in at most ``limit`` points.

    Points that a method keeps, or that belong to a target, come first: a buoy of five points is to be seen among tens
    of thousands. Where not all of either kind can be shown, they are thinned evenly.
    """
    points = np.zeros(frame.size, np.int64) if truth is None else point_truth(frame, truth, params)
    kept = np.zeros(frame.size, np.bool_)
    for result in results:
        if result is not None:
            kept |= result.keep
    first = frame.valid & (kept | ((points != CLUTTER) & (points != IGNORED)))
    shown, weight = _thin(np.flatnonzero(first), np.flatnonzero(frame.valid & ~first), limit)
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
        objects_later(frame, results, truth, params),
    )


def _thin(
    first: NDArray[np.int64], others: NDArray[np.int64], limit: int
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Return at most so many of the points, and how many each of them stands for."""
    wanted = max(int(_FIRST_SHARE * limit), limit - len(others))
    parts = [_evenly(first, wanted)]
    parts.append(_evenly(others, limit - len(parts[0])))
    weights = [
        np.full(len(part), len(whole) / max(len(part), 1)) for part, whole in zip(parts, (first, others), strict=True)
    ]
    return np.concatenate(parts), np.concatenate(weights).astype(np.float32)


def _evenly(members: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Return so many of the points, without a pattern: every n-th one could be all of the same beam."""
    if len(members) <= count:
        return members
    scattered = np.arange(len(members), dtype=np.uint64) * np.uint64(2654435761) % np.uint64(2**32)
    return members[np.sort(np.argpartition(scattered, count)[:count])]


def _truth(points: NDArray[np.int64], *, known: bool) -> NDArray[np.uint8]:
    if not known:
        return np.full(len(points), UNKNOWN, np.uint8)
    return np.select([points == CLUTTER, points == IGNORED], [IS_CLUTTER, IS_IGNORED], IS_TARGET).astype(np.uint8)
