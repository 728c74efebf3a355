"""Ground truth of a frame: boxes of targets, areas to ignore, and labels of points."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

CLUTTER = 0
IGNORED = 65535
_ROUNDING = 1e-9

OBJECT_CLASSES = ("ship", "reef", "shoal", "aquaculture", "seaweed", "island", "fishing fence", "garbage patch")
"""Classes of objects in airborne tiles [Shi2022]. Tiles store a class as its index here plus 1; 0 means no class."""


@dataclass(frozen=True)
class Boxes:
    """M upright boxes in the coordinate frame of the cloud.

    ``tracks`` identify the objects from frame to frame. Centres and sizes, shape (M, 3), are in metres; a size is the
    length along the box's own x, the width along its y, and the height. Yaws, shape (M,), are around +z in radians.
    """

    tracks: tuple[str, ...] = ()
    classes: tuple[str, ...] = ()
    centers: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    sizes: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    yaws: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    def __len__(self) -> int:
        return len(self.tracks)

    def chosen(self, rows: NDArray[np.int64]) -> "Boxes":
        """Return the boxes with these indices."""
        tracks, classes = (tuple(names[row] for row in rows.tolist()) for names in (self.tracks, self.classes))
        return Boxes(tracks, classes, self.centers[rows], self.sizes[rows], self.yaws[rows])

    def covers(self, xyz: NDArray[np.float64], margin_m: float) -> NDArray[np.bool_]:
        """Return which points are inside any box, shape (N,); arguments as for `members`.

        Examples
        --------
        >>> boxes = Boxes(("1",), ("buoy",), np.zeros((1, 3)), np.array([[2.0, 1, 1]]), np.array([np.pi / 2]))
        >>> boxes.covers(np.array([[0.0, 0.9], [0.9, 0], [0, 0]]), 0)
        array([ True, False])
        """
        covered = np.zeros(xyz.shape[1], np.bool_)
        for members in self.members(xyz, margin_m):
            covered[members] = True
        return covered

    def members(self, xyz: NDArray[np.float64], margin_m: float) -> Iterator[NDArray[np.int64]]:
        """Yield the indices of those of N points, shape (3, N), that are inside each box.

        Boxes are inflated by a margin on every side, and faces count as inside. A point with a non-finite coordinate is
        in no box.
        """
        halves = self.sizes / 2 + margin_m
        for center, half, yaw in zip(self.centers, halves, self.yaws, strict=True):
            reach = np.hypot(half[0], half[1]) * (1 + _ROUNDING)
            near = np.flatnonzero(np.abs(xyz[0] - center[0]) <= reach)
            x, y, z = xyz[:, near] - center[:, None]
            along = np.abs(np.cos(yaw) * x + np.sin(yaw) * y) <= half[0]
            across = np.abs(np.cos(yaw) * y - np.sin(yaw) * x) <= half[1]
            yield near[along & across & (np.abs(z) <= half[2])]


@dataclass(frozen=True)
class Truth:
    """Ground truth of one frame.

    Targets are None if only points are labelled; a target then consists of the points with its track number. Clusters
    in areas to ignore count neither as detections nor as false alarms. ``points``, shape (N,), are `CLUTTER`, `IGNORED`
    or the track number of its target for each point of the frame; None if unknown. So many of the labels are as the
    program ``proposed`` them.
    """

    targets: Boxes | None
    ignored: Boxes = field(default_factory=Boxes)
    points: NDArray[np.int64] | None = None
    proposed: int = 0
