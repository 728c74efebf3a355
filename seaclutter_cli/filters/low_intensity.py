"""Removal of weak, near points: of the isolated ones (LIOR), or of all of them (naive)."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt
from numpy.typing import NDArray

from seaclutter_cli.filters.base import WholeFrameFilter, valid_points
from seaclutter_cli.filters.radius import isolated
from seaclutter_cli.frame import Frame, Reason


@dataclass(frozen=True, kw_only=True)
class NaiveParams:
    """Parameters of the naive filter.

    Parameters
    ----------
    intensity_threshold : float
        Intensity below which near points are removed, in the sensor's unit.
    max_range_m : float
        Range below which weak points are removed, in metres.
    """

    intensity_threshold: float = 1.0
    max_range_m: Annotated[float, Gt(0)] = 20.0


class Naive(WholeFrameFilter):
    """One intensity threshold up to a maximum range.

    This is a baseline for other filters. A point is removed if its intensity is below the threshold and its range below
    the maximum; a point at either limit is kept. Other points have no influence.

    Parameters
    ----------
    params : NaiveParams
        Config keys of the method.
    """

    Params: ClassVar[type[NaiveParams]] = NaiveParams
    reason = Reason.LOW_INTENSITY

    def __init__(self, params: NaiveParams) -> None:
        self.params = params

    def removed(self, frame: Frame) -> NDArray[np.intp]:
        """Return the indices of the weak, near points."""
        weak = frame.intensity < self.params.intensity_threshold
        return np.flatnonzero(frame.valid & weak & (frame.range_m < self.params.max_range_m))


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


class LowIntensityOutlierRemoval(WholeFrameFilter):
    r"""Radius outlier removal of weak, near points (LIOR).

    Parameters
    ----------
    params : LiorParams
        Config keys of the method.

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

    def __init__(self, params: LiorParams) -> None:
        self.params = params

    def removed(self, frame: Frame) -> NDArray[np.intp]:
        """Return the indices of the isolated points among the weak, near ones."""
        valid, points = valid_points(frame)
        weak = frame.intensity[valid] <= self.params.intensity_threshold
        candidates = np.flatnonzero(weak & (frame.range_m[valid] <= self.params.max_range_m))
        if not len(candidates):
            return candidates
        return valid[candidates[isolated(points, self.params.radius_m, self.params.min_neighbors, candidates)]]
