"""Division of a frame into zones: near, range rings, far, excluded, invalid. Shared by all intensity methods."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from annotated_types import Len

from seaclutter_cli.arrays import Bytes, Floats, Indices, Mask
from seaclutter_cli.frame import WATER_REASONS, Frame, Reason, Rings
from seaclutter_cli.params import NotNegative, Positive, key

Auto = Literal["auto"]
Rule = Literal["drop", "keep"]
Box = tuple[float, float, float, float, float, float]

MAX_RINGS = 250
_MAX_VERTICES = 1000
AUTO_M, LEAST_M = 10.0, 3.0
"""Ranges up to which all is own ship with ``start_m`` auto: while its extent is not known, and always."""


@dataclass(frozen=True, kw_only=True)
class ExcludedPolygon:
    """An upright prism of own structure."""

    vertices: Annotated[tuple[tuple[float, float], ...], Len(3)] = key(
        meaning="Corners of its outline in metres in the cloud's frame, in order, at least three."
    )
    z_min_m: float | None = key(None, "Limits of its height, included; null for no limit.")
    z_max_m: float | None = key(None, "Limits of its height, included; null for no limit.")

    def __post_init__(self) -> None:
        """Check the limits of the height."""
        if self.z_min_m is not None and self.z_max_m is not None and self.z_min_m > self.z_max_m:
            raise ValueError(f"z_min_m ({self.z_min_m:g}) must not be greater than z_max_m ({self.z_max_m:g})")


@dataclass(frozen=True, kw_only=True)
class ZoneParams:
    """Range limits, and the treatment of points outside them."""

    start_m: NotNegative | Auto = key(
        10.0,
        "Range at which clutter removal begins, d_s, in metres; nearer points are own ship. auto: from where own ship "
        "ends in each direction, at least 3 m; 10 m until 20 frames have shown that.",
    )
    end_m: Positive = key(70.0, "Range at which clutter removal ends, d_e, in metres; clutter is rare beyond it.")
    near: Rule = key("drop", "Drop or keep points nearer than start_m.")
    far: Rule = key("keep", "Drop or keep points at end_m and beyond.")
    exclude_boxes: tuple[Box, ...] = key(
        (),
        "Boxes of own structure to remove, each [x_min, x_max, y_min, y_max, z_min, z_max] in metres in the cloud's "
        "frame, bounds included; they take precedence over near and far.",
    )
    exclude_polygons: tuple[ExcludedPolygon, ...] = key(
        (),
        "Outlines of own structure to remove, each {vertices: [[x, y], ...], z_min_m: null, z_max_m: null} in metres "
        "in the cloud's frame.",
    )
    mask: str = key(
        "",
        "File of a mask of own structure: a table as seaclutter mask writes it, or a PNG image that is dark where "
        "structure is, of the height and width of the clouds, or of rings, the uppermost first, by azimuths 180° to "
        "-180°; empty for none.",
    )

    @property
    def own_ship_m(self) -> float:
        """Range up to which points are own ship while its extent is not known: ``start_m``, or 10 m for auto."""
        return AUTO_M if self.start_m == "auto" else self.start_m

    @property
    def edges(self) -> Floats:
        """Edges of the range rings in metres, shape (K + 1,); here a single one from ``start_m`` to ``end_m``."""
        return self.from_start(np.array([self.own_ship_m, self.end_m], np.float64))

    def from_start(self, edges: Floats) -> Floats:
        """Return edges of range rings, the first at 0 if ``start_m`` is auto: it begins where own ship ends."""
        return np.append(0.0, edges[1:]) if self.start_m == "auto" else edges

    def __post_init__(self) -> None:
        """Check the range limits, boxes and polygons."""
        vertices = sum(len(polygon.vertices) for polygon in self.exclude_polygons)
        if vertices > _MAX_VERTICES:
            raise ValueError(f"exclude_polygons has {vertices:,} vertices; at most {_MAX_VERTICES:,} are possible")
        if not self.own_ship_m < self.end_m:
            raise ValueError(f"end_m ({self.end_m:g}) must be greater than start_m ({self.own_ship_m:g})")
        for number, box in enumerate(self.exclude_boxes, 1):
            if any(low > high for low, high in zip(box[::2], box[1::2], strict=True)):
                raise ValueError(f"exclude_boxes: box {number} has a minimum greater than its maximum")


def ring_edges(start_m: float, end_m: float, width_m: float) -> Floats:
    """Return the edges of the range rings in metres, shape (K + 1,); the last ring ends at ``end_m`` ([Li2023], Eq. 3).

    Examples
    --------
    >>> ring_edges(10.0, 70.0, 15.0)
    array([10., 25., 40., 55., 70.])
    >>> ring_edges(10.0, 50.0, 15.0)
    array([10., 25., 40., 50.])
    """
    # A quotient such as 3.0000000000000004 means three range rings plus a rounding error.
    rings = (end_m - start_m) / width_m - 1e-9
    if rings > MAX_RINGS:
        found = f"{np.ceil(rings):.12g} range rings"
        raise ValueError(f"ring_width_m ({width_m:g}) gives {found}; the maximum is {MAX_RINGS}")
    return np.append(start_m + np.arange(max(1, math.ceil(rings))) * width_m, end_m)


class Zones:
    """Zone numbers of points: 0 near, 1 to K the range rings, then far, excluded, invalid.

    ``own_ship`` is None unless its end is searched: with an estimate of the water of its own, or with the filter's.
    """

    def __init__(self, params: ZoneParams, *, finds_water: bool = True) -> None:
        self._finds_water = finds_water
        self.edges = params.edges
        self.count = len(self.edges) - 1
        self._exclusion = Exclusion(params.exclude_boxes, params.exclude_polygons, params.mask)
        near = Reason.NEAR if params.near == "drop" else Reason.KEPT
        far = Reason.FAR if params.far == "drop" else Reason.KEPT
        reasons = [near, *[Reason.KEPT] * self.count, far, Reason.EXCLUDED, Reason.INVALID]
        self._reason = np.array(reasons, np.uint8)
        self.own_ship = None
        if params.start_m == "auto":
            from seaclutter_cli.structure.own_ship import OwnShip  # not needed otherwise

            self.own_ship = OwnShip(params.own_ship_m, LEAST_M, getattr(params, "mounting", None))

    def reset(self) -> None:
        """Forget where own ship ends."""
        if self.own_ship is not None:
            self.own_ship.reset()

    def divide(self, frame: Frame) -> tuple[Bytes, Bytes]:
        """Return the zone of each point and the reason that follows from it, both of shape (N,)."""
        # Range ring k spans [d_s + (k - 1) d, d_s + k d), so a zone is the number of edges at or below the range.
        zone = np.zeros(frame.size, np.uint8)
        for edge in self.edges:
            zone += (frame.range_m >= edge).view(np.uint8)
        if self.own_ship is not None:
            self.own_ship.add(frame, finds_water=self._finds_water)
            zone[self.own_ship.contains(frame)] = 0
        zone[self._exclusion.contains(frame)] = self.count + 2
        zone[~frame.valid] = self.count + 3
        return zone, self._reason[zone]

    def members(self, zone: Bytes, keep: Mask) -> list[Indices]:
        """Return the indices of the points to keep in each range ring."""
        in_rings = np.flatnonzero(keep & (zone >= 1) & (zone <= self.count))
        ring = zone[in_rings]
        return [in_rings[ring == k] for k in range(1, self.count + 1)]

    def per_point(self, values: Floats, zone: Bytes) -> Floats:
        """Return the value of each point's range ring, shape (N,); minus infinity outside the range rings."""
        outside = [-np.inf]
        return np.concatenate((outside, values, outside * 3))[zone]

    def rings(self, zone: Bytes, reason: Bytes, thresholds: Floats, corrections: Floats | None = None) -> Rings:
        """Return thresholds and counts of the range rings; unconfirmed and mirrored points count as outliers."""
        each = np.bincount(zone * np.intp(len(Reason)) + reason, minlength=(self.count + 4) * len(Reason))
        counts, far = np.split(each.reshape(-1, len(Reason))[1 : self.count + 2], [self.count])
        used = np.zeros(self.count) if corrections is None else corrections
        outliers = counts[:, [Reason.OUTLIER, *WATER_REASONS]].sum(axis=1)
        beyond = np.array([far.sum(), far[0, Reason.KEPT]])
        low = counts[:, Reason.LOW_INTENSITY].copy()
        return Rings(thresholds.copy(), used, counts.sum(axis=1), low, outliers, beyond)


class Exclusion:
    """The union of boxes, polygons and the sectors of the mask in a file, if it is named.

    The bounds of boxes are included; whether points on an edge of a polygon are inside depends on rounding. Raises
    `ConfigError` if the mask cannot be read.
    """

    def __init__(self, boxes: Sequence[Box] = (), polygons: Sequence[ExcludedPolygon] = (), mask: str = "") -> None:
        self._boxes, self._polygons = boxes, polygons
        self._mask = None
        if mask:
            from seaclutter_cli.structure.mask import load_mask  # most configurations have none

            self._mask = load_mask(Path(mask))

    def contains(self, frame: Frame) -> Mask:
        """Return whether each point of a frame is own structure, shape (N,)."""
        xyz = frame.coordinates
        inside = np.zeros(frame.size, np.bool_)
        for box in self._boxes:
            low, high = np.array(box[::2])[:, None], np.array(box[1::2])[:, None]
            inside |= ((xyz >= low) & (xyz <= high)).all(axis=0)
        for polygon in self._polygons:
            inside |= _in_polygon(xyz, polygon)
        if self._mask is not None:
            inside |= self._mask.covers(frame)
        return inside


def _in_polygon(xyz: Floats, polygon: ExcludedPolygon) -> Mask:
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
