"""Removal of weak, near points: of those that are lonely (LIOR), and of all (naive)."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt
from numpy.typing import NDArray

from seaclutter_cli.filters.base import WholeFrameFilter, valid_points
from seaclutter_cli.filters.radius import lonely
from seaclutter_cli.frame import Frame, Reason


@dataclass(frozen=True, kw_only=True)
class NaiveParams:
    """One intensity threshold up to one range.

    Parameters
    ----------
    intensity_threshold : float
        Intensity below which points go, in the sensor's own unit.
    max_range_m : float
        Range before which points go.
    """

    intensity_threshold: float = 1.0
    max_range_m: Annotated[float, Gt(0)] = 20.0


class Naive(WholeFrameFilter):
    """Drop what is weak and near: the one-line rule that a filter must beat.

    A point goes if its intensity is below the threshold and its range below the largest; equal to either stays. Other
    points play no part.

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
    """Low-intensity outlier removal.

    Parameters
    ----------
    intensity_threshold : float
        Intensity up to which, included, points may go, in the sensor's own unit.
    max_range_m : float
        Range up to which, included, points may go, :math:`R_snow`.
    radius_m : float
        Distance within which others count, R.
    min_neighbors : int
        Others that are needed to stay, n.
    """

    intensity_threshold: float = 5.0
    max_range_m: Annotated[float, Gt(0)] = 71.2
    radius_m: Annotated[float, Gt(0)] = 0.1
    min_neighbors: Annotated[int, Ge(1)] = 3


class LowIntensityOutlierRemoval(WholeFrameFilter):
    r"""Low-intensity outlier removal (LIOR): radius outliers among weak points.

    Parameters
    ----------
    params : LiorParams
        Config keys of the method.

    Notes
    -----
    A point goes if its intensity is at most the threshold, its range at most :math:`R_{\mathrm{snow}}`, and fewer than
    n other valid points, of whatever intensity and range, lie within R of it, bounds included [1]_. As in radius
    outlier removal, the point itself does not count, and of n points or fewer none has enough others.

    References
    ----------
    .. [1] Park Ji-Il, Park Jihyuk, Kim Kyung-Soo (2020). "Fast and Accurate Desnowing Algorithm for LiDAR Point
       Clouds". IEEE Access, 8, 160202-160212. doi:10.1109/ACCESS.2020.3020266
    """

    Params: ClassVar[type[LiorParams]] = LiorParams

    def __init__(self, params: LiorParams) -> None:
        self.params = params

    def removed(self, frame: Frame) -> NDArray[np.intp]:
        """Return the indices of the weak points that are lonely."""
        valid, points = valid_points(frame)
        weak = frame.intensity[valid] <= self.params.intensity_threshold
        candidates = np.flatnonzero(weak & (frame.range_m[valid] <= self.params.max_range_m))
        if not len(candidates):
            return candidates
        return valid[candidates[lonely(points, self.params.radius_m, self.params.min_neighbors, candidates)]]
