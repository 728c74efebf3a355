"""Removal of the sea surface as if it were ground, by the library pypatchworkpp (extra ``peers``)."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge

from seaclutter_cli.arrays import Indices
from seaclutter_cli.errors import requiring
from seaclutter_cli.filters.base import WholeFrameFilter, valid_points
from seaclutter_cli.frame import Frame
from seaclutter_cli.params import NotNegative, Positive, Share, key


@dataclass(frozen=True, kw_only=True)
class PatchworkParams:
    """Parameters of Patchwork++; its other parameters have the values of its authors."""

    sensor_height_m: Positive = key(
        1.723,
        "Height of the lidar above the water in metres, to begin with; corrected by each frame with water near by.",
    )
    min_range_m: NotNegative = key(
        2.7, "Horizontal range at which the ground begins, in metres; nearer points are kept."
    )
    max_range_m: Positive = key(80.0, "Horizontal range at which the ground ends, in metres; farther points are kept.")
    ground_distance_m: Positive = key(
        0.125, "Distance above the plane of a patch up to which points are ground, M_d, in metres."
    )
    seed_height_m: Positive = key(
        0.125, "Height above the lowest points of a patch up to which points begin the fit of its plane, in metres."
    )
    min_points: Annotated[int, Ge(3)] = key(10, "Minimum number of points of a patch; those of others are kept.")
    uprightness: Share = key(0.707, "Least cosine of a patch's slope for its points to be ground.")

    def __post_init__(self) -> None:
        """Check the range limits."""
        if not self.min_range_m < self.max_range_m:
            raise ValueError(f"max_range_m ({self.max_range_m:g}) must be greater than min_range_m")


class Patchwork(WholeFrameFilter[PatchworkParams]):
    """Patchwork++: ground segmentation by patches, with the sea as ground.

    Notes
    -----
    Points that the library [1]_ calls ground are removed as outliers. They are passed to it from the lowest to the
    highest, so that their order in the cloud does not matter. Its removal of reflected noise is off: it only keeps
    points out of the ground, and expects intensities from 0 to 1.

    **State**: height of the lidar, and flatness and height of up to 1000 earlier patches in each of four rings.

    References
    ----------
    .. [1] Lee Seungjae, Lim Hyungtae, Myung Hyun (2022). "Patchwork++: Fast and Robust Ground Segmentation Solving
       Partial Under-Segmentation Using 3D Point Cloud". IROS, 13276-13283. doi:10.1109/IROS47612.2022.9981561
    """

    Params: ClassVar[type[PatchworkParams]] = PatchworkParams
    needs_height = True

    def __init__(self, params: PatchworkParams) -> None:
        super().__init__(params)
        self.reset()

    def reset(self) -> None:
        """Forget earlier frames; raise `MissingExtraError` if pypatchworkpp is not installed."""
        with requiring("the method patchwork", "peers"):
            import pypatchworkpp as library
        given, own = library.Parameters(), self.params
        given.enable_RNR, given.uprightness_thr, given.sensor_height = False, own.uprightness, own.sensor_height_m
        given.num_min_pts = own.min_points
        given.min_range, given.max_range = own.min_range_m, own.max_range_m
        given.th_dist, given.th_seeds = own.ground_distance_m, own.seed_height_m
        with _no_output():
            self._library = library.patchworkpp(given)

    def removed(self, frame: Frame) -> Indices:
        """Return the indices of the points that are ground."""
        valid, points = valid_points(frame)
        near = np.flatnonzero(np.abs(points).max(axis=1, initial=0) <= self.params.max_range_m)
        ordered = near[np.lexsort(points[near].T)]
        self._library.estimateGround(points[ordered].astype(np.float32))
        return valid[ordered[np.asarray(self._library.getGroundIndices(), np.intp).reshape(-1)]]


@contextmanager
def _no_output() -> Iterator[None]:
    """Discard standard output, which the library writes to when it starts; outputs of commands may go there."""
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)
