"""Radius outlier removal with a fixed radius (ROR), one that grows with range (DROR), and for weak points (LIOR)."""

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt, Interval
from numpy.typing import NDArray

from seaclutter_cli.filters.base import ROUNDING, WholeFrameFilter, valid_points
from seaclutter_cli.filters.neighbors import nth_neighbor_distance
from seaclutter_cli.frame import Frame


def isolated(
    points: NDArray[np.float64],
    radius_m: float | NDArray[np.float64],
    min_neighbors: int,
    query: NDArray[np.intp] | None = None,
) -> NDArray[np.bool_]:
    """Return a mask of the points, shape (N, 3), with fewer than ``min_neighbors`` others within a radius (inclusive).

    There is one radius for all points or one per point. With ``query``, the indices of M points, only these are tested,
    among all N. If N is ``min_neighbors`` or less, all are isolated.

    Examples
    --------
    >>> isolated(np.array([[0.0, 0, 0], [0, 0.5, 0], [0, 0, 2]]), 0.5, 1)
    array([False, False,  True])
    """
    if len(points) <= min_neighbors:
        return np.ones(len(points) if query is None else len(query), np.bool_)
    # At least n points are within the radius if and only if the n-th nearest is; it is much faster to find.
    return np.asarray(nth_neighbor_distance(np.ascontiguousarray(points), min_neighbors, query) > radius_m)


@dataclass(frozen=True, kw_only=True)
class RorParams:
    """Parameters of radius outlier removal.

    Parameters
    ----------
    radius_m : float
        Search radius, R, in metres.
    min_neighbors : int
        Minimum number of other points within the search radius, n.
    """

    radius_m: Annotated[float, Gt(0)] = 0.5
    min_neighbors: Annotated[int, Ge(1)] = 5


class RadiusOutlierRemoval(WholeFrameFilter[RorParams]):
    """Radius outlier removal (ROR) over all valid points."""

    Params: ClassVar[type[RorParams]] = RorParams

    def removed(self, frame: Frame) -> NDArray[np.intp]:
        """Return the indices of the outliers."""
        valid, points = valid_points(frame)
        return valid[isolated(points, self.params.radius_m, self.params.min_neighbors)]


@dataclass(frozen=True, kw_only=True)
class DrorParams:
    """Parameters of dynamic radius outlier removal.

    Parameters
    ----------
    radius_multiplier : float
        Search radius divided by twice the spacing of neighbouring points at that range, :math:`beta`.
    angle_deg : float
        Azimuth step between neighbouring points of a beam, :math:`alpha`, in degrees.
    min_radius_m : float
        Minimum search radius, :math:`r_min`, in metres.
    min_points : int
        Minimum number of points within the search radius, n, including the point itself.
    """

    radius_multiplier: Annotated[float, Gt(0)] = 3.0
    angle_deg: Annotated[float, Interval(gt=0, le=90)] = 0.16
    min_radius_m: Annotated[float, Ge(0)] = 0.04
    min_points: Annotated[int, Ge(2)] = 3


class DynamicRadiusOutlierRemoval(WholeFrameFilter[DrorParams]):
    r"""Radius outlier removal, radius grows with range (DROR).

    Notes
    -----
    A point is removed if fewer than n valid points, including itself, lie within the search radius [1]_

    .. math:: r_i = \max(r_{\min},\; 2 \beta \sin(\alpha) \sqrt{x_i^2 + y_i^2})

    of it, bound included. Equivalently, its (n - 1)-th nearest other point is farther than :math:`r_i`, so one distance
    per point is enough. If a frame has fewer than n valid points, all are removed. A distance that exceeds :math:`r_i`
    only by rounding error counts as equal. The defaults are those of the authors' launch files.

    References
    ----------
    .. [1] Charron Nicholas, Phillips Stephen, Waslander Steven L. (2018). "De-noising of Lidar Point Clouds Corrupted
       by Snowfall". 15th Conference on Computer and Robot Vision (CRV), 254-261. doi:10.1109/CRV.2018.00043
    """

    Params: ClassVar[type[DrorParams]] = DrorParams

    def removed(self, frame: Frame) -> NDArray[np.intp]:
        """Return the indices of the outliers."""
        valid, points = valid_points(frame)
        spacing = 2 * math.sin(math.radians(self.params.angle_deg)) * np.hypot(points[:, 0], points[:, 1])
        radius = np.maximum(self.params.min_radius_m, self.params.radius_multiplier * spacing)
        return valid[isolated(points, radius * (1 + ROUNDING), self.params.min_points - 1)]


@dataclass(frozen=True, kw_only=True)
class LiorParams:
    """Parameters of low-intensity outlier removal.

    Parameters
    ----------
    intensity_threshold : float
        Intensity up to which points may be removed, in the sensor's unit; bound included.
    max_range_m : float
        Range up to which points may be removed, :math:`R_snow`, in metres; bound included.
    radius_m : float
        Search radius, R, in metres.
    min_neighbors : int
        Minimum number of other points within the search radius for a point to be kept, n.
    """

    intensity_threshold: float = 5.0
    max_range_m: Annotated[float, Gt(0)] = 71.2
    radius_m: Annotated[float, Gt(0)] = 0.1
    min_neighbors: Annotated[int, Ge(1)] = 3


class LowIntensityOutlierRemoval(WholeFrameFilter[LiorParams]):
    r"""Radius outlier removal of weak, near points (LIOR).

    Notes
    -----
    A point is removed if its intensity is at most the threshold, its range at most :math:`R_{\mathrm{snow}}`, and fewer
    than n other valid points, of any intensity and range, lie within R of it, bound included [1]_. As in radius outlier
    removal, the point itself does not count; in a frame of n valid points or fewer, every point is isolated.

    References
    ----------
    .. [1] Park Ji-Il, Park Jihyuk, Kim Kyung-Soo (2020). "Fast and Accurate Desnowing Algorithm for LiDAR Point
       Clouds". IEEE Access, 8, 160202-160212. doi:10.1109/ACCESS.2020.3020266
    """

    Params: ClassVar[type[LiorParams]] = LiorParams

    def removed(self, frame: Frame) -> NDArray[np.intp]:
        """Return the indices of the isolated points among the weak, near ones."""
        valid, points = valid_points(frame)
        weak = frame.intensity[valid] <= self.params.intensity_threshold
        candidates = np.flatnonzero(weak & (frame.range_m[valid] <= self.params.max_range_m))
        if not len(candidates):
            return candidates
        return valid[candidates[isolated(points, self.params.radius_m, self.params.min_neighbors, candidates)]]
