"""Dynamic radius outlier removal (DROR)."""

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt, Interval
from numpy.typing import NDArray

from seaclutter_cli.filters.base import SpatialFilter
from seaclutter_cli.filters.radius import isolated
from seaclutter_cli.filters.statistical import ROUNDING


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


class DynamicRadiusOutlierRemoval(SpatialFilter):
    r"""Radius outlier removal, radius grows with range (DROR).

    Parameters
    ----------
    params : DrorParams
        Config keys of the method.

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

    def __init__(self, params: DrorParams) -> None:
        self.params = params

    def outlying(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return a mask of the outliers among points of shape (N, 3)."""
        return isolated(points, self.radius_m(points) * (1 + ROUNDING), self.params.min_points - 1)

    def radius_m(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the search radius of each point, shape (N,), in metres.

        Examples
        --------
        >>> method = DynamicRadiusOutlierRemoval(DrorParams(radius_multiplier=2.0, angle_deg=30.0, min_radius_m=3.0))
        >>> method.radius_m(np.array([[3.0, 4, 12], [0, 0, 9]])).round(6)
        array([10.,  3.])
        """
        spacing = 2 * math.sin(math.radians(self.params.angle_deg)) * np.hypot(points[:, 0], points[:, 1])
        return np.maximum(self.params.min_radius_m, self.params.radius_multiplier * spacing)
