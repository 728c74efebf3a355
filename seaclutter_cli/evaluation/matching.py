"""Matching of clusters with the ground truth: detected targets and false alarms."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.clustering import ClusterFinder, DbscanFinder
from seaclutter_cli.errors import LabelError
from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.frame import Frame
from seaclutter_cli.text import count, printable
from seaclutter_cli.truth import CLUTTER, IGNORED, Boxes, Truth

Mask = NDArray[np.bool_]

MAX_MEMBERS = 1 << 24
"""Maximum number of points in the boxes of a frame, 128 MB; a point counts once for each box."""


@dataclass(frozen=True)
class FrameTargets:
    """Ground truth of a frame with N points in terms of its points, shared by the results of all methods.

    ``members`` has, for each of M targets, the valid points of the unfiltered frame in its inflated box, or those with
    the label of its track if only points are labelled. ``expected``, shape (N,), tells whether a point is in any target
    or area to ignore, where clusters are not false alarms; ``visible``, shape (M,), whether a target has enough points.
    """

    members: Sequence[NDArray[np.int64]]
    expected: Mask
    visible: Mask


@dataclass(frozen=True)
class Alarms:
    """Counts in one frame: labelled, visible and detected targets; clusters, and those that are false alarms."""

    targets: int
    visible: int
    detected: int
    clusters: int
    false_alarms: int

    @property
    def missed(self) -> int:
        """Number of missed targets."""
        return self.visible - self.detected


def targets_of(frame: Frame, truth: Truth, params: EvaluationParams) -> FrameTargets:
    """Return the targets and the areas to ignore of a frame, in terms of its points.

    If boxes are labelled, only boxes decide: points labelled `IGNORED` count only where no boxes of targets are
    labelled. Boxes of areas to ignore count in both cases.
    """
    margin, valid = params.box_margin_m, frame.valid
    expected = truth.ignored.covers(frame.coordinates, margin)
    if truth.targets is not None:
        members = _in_boxes(frame, truth.targets, margin)
        for inside in members:
            expected[inside] = True
        members = [inside[valid[inside]] for inside in members]
    elif truth.points is not None:
        members = _tracks(truth.points, valid)
        expected |= truth.points != CLUTTER
    else:
        members = []
    visible = np.array([len(points) >= params.min_visible_points for points in members], np.bool_)
    return FrameTargets(members, expected, visible)


def _in_boxes(frame: Frame, boxes: Boxes, margin_m: float) -> list[NDArray[np.int64]]:
    """Return the points in each box; `LabelError` if so many boxes overlap that these would fill the memory."""
    members, total = [], 0
    for inside in boxes.members(frame.coordinates, margin_m):
        members.append(inside)
        total += len(inside)
        if total > MAX_MEMBERS:
            raise LabelError(
                f"frame {frame.index} of {printable(frame.topic)}: its {len(boxes):,} labelled boxes overlap too much;"
                f" together they contain more than {count(MAX_MEMBERS, 'point')}"
            )
    return members


def _tracks(points: NDArray[np.int64], valid: Mask) -> list[NDArray[np.int64]]:
    """Return the valid points of each track; a track without valid points is a target, too."""
    labelled = np.flatnonzero((points != CLUTTER) & (points != IGNORED))
    order = labelled[np.argsort(points[labelled], kind="stable")]
    bounds = np.flatnonzero(np.diff(points[order])) + 1
    return [members[valid[members]] for members in np.split(order, bounds) if len(members)]


def point_truth(frame: Frame, truth: Truth, params: EvaluationParams) -> NDArray[np.int64]:
    """Return the label of each point, as in `Truth.points`; if only boxes are labelled, derived from the boxes.

    In that case, targets are numbered from 1 in their order.
    """
    if truth.points is not None:
        return truth.points
    found = np.full(frame.size, CLUTTER, np.int64)
    found[truth.ignored.covers(frame.coordinates, params.box_margin_m)] = IGNORED
    if truth.targets is not None:
        for number, inside in enumerate(truth.targets.members(frame.coordinates, params.box_margin_m), 1):
            found[inside] = number
    return found


Finder = DbscanFinder | ClusterFinder
"""Cluster search in several subsets of the same points."""


def finder_of(frame: Frame, subsets: Iterable[Mask], params: EvaluationParams) -> Finder:
    """Return a cluster search for the valid points in any of several subsets of a frame."""
    among = np.zeros(frame.size, np.bool_)
    for subset in subsets:
        among |= subset
    among &= frame.valid
    if params.clustering == "dbscan":
        return DbscanFinder(frame.coordinates, among, params.cluster_tolerance_m, params.dbscan_min_points)
    return ClusterFinder(frame.coordinates, among, params.cluster_tolerance_m)


@dataclass(frozen=True)
class Matches:
    """Which of C clusters belong to targets, and which of M targets, visible or not, are detected.

    A cluster belongs to the targets if at least half of its points are in targets or areas to ignore; any other cluster
    is a false alarm. A target is detected if the clusters that belong to the targets have at least
    ``min_cluster_points`` in it.
    """

    belongs: Mask
    detected: Mask


def match_clusters(clusters: NDArray[np.int64], targets: FrameTargets, params: EvaluationParams) -> Matches:
    """Return which clusters belong to targets, given the cluster of each point, shape (N,), or -1, and the truth."""
    clustered = clusters >= 0
    size = np.bincount(clusters[clustered])
    expected = np.bincount(clusters[clustered & targets.expected], minlength=len(size))
    belongs = np.append(2 * expected >= size, False)  # the last entry is for points in no cluster
    found = [np.count_nonzero(belongs[clusters[members]]) >= params.min_cluster_points for members in targets.members]
    return Matches(belongs[:-1], np.array(found, np.bool_))


def match(clusters: NDArray[np.int64], targets: FrameTargets, params: EvaluationParams) -> Alarms:
    """Return the detections and false alarms among the clusters of a frame, given as to `match_clusters`."""
    found = match_clusters(clusters, targets, params)
    return Alarms(
        targets=len(targets.members),
        visible=int(np.count_nonzero(targets.visible)),
        detected=int(np.count_nonzero(targets.visible & found.detected)),
        clusters=len(found.belongs),
        false_alarms=len(found.belongs) - int(np.count_nonzero(found.belongs)),
    )
