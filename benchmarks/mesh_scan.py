"""Scans of `mesh_sea`: the lidar over a frame, where its rays meet the water, and their echoes."""

from typing import Any, NamedTuple

import numpy as np
from mesh_lidars import Lidar, wrapped
from mesh_parts import Array
from mesh_water import Sea
from mesh_world import Own

RINGS = np.geomspace(1.0, 130, 132).astype(np.float32)  # ranges of the water in metres


class Scan:
    """Places and rotations of the lidar by column over a frame, and its rays in the axes of the world."""

    def __init__(self, lidar: Lidar, own: Own) -> None:
        self.lidar, self.shares = lidar, (np.arange(lidar.columns) + 0.5) / lidar.columns
        place, turn = own.poses(self.shares)
        self.centre = place[lidar.columns // 2]
        self.place, self.turn = place.astype(np.float32), turn.astype(np.float32)
        self.rays = np.einsum("nij,nj->ni", self.turn[lidar.column], lidar.rays)

    def seen(self, start: Array, end: Array) -> tuple[Array, Array]:
        """Return places that move from start to end, in the axes of the lidar when it sees them, and shares then."""
        share = np.full(len(start), 0.5)
        for _ in range(2):
            column = np.minimum((share * self.lidar.columns).astype(np.int32), self.lidar.columns - 1)
            away, turn = (
                start + (end - start) * share[:, None].astype(np.float32) - self.place[column],
                self.turn[column],
            )
            x, y, z = (
                turn[:, 0, i] * away[:, 0] + turn[:, 1, i] * away[:, 1] + turn[:, 2, i] * away[:, 2] for i in range(3)
            )
            share = np.mod((self.lidar.FIRST - np.arctan2(y, x)) / (2 * np.pi), 1.0)
        return np.stack([x, y, z], -1).astype(np.float32), share

    def rings(self, column: Array) -> tuple[Array, Array, Array]:
        """Return the bearings of columns, and the places of the rings there; a turn after the last is the next."""
        at = np.minimum(column, self.lidar.columns - 1)
        level = np.arctan2(self.turn[at, 1, 0], self.turn[at, 0, 0])
        bearing = self.lidar.FIRST - column * self.lidar.step + level
        x, y = (
            self.place[at, axis : axis + 1] + way(bearing)[:, None].astype(np.float32) * RINGS
            for axis, way in ((0, np.cos), (1, np.sin))
        )
        return bearing, x, y


class Surface(NamedTuple):
    """Where the rays meet the water: range, and places in the world."""

    range_m: Array
    x: Array
    y: Array


def surface(scan: Scan, sea: Sea) -> Surface:
    """Return where rays meet the sea: at the first place that, seen from the lidar, is as high as the ray."""
    lidar, rings = scan.lidar, len(RINGS)
    bearing, x, y = scan.rings(np.arange(lidar.columns))
    height = sea.height(x, y, scan.shares[:, None], long=_long_waves(scan, sea))
    highest = np.clip((height - scan.place[:, 2:3]) / RINGS, -4.9, 3)
    highest = np.maximum.accumulate(highest, axis=1).astype(np.float64)
    level = np.hypot(scan.rays[:, 0], scan.rays[:, 1])
    slope, towards = scan.rays[:, 2] / level, np.arctan2(scan.rays[:, 1], scan.rays[:, 0])
    turned = np.round(wrapped(towards - bearing[lidar.column]) / lidar.step).astype(np.int64)
    row = (lidar.column - turned) % lidar.columns
    keys = (highest + 10.0 * np.arange(lidar.columns)[:, None]).ravel()
    cell = np.searchsorted(keys, np.clip(slope, -4.95, 4) + 10.0 * row) - row * rings
    met, outer = (cell >= 0) & (cell < rings), np.clip(cell, 1, rings - 1)
    low, high = highest[row, outer - 1], highest[row, outer]
    share = np.clip((slope - low) / np.maximum(high - low, 1e-9), 0, 1)
    away = np.where(cell == 0, RINGS[0], RINGS[outer - 1] + share * (RINGS[outer] - RINGS[outer - 1]))
    range_m = np.where(met, away / level, np.inf).astype(np.float32)
    far = np.where(met, range_m, 0)
    return Surface(range_m, *(scan.place[lidar.column, axis] + scan.rays[:, axis] * far for axis in (0, 1)))


def _long_waves(scan: Scan, sea: Sea) -> Array:
    """Return the heights of long waves on the rings, of which every fourth column is enough."""
    if sea.large.sigma <= 1e-3:
        return np.zeros(1, np.float32)
    fourth, share = np.arange(0, scan.lidar.columns + 1, 4), (np.arange(4) / 4).astype(np.float32)[None, :, None]
    _, x, y = scan.rings(fourth)
    height = sea.long_height(x, y, ((fourth + 0.5) / scan.lidar.columns)[:, None].astype(np.float32))
    return np.asarray((height[:-1, None] + (height[1:] - height[:-1])[:, None] * share).reshape(-1, len(RINGS)))


class Echoes:
    """Power, range and label of the strongest echo of each ray."""

    def __init__(self, number: int) -> None:
        self.power, self.range_m = np.zeros(number, np.float32), np.zeros(number, np.float32)
        self.label = np.zeros(number, np.int32)

    def offer(self, rays: Array, power: Array, range_m: Array, label: Any) -> None:
        """Take echoes that are stronger; of those of the same ray, the last has to be the strongest."""
        better = np.flatnonzero(power > self.power[rays])
        taken = rays[better]
        self.power[taken], self.range_m[taken] = power[better], range_m[better]
        self.label[taken] = np.broadcast_to(label, rays.shape)[better]
