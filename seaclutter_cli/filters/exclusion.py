"""Own structure beyond the near limit, by boxes, polygons and a mask: the points that a filter removes first."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from annotated_types import Len
from numpy.typing import NDArray

from seaclutter_cli.frame import Frame
from seaclutter_cli.structure.mask import StructureMask

Box = tuple[float, float, float, float, float, float]
Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ExcludedPolygon:
    """An upright prism of own structure.

    Parameters
    ----------
    vertices : tuple of (x, y)
        Corners of its outline in metres in the cloud's frame, in order, at least three.
    z_min_m, z_max_m : float or None
        Limits of its height, included; null for no limit.
    """

    vertices: Annotated[tuple[tuple[float, float], ...], Len(3)]
    z_min_m: float | None = None
    z_max_m: float | None = None

    def __post_init__(self) -> None:
        """Check the limits of the height."""
        if self.z_min_m is not None and self.z_max_m is not None and self.z_min_m > self.z_max_m:
            raise ValueError(f"z_min_m ({self.z_min_m:g}) must not be greater than z_max_m ({self.z_max_m:g})")


class Exclusion:
    """The union of boxes, polygons and the sectors of a mask.

    Parameters
    ----------
    boxes : sequence of (x_min, x_max, y_min, y_max, z_min, z_max)
        Boxes, bounds included.
    polygons : sequence of ExcludedPolygon
        Polygons; whether points on an edge are inside depends on rounding.
    mask : str
        File of a mask; empty for none.

    Raises
    ------
    ConfigError
        If the mask cannot be read.
    """

    def __init__(self, boxes: Sequence[Box] = (), polygons: Sequence[ExcludedPolygon] = (), mask: str = "") -> None:
        self._boxes, self._polygons = boxes, polygons
        self._mask = StructureMask.load(Path(mask)) if mask else None

    def __bool__(self) -> bool:
        """Return whether anything is excluded."""
        return bool(self._boxes or self._polygons or self._mask)

    def contains(self, frame: Frame) -> NDArray[np.bool_]:
        """Return whether each point of a frame is own structure, shape (N,)."""
        xyz = frame.coordinates
        inside = np.zeros(frame.size, np.bool_)
        for box in self._boxes:
            low, high = np.array(box[::2])[:, None], np.array(box[1::2])[:, None]
            inside |= ((xyz >= low) & (xyz <= high)).all(axis=0)
        for polygon in self._polygons:
            inside |= _in_polygon(xyz, polygon)
        if self._mask is not None:
            inside |= self._mask.contains(xyz, frame.range_m)
        return inside


def _in_polygon(xyz: Floats, polygon: ExcludedPolygon) -> NDArray[np.bool_]:
    """Return whether points are inside: whether a ray from them crosses the outline an odd number of times."""
    corners = np.array(polygon.vertices, np.float64)
    low, high = corners.min(axis=0)[:, None], corners.max(axis=0)[:, None]
    inside = ((xyz[:2] >= low) & (xyz[:2] <= high)).all(axis=0)
    if polygon.z_min_m is not None:
        inside &= xyz[2] >= polygon.z_min_m
    if polygon.z_max_m is not None:
        inside &= xyz[2] <= polygon.z_max_m
    near = np.flatnonzero(inside)
    x, y = xyz[:2, near]
    odd = np.zeros(len(near), np.bool_)
    for (x1, y1), (x2, y2) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if y1 != y2:
            odd ^= ((y1 > y) != (y2 > y)) & (x < (x2 - x1) * (y - y1) / (y2 - y1) + x1)
    inside[near] = odd
    return np.asarray(inside)
