"""Which targets are detected, which clusters are false alarms (contract, "Evaluation")."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.clustering.dbscan import DbscanFinder
from seaclutter_cli.clustering.euclidean import ClusterFinder
from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.truth import CLUTTER, IGNORED, Truth

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class FrameTargets:
    """The truth of a frame in terms of its points: made once, compared with the results of any number of methods.

    Parameters
    ----------
    members : sequence of ndarray, int64
        For each target, the valid points of the unfiltered frame in its grown box; where only points are labelled,
        those that bear its track.
    expected : ndarray, shape (N,), bool
        Whether a point lies in any target or area to ignore, so that clusters there are no false alarms.
    visible : ndarray, shape (M,), bool
        Whether a target has enough points to be seen at all.
    """

    members: Sequence[NDArray[np.int64]]
    expected: Mask
    visible: Mask


@dataclass(frozen=True)
class Alarms:
    """What became of the targets of one frame.

    Parameters
    ----------
    targets, visible : int
        Targets that are labelled, and those of them with enough raw points to be seen.
    detected : int
        Visible targets that were found.
    clusters, false_alarms : int
        Clusters, and those of them that belong to no target and no area to ignore.
    """

    targets: int
    visible: int
    detected: int
    clusters: int
    false_alarms: int

    @property
    def omitted(self) -> int:
        """Visible targets that were lost."""
        return self.visible - self.detected


def targets_of(frame: Frame, truth: Truth, params: EvaluationParams) -> FrameTargets:
    """Return what is where in a frame.

    Notes
    -----
    With boxes, nothing but boxes decides, to the letter of the contract: points that bear `IGNORED` count only where
    points are all that is labelled. Boxes of areas to ignore count in both cases.
    """
    margin, valid = params.box_margin_m, frame.valid
    expected: Mask = np.asarray(truth.ignored.contains(frame.coordinates, margin).any(axis=0))
    if truth.targets is not None:
        inside = truth.targets.contains(frame.coordinates, margin)
        members = [np.flatnonzero(row & valid) for row in inside]
        expected |= inside.any(axis=0)
    elif truth.points is not None:
        members = _tracks(truth.points, valid)
        expected |= truth.points != CLUTTER
    else:
        members = []
    visible = np.array([len(points) >= params.min_visible_points for points in members], np.bool_)
    return FrameTargets(members, expected, visible)


def _tracks(points: NDArray[np.int64], valid: Mask) -> list[NDArray[np.int64]]:
    """Return the valid points of each track; a track without any is a target all the same."""
    bearing = np.flatnonzero((points != CLUTTER) & (points != IGNORED))
    order = bearing[np.argsort(points[bearing], kind="stable")]
    bounds = np.flatnonzero(np.diff(points[order])) + 1
    return [members[valid[members]] for members in np.split(order, bounds) if len(members)]


def point_truth(frame: Frame, truth: Truth, params: EvaluationParams) -> NDArray[np.int64]:
    """Return what each point is, as in `Truth.points`; where only boxes are labelled, what box it lies in.

    Targets are numbered from 1 by their order then.
    """
    if truth.points is not None:
        return truth.points
    found = np.full(frame.size, CLUTTER, np.int64)
    found[truth.ignored.contains(frame.coordinates, params.box_margin_m).any(axis=0)] = IGNORED
    if truth.targets is not None:
        for number, inside in enumerate(truth.targets.contains(frame.coordinates, params.box_margin_m), 1):
            found[inside] = number
    return found


class Finder(Protocol):
    """Finds the clusters of several subsets of the same points."""

    def clusters(self, keep: Mask, min_points: int, /) -> NDArray[np.int64]:
        """Return which cluster each point, shape (N,), belongs to; -1 for none."""
        ...


def finder_of(frame: Frame, results: Iterable[FilterResult], params: EvaluationParams) -> Finder:
    """Return what finds the clusters in any of some results for the same frame."""
    among = np.zeros(frame.size, np.bool_)
    for result in results:
        among |= result.keep
    among &= frame.valid
    if params.clustering == "dbscan":
        return DbscanFinder(frame.coordinates, among, params.cluster_tolerance_m, params.dbscan_min_points)
    return ClusterFinder(frame.coordinates, among, params.cluster_tolerance_m)


@dataclass(frozen=True)
class Matches:
    """Which clusters belong to the targets, and which targets were found.

    Parameters
    ----------
    belongs : ndarray, shape (C,), bool
        For each cluster, whether at least half of its points lie in targets or areas to ignore.
    detected : ndarray, shape (M,), bool
        For each target, whether clusters that belong to the targets put enough points into it, visible or not.
    """

    belongs: Mask
    detected: Mask


def judge(clusters: NDArray[np.int64], scene: FrameTargets, params: EvaluationParams) -> Matches:
    """Tell of each cluster of a frame if it belongs to the targets, and of each target if it was found.

    Parameters
    ----------
    clusters : ndarray, shape (N,), int64
        Cluster of each point, -1 for none.
    scene : FrameTargets
        The truth.
    params : EvaluationParams
        Limits.
    """
    clustered = clusters >= 0
    size = np.bincount(clusters[clustered])
    expected = np.bincount(clusters[clustered & scene.expected], minlength=len(size))
    belongs = np.append(2 * expected >= size, False)  # the last one is that of points in no cluster
    found = [np.count_nonzero(belongs[clusters[members]]) >= params.min_cluster_points for members in scene.members]
    return Matches(belongs[:-1], np.array(found, np.bool_))


def match(clusters: NDArray[np.int64], scene: FrameTargets, params: EvaluationParams) -> Alarms:
    """Compare the clusters of a frame with its truth.

    A cluster belongs to the targets if at least half of its points lie in targets or areas to ignore; every other one
    is a false alarm. A visible target is detected if clusters that belong to the targets put at least
    ``min_cluster_points`` points into it.

    Parameters
    ----------
    clusters : ndarray, shape (N,), int64
        Cluster of each point, -1 for none.
    scene : FrameTargets
        The truth.
    params : EvaluationParams
        Limits.
    """
    found = judge(clusters, scene, params)
    return Alarms(
        targets=len(scene.members),
        visible=int(np.count_nonzero(scene.visible)),
        detected=int(np.count_nonzero(scene.visible & found.detected)),
        clusters=len(found.belongs),
        false_alarms=len(found.belongs) - int(np.count_nonzero(found.belongs)),
    )
