"""Matching of clusters with the ground truth: detected targets and false alarms; overlap of boxes."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from seaclutter_cli.arrays import Floats, Ints, Mask
from seaclutter_cli.clustering import ClusterFinder, DbscanFinder
from seaclutter_cli.errors import LabelError
from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.frame import Frame
from seaclutter_cli.text import count, printable
from seaclutter_cli.truth import CLUTTER, IGNORED, Boxes, Truth

MAX_MEMBERS = 1 << 24
"""Maximum number of points in the boxes of a frame, 128 MB; a point counts once for each box."""

_CORNERS = np.array([[0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5], [0.5, -0.5]])


@dataclass(frozen=True)
class FrameTargets:
    """Ground truth of a frame with N points in terms of its points, shared by the results of all methods.

    ``members`` has, for each of M targets, the valid points of the unfiltered frame in its inflated box, or those with
    the label of its track if only points are labelled. ``expected``, shape (N,), tells whether a point is in any target
    or area to ignore, where clusters are not false alarms; ``visible``, shape (M,), whether a target has enough points.
    """

    members: Sequence[Ints]
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
    """Return the targets and the areas to ignore of a frame, in terms of its points; `LabelError` if they overlap much.

    If boxes are labelled, only boxes decide: points labelled `IGNORED` count only where no boxes of targets are
    labelled. Boxes of areas to ignore count in both cases.
    """
    margin, valid = params.box_margin_m, frame.valid
    expected = truth.ignored.covers(frame.coordinates, margin)
    members, total = list[Ints](), 0
    if truth.targets is not None:
        for inside in truth.targets.members(frame.coordinates, margin):
            expected[inside] = True
            members.append(inside[valid[inside]])
            total += len(inside)
            if total > MAX_MEMBERS:  # they would fill the memory
                boxes = f"its {len(truth.targets):,} labelled boxes overlap too much"
                text = f"{boxes}; together they contain more than {count(MAX_MEMBERS, 'point')}"
                raise LabelError(f"frame {frame.index} of {printable(frame.topic)}: {text}")
    elif truth.points is not None:
        labelled = np.flatnonzero((truth.points != CLUTTER) & (truth.points != IGNORED))
        order = labelled[np.argsort(truth.points[labelled], kind="stable")]
        tracks = np.split(order, np.flatnonzero(np.diff(truth.points[order])) + 1)
        # A track without valid points is a target, too.
        members = [points[valid[points]] for points in tracks if len(points)]
        expected |= truth.points != CLUTTER
    visible = np.array([len(points) >= params.min_visible_points for points in members], np.bool_)
    return FrameTargets(members, expected, visible)


def point_truth(frame: Frame, truth: Truth, params: EvaluationParams) -> Ints:
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


def finder_of(frame: Frame, subsets: Iterable[Mask], params: EvaluationParams) -> DbscanFinder | ClusterFinder:
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


def match_clusters(clusters: Ints, targets: FrameTargets, params: EvaluationParams) -> Matches:
    """Return which clusters belong to targets, given the cluster of each point, shape (N,), or -1, and the truth."""
    clustered = clusters >= 0
    size = np.bincount(clusters[clustered])
    expected = np.bincount(clusters[clustered & targets.expected], minlength=len(size))
    belongs = np.append(2 * expected >= size, False)  # the last entry is for points in no cluster
    found = [np.count_nonzero(belongs[clusters[members]]) >= params.min_cluster_points for members in targets.members]
    return Matches(belongs[:-1], np.array(found, np.bool_))


def match(clusters: Ints, targets: FrameTargets, params: EvaluationParams) -> Alarms:
    """Return the detections and false alarms among the clusters of a frame, given as to `match_clusters`."""
    found = match_clusters(clusters, targets, params)
    return Alarms(
        targets=len(targets.members),
        visible=int(np.count_nonzero(targets.visible)),
        detected=int(np.count_nonzero(targets.visible & found.detected)),
        clusters=len(found.belongs),
        false_alarms=len(found.belongs) - int(np.count_nonzero(found.belongs)),
    )


def overlaps(first: Boxes, second: Boxes) -> Floats:
    """Return intersection over union of each box of the first with each of the second, shape (M, K).

    Examples
    --------
    >>> box = Boxes(("1",), ("buoy",), np.zeros((1, 3)), np.array([[2.0, 2, 1]]), np.array([np.pi / 4]))
    >>> moved = Boxes(("1",), ("buoy",), np.array([[np.sqrt(2), 0, 0]]), box.sizes, box.yaws)
    >>> overlaps(box, moved).round(3), overlaps(box, box)
    (array([[0.143]]), array([[1.]]))
    """
    found = np.zeros((len(first), len(second)))
    reach = [np.hypot(*boxes.sizes[:, :2].T) / 2 for boxes in (first, second)]
    apart = np.linalg.norm(first.centers[:, None, :2] - second.centers[:, :2], axis=2)
    areas = [boxes.sizes[:, 0] * boxes.sizes[:, 1] for boxes in (first, second)]
    corners = []
    for boxes in (first, second):  # in order, shape (M, 4, 2)
        cos, sin = np.cos(boxes.yaws), np.sin(boxes.yaws)
        axes = np.stack((np.stack((cos, sin), axis=1), np.stack((-sin, cos), axis=1)), axis=1)
        corners.append((_CORNERS * boxes.sizes[:, None, :2]) @ axes + boxes.centers[:, None, :2])
    for m, k in np.argwhere(apart < reach[0][:, None] + reach[1]).tolist():
        x, y = _clipped(corners[0][m], corners[1][k]).T
        common = min(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2, areas[0][m], areas[1][k])
        found[m, k] = common / max(areas[0][m] + areas[1][k] - common, 1e-12)
    return found


def _clipped(shape: Floats, by: Floats) -> Floats:
    """Return the part of a convex polygon inside another, both anticlockwise (Sutherland and Hodgman)."""
    for start, end in zip(by, np.roll(by, -1, axis=0), strict=True):
        (dx, dy), following = end - start, np.roll(shape, -1, axis=0)
        here, there = ((points - start) @ (-dy, dx) for points in (shape, following))
        crossing = (here >= 0) != (there >= 0)
        share = np.divide(here, here - there, out=np.zeros(len(here)), where=crossing)
        met = shape + share[:, None] * (following - shape)
        corners = np.stack((shape, met), axis=1).reshape(-1, 2)
        shape = corners[np.stack((here >= 0, crossing), axis=1).ravel()]
    return shape
