"""Radius outlier removal (ROR)."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt
from numpy.typing import NDArray

from seaclutter_cli.filters.base import SpatialFilter
from seaclutter_cli.filters.neighbors import nth_neighbor_distance


def isolated(
    points: NDArray[np.float64],
    radius_m: float | NDArray[np.float64],
    min_neighbors: int,
    query: NDArray[np.intp] | None = None,
) -> NDArray[np.bool_]:
    """Return a mask of the isolated points: those with too few others within a radius.

    Parameters
    ----------
    points : ndarray, shape (N, 3), float64
        Finite coordinates in metres.
    radius_m : float or ndarray, shape (M,), float64
        Search radius in metres, bound included; one for all points or one per queried point.
    min_neighbors : int
        Minimum number of other points within the radius; at least 1.
    query : ndarray, shape (M,), optional
        Indices of the points to test; all N by default. Neighbours are always searched among all N points.

    Returns
    -------
    ndarray, shape (M,), bool
        True where there are fewer; True everywhere if N is ``min_neighbors`` or less.

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


class RadiusOutlierRemoval(SpatialFilter):
    """Radius outlier removal (ROR) over all valid points.

    Parameters
    ----------
    params : RorParams
        Config keys of the method.
    """

    Params: ClassVar[type[RorParams]] = RorParams

    def __init__(self, params: RorParams) -> None:
        self.params = params

    def outlying(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return a mask of the outliers among points of shape (N, 3)."""
        return isolated(points, self.params.radius_m, self.params.min_neighbors)
