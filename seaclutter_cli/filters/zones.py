"""Division of a frame by range: near, rings, far; and what is excluded or invalid. Shared by all intensity methods."""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt
from numpy.typing import NDArray

from seaclutter_cli.frame import Frame, Reason

Box = tuple[float, float, float, float, float, float]
Rule = Literal["drop", "keep"]

MAX_RINGS = 250


@dataclass(frozen=True, kw_only=True)
class ZoneParams:
    """Where the method works, and what happens outside.

    Parameters
    ----------
    start_m : float
        Range at which it begins, :math:`d_s`; nearer is the own vessel.
    end_m : float
        Range at which it ends, :math:`d_e`; clutter is rare beyond.
    near, far : {"drop", "keep"}
        What happens to points before and beyond.
    exclude_boxes : tuple of (x_min, x_max, y_min, y_max, z_min, z_max)
        Own structure beyond ``start_m``, in metres in the cloud's frame, bounds included; removed first.
    """

    start_m: Annotated[float, Ge(0)] = 10.0
    end_m: Annotated[float, Gt(0)] = 70.0
    near: Rule = "drop"
    far: Rule = "keep"
    exclude_boxes: tuple[Box, ...] = ()

    @property
    def edges(self) -> NDArray[np.float64]:
        """Edges of the rings in metres, shape (K + 1,); here of one from ``start_m`` to ``end_m``."""
        return np.array([self.start_m, self.end_m], np.float64)

    def __post_init__(self) -> None:
        """Check that the limits and boxes are in order."""
        if not self.start_m < self.end_m:
            raise ValueError(f"end_m ({self.end_m:g}) must be greater than start_m ({self.start_m:g})")
        for number, box in enumerate(self.exclude_boxes, 1):
            if any(low > high for low, high in zip(box[::2], box[1::2], strict=True)):
                raise ValueError(f"exclude_boxes: in box {number} a minimum is greater than its maximum")


def ring_edges(start_m: float, end_m: float, width_m: float) -> NDArray[np.float64]:
    """Return the edges of the rings, shape (K + 1,), in metres (S0, Eq. 3); the last ring is cut at ``end_m``.

    Examples
    --------
    >>> ring_edges(10.0, 70.0, 15.0)
    array([10., 25., 40., 55., 70.])
    >>> ring_edges(10.0, 50.0, 15.0)
    array([10., 25., 40., 50.])
    """
    # A quotient such as 3.0000000000000004 is three rings and a rounding error.
    count = max(1, math.ceil((end_m - start_m) / width_m - 1e-9))
    if count > MAX_RINGS:
        raise ValueError(f"ring_width_m ({width_m:g}) makes {count} rings, at most {MAX_RINGS} are possible")
    return np.append(start_m + np.arange(count) * width_m, end_m)


class Zones:
    """Zone numbers of points: 0 near, 1 to K the rings, then far, excluded, invalid.

    Parameters
    ----------
    params : ZoneParams
        Limits, rings and rules.
    """

    def __init__(self, params: ZoneParams) -> None:
        self.edges = params.edges
        self.count = len(self.edges) - 1
        self._boxes = params.exclude_boxes
        near = Reason.NEAR if params.near == "drop" else Reason.KEPT
        far = Reason.FAR if params.far == "drop" else Reason.KEPT
        reasons = [near, *[Reason.KEPT] * self.count, far, Reason.EXCLUDED, Reason.INVALID]
        self._reason = np.array(reasons, np.uint8)

    def divide(self, frame: Frame) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Return each point's zone and the reason that follows from it, both of shape (N,)."""
        # Ring k holds r in [d_s + (k - 1) d, d_s + k d): the number of edges that r has reached.
        zone = np.zeros(frame.size, np.uint8)
        for edge in self.edges:
            zone += (frame.range_m >= edge).view(np.uint8)
        for box in self._boxes:
            zone[_inside(frame.coordinates, box)] = self.count + 2
        zone[~frame.valid] = self.count + 3
        return zone, self._reason[zone]

    def members(self, zone: NDArray[np.uint8], keep: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
        """Return the indices of each ring's points that are kept."""
        in_rings = np.flatnonzero(keep & (zone >= 1) & (zone <= self.count))
        ring = zone[in_rings]
        return [in_rings[ring == k] for k in range(1, self.count + 1)]

    def per_point(self, values: NDArray[np.float64], zone: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Return each point's ring value, shape (N,); minus infinity for points in no ring."""
        outside = [-np.inf]
        return np.concatenate((outside, values, outside * 3))[zone]

    def tally(self, zone: NDArray[np.uint8]) -> NDArray[np.int64]:
        """Count points in each ring, shape (K,)."""
        return np.bincount(zone, minlength=self.count + 4)[1 : self.count + 1]


def _inside(xyz: NDArray[np.float64], box: Box) -> NDArray[np.bool_]:
    low, high = np.array(box[::2])[:, None], np.array(box[1::2])[:, None]
    return np.asarray(((xyz >= low) & (xyz <= high)).all(axis=0))
