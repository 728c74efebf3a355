"""What is truly in a frame: targets, areas to ignore, and, where labelled, what each point belongs to."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

CLUTTER = 0
IGNORED = 65535

OBJECT_CLASSES = (
    "ship",
    "reef",
    "shoal",
    "aquaculture",
    "seaweed",
    "island",
    "fishing fence",
    "garbage patch",
)
"""What lies in the water, seen from the air (S1). In tiles, a class is its place here, from 1; 0 is none."""


@dataclass(frozen=True)
class Boxes:
    """Upright boxes in the frame of the cloud, M of them.

    Parameters
    ----------
    tracks : tuple of str
        What tells the objects apart, from frame to frame.
    classes : tuple of str
        What they are.
    centers : ndarray, shape (M, 3), float64
        Metres.
    sizes : ndarray, shape (M, 3), float64
        Length along the box's own x, width along its y, height along z; metres.
    yaws : ndarray, shape (M,), float64
        Turn about +z in radians.
    """

    tracks: tuple[str, ...] = ()
    classes: tuple[str, ...] = ()
    centers: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    sizes: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    yaws: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    def __len__(self) -> int:
        return len(self.tracks)

    def contains(self, xyz: NDArray[np.float64], margin_m: float) -> NDArray[np.bool_]:
        """Tell which points lie in which box, grown by a margin on every side; its faces belong to it.

        Parameters
        ----------
        xyz : ndarray, shape (3, N), float64
            Points in metres. One with a coordinate that is not finite lies in no box.
        margin_m : float
            Growth on every side in metres.

        Returns
        -------
        ndarray, shape (M, N), bool

        Examples
        --------
        >>> boxes = Boxes(("1",), ("buoy",), np.zeros((1, 3)), np.array([[2.0, 1, 1]]), np.array([np.pi / 2]))
        >>> boxes.contains(np.array([[0.0, 0.9], [0.9, 0], [0, 0]]), 0)
        array([[ True, False]])
        """
        inside = np.empty((len(self), xyz.shape[1]), np.bool_)
        halves = self.sizes / 2 + margin_m
        for row, (center, half, yaw) in enumerate(zip(self.centers, halves, self.yaws, strict=True)):
            x, y, z = xyz - center[:, None]
            along = np.abs(np.cos(yaw) * x + np.sin(yaw) * y) <= half[0]
            across = np.abs(np.cos(yaw) * y - np.sin(yaw) * x) <= half[1]
            inside[row] = along & across & (np.abs(z) <= half[2])
        return inside


@dataclass(frozen=True)
class Truth:
    """What is truly in one frame.

    Parameters
    ----------
    targets : Boxes or None
        None where only the points are labelled: then a target is the points that bear its track.
    ignored : Boxes
        Areas in which clusters are neither right nor wrong.
    points : ndarray, shape (N,), int64, optional
        For each point of the frame `CLUTTER`, `IGNORED`, or the number of its target's track; None where unknown.
    """

    targets: Boxes | None
    ignored: Boxes = field(default_factory=Boxes)
    points: NDArray[np.int64] | None = None
