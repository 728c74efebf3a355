"""Radius outlier removal (ROR)."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt
from numpy.typing import NDArray

from seaclutter_cli.filters.base import SpatialFilter
from seaclutter_cli.filters.neighbors import nth_neighbor_distance


def lonely(
    points: NDArray[np.float64],
    radius_m: float | NDArray[np.float64],
    min_neighbors: int,
    of: NDArray[np.intp] | None = None,
) -> NDArray[np.bool_]:
    """Tell which points have too few others near them.

    Parameters
    ----------
    points : ndarray, shape (N, 3), float64
        Finite coordinates in metres.
    radius_m : float or ndarray, shape (M,), float64
        Distance up to which, included, another point counts; one for all or one for each point asked for.
    min_neighbors : int
        Other points that are needed; at least 1.
    of : ndarray, shape (M,), optional
        Indices of the points asked for; all N by default. The others are neighbours all the same.

    Returns
    -------
    ndarray, shape (M,), bool
        True where there are fewer; everywhere if there are not so many others at all.

    Examples
    --------
    >>> lonely(np.array([[0.0, 0, 0], [0, 0.5, 0], [0, 0, 2]]), 0.5, 1)
    array([False, False,  True])
    """
    if len(points) <= min_neighbors:
        return np.ones(len(points) if of is None else len(of), np.bool_)
    # The n-th nearest lies within the radius exactly where at least n do, and costs much less to find.
    return np.asarray(nth_neighbor_distance(np.ascontiguousarray(points), min_neighbors, of) > radius_m)


@dataclass(frozen=True, kw_only=True)
class RorParams:
    """Radius outlier removal.

    Parameters
    ----------
    radius_m : float
        Distance within which others count, R.
    min_neighbors : int
        Others that are needed, n.
    """

    radius_m: Annotated[float, Gt(0)] = 0.5
    min_neighbors: Annotated[int, Ge(1)] = 5


class RadiusOutlierRemoval(SpatialFilter):
    """Radius outlier removal (ROR) over all valid points of a frame.

    Parameters
    ----------
    params : RorParams
        Config keys of the method.
    """

    Params: ClassVar[type[RorParams]] = RorParams

    def __init__(self, params: RorParams) -> None:
        self.params = params

    def outlying(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Tell which of some points, shape (N, 3), are outliers."""
        return lonely(points, self.params.radius_m, self.params.min_neighbors)
