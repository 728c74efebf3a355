"""Statistical outlier removal (SOR), as a method and as the spatial stage of other methods."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge
from numpy.typing import NDArray

from seaclutter_cli.filters.base import SpatialFilter
from seaclutter_cli.filters.neighbors import mean_neighbor_distance

ROUNDING = 1e-9
"""Relative difference below which distances are equal; prevents outliers by rounding error in even spacing."""


def distances_and_limit(
    points: NDArray[np.float64], neighbors: int, std_ratio: float
) -> tuple[NDArray[np.float64], float]:
    r"""Return each point's mean distance to its neighbours, and the limit :math:`\mathrm{mean}(d) + m\,\sigma(d)`.

    Parameters
    ----------
    points : ndarray, shape (N, 3), float64
        Finite coordinates in metres; at least two.
    neighbors : int
        Number of nearest other points in the mean distance :math:`d_i`; N - 1 if there are fewer.
    std_ratio : float
        Number m of sample standard deviations.

    Returns
    -------
    distance : ndarray, shape (N,), float64
        Mean distance :math:`d_i` in metres.
    limit : float
        Limit in metres.

    Examples
    --------
    >>> distances_and_limit(np.array([[0.0, 0, 0], [1, 0, 0], [3, 0, 0]]), 2, 0.0)
    (array([2. , 1.5, 2.5]), 2.0)
    """
    distance = mean_neighbor_distance(np.ascontiguousarray(points), min(neighbors, len(points) - 1))
    return distance, float(distance.mean() + std_ratio * distance.std(ddof=1))


def outliers(points: NDArray[np.float64], neighbors: int, std_ratio: float) -> NDArray[np.bool_]:
    r"""Return a mask of the statistical outliers: points far from their neighbours ([Li2023], Eq. 6 and 7).

    .. math:: d_i > \lambda = \mathrm{mean}(d) + m\,\sigma(d)

    Parameters
    ----------
    points : ndarray, shape (N, 3), float64
        Finite coordinates in metres.
    neighbors : int
        Number of nearest other points in the mean distance :math:`d_i`; N - 1 if there are fewer.
    std_ratio : float
        Number m of sample standard deviations.

    Returns
    -------
    ndarray, shape (N,), bool
        True for outliers; a single point is not an outlier.

    Examples
    --------
    >>> outliers(np.array([[0.0, 0, 0], [0, 1, 0], [1, 0, 0], [9, 9, 9]]), 2, 1.0)
    array([False, False, False,  True])
    """
    if len(points) < 2:
        return np.zeros(len(points), np.bool_)
    distance, limit = distances_and_limit(points, neighbors, std_ratio)
    return np.asarray(distance > limit * (1 + ROUNDING))


@dataclass(frozen=True, kw_only=True)
class SorParams:
    """Parameters of statistical outlier removal.

    Parameters
    ----------
    neighbors : int
        Number of nearest other points in a point's mean distance, k.
    std_ratio : float
        Standard deviations above the frame's mean distance beyond which a point is an outlier, m.
    """

    neighbors: Annotated[int, Ge(1)] = 30
    std_ratio: Annotated[float, Ge(0)] = 1.0


class StatisticalOutlierRemoval(SpatialFilter):
    """Statistical outlier removal (SOR) over all valid points.

    Parameters
    ----------
    params : SorParams
        Config keys of the method.
    """

    Params: ClassVar[type[SorParams]] = SorParams

    def __init__(self, params: SorParams) -> None:
        self.params = params

    def outlying(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return a mask of the outliers among points of shape (N, 3)."""
        return outliers(points, self.params.neighbors, self.params.std_ratio)
