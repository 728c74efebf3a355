"""Search for own ship's structure: what returns in the same direction at the same range while the scene changes."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Floats, Indices, Ints, Mask
from seaclutter_cli.frame import Frame
from seaclutter_cli.structure.mask import Sector, StructureMask, azimuth_deg, elevation_deg
from seaclutter_cli.water import Faces, Mounting, WaterSurface, WaterTracker

MIN_FRAMES = 20
_MOST_FRAMES = 2**32 - 1
_STEP_M = 0.08
"""Depth of a cell; a structure returns within two of them."""
_MARGIN_M = 0.1
_STRONG, _WEAK = 0.8, 0.25
"""Shares of the frames in which a cell returns: of structure, and of its edges."""
_ABOVE_WATER_M = 0.3
_FAR_STEP_M, _FAR_M = 1.0, 100.0
_HIGH_M = 1.0
_MIN_FAR_CELLS = 20
_AT_REST = 0.25
_DECIMALS = 3
_BESIDE_BINS = 13
_GOES_ON, _MOST_ONGOING = 0.15, 0.3
"""Share of the frames in which a wall returns beside a part of it, and share of a part's borders at which it may."""
_AZIMUTH_STEP_DEG = 1.0
_COLUMNS = round(360 / _AZIMUTH_STEP_DEG)
_ELEVATION_STEP_DEG = 1.0
_MAX_RINGS = 1024
_MIN_BEAMS = 2
_SAME_DEG = 0.02
_GAP_DEG = 0.15
_MIN_SHARE, _MOST_SPREAD_DEG = 0.002, 0.3


@dataclass(frozen=True)
class BeamGrid:
    """Rows of elevation by columns of 1° of azimuth; ``edges_deg``, shape (R + 1,), are ascending limits of rows.

    ``beams_deg`` are the elevations of the beams, ascending; None if they are not known.
    """

    edges_deg: Floats
    beams_deg: Floats | None = None

    @classmethod
    def of(cls, frame: Frame) -> Self:
        """Return the grid by the beams of a frame, if the field of the ring or gaps show them; otherwise rows of 1°."""
        elevation = elevation_deg(frame.coordinates[:, frame.valid], frame.range_m[frame.valid])
        beams = _numbered_beams(frame, elevation)
        if beams is None:
            beams = _parted_beams(elevation)
        if beams is not None:
            middle = (beams[1:] + beams[:-1]) / 2
            first, last = 2 * beams[0] - middle[0], 2 * beams[-1] - middle[-1]
            return cls(np.concatenate(([first], middle, [last])), beams)
        first, last = np.floor(elevation.min()) - 1, np.ceil(elevation.max()) + 1
        return cls(np.arange(first, last + _ELEVATION_STEP_DEG, _ELEVATION_STEP_DEG))

    @property
    def rows(self) -> int:
        """Number of rows, R."""
        return len(self.edges_deg) - 1

    @property
    def size(self) -> int:
        """Number of directions."""
        return self.rows * _COLUMNS

    @property
    def centers(self) -> Floats:
        """Unit vectors to the centres of all directions, shape (3, size)."""
        elevation = np.radians((self.edges_deg[1:] + self.edges_deg[:-1]) / 2)[:, None]
        azimuth = np.radians(-180 + (np.arange(_COLUMNS) + 0.5) * _AZIMUTH_STEP_DEG)
        flat = np.cos(elevation)
        parts = (flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation) + 0 * azimuth)
        return np.stack([part.reshape(-1) for part in parts])

    def directions(self, frame: Frame) -> Ints:
        """Return the direction of each valid point of a frame; points outside the rows have that of the nearest."""
        xyz = frame.coordinates[:, frame.valid]
        elevation = elevation_deg(xyz, frame.range_m[frame.valid])
        row = np.clip(np.searchsorted(self.edges_deg, elevation, "right") - 1, 0, self.rows - 1)
        column = np.clip(((azimuth_deg(xyz) + 180) / _AZIMUTH_STEP_DEG).astype(np.int64), 0, _COLUMNS - 1)
        return np.asarray(row * _COLUMNS + column, np.int64)


@dataclass(frozen=True)
class FoundStructure:
    """Result of a search over a number of frames.

    ``constant`` is what is constant, ``directions`` the number of directions in which the lidar measures, ``at_rest``
    the share of the returns farther away that are constant as well; None if there are too few to tell.
    """

    constant: StructureMask
    frames: int
    directions: int
    at_rest: float | None

    @property
    def mask(self) -> StructureMask:
        """What is constant, unless the vessel is at rest: a quay would be, too."""
        return StructureMask(()) if self.is_at_rest else self.constant

    @property
    def share(self) -> float:
        """Share of the directions in which the lidar measures that the mask occupies."""
        return len(self.mask.sectors) / max(self.directions, 1)

    @property
    def is_at_rest(self) -> bool:
        """Whether so much of the surroundings is constant that the vessel did not move."""
        return self.at_rest is not None and self.at_rest >= _AT_REST


class StructureSearch:
    """Counter of the frames in which each cell of direction and range, up to ``reach_m``, returns.

    The water is level in the frame of the ``mounting``, by default about that of the cloud. No more than
    ``most_frames`` are added; if they are few, the counter takes less memory.

    1. *Cells*: beam (a ring, or 1° of elevation), 1° of azimuth, 8 cm of range. Two neighbours in range count as one,
       so that noise across a border does not matter.
    2. *Structure*: cells that return in at least 80 % of the frames and touch another such cell; and around them, those
       that return in 25 %, which are the edges.
    3. *Water* of a calm day returns at constant ranges as well, so cells less than 0.3 m above the mean water do not
       count.
    4. *Walls* that the vessel passes are constant where the beams meet them squarely. They go on beside that, at ranges
       that change; own structure ends. Parts that go on are left out.
    5. *Rest*: if at least a quarter of the cells farther away and well above the water are as constant (within 1 m),
       the vessel did not move. What is constant may then be a quay.
    """

    def __init__(self, reach_m: float, mounting: Mounting | None = None, most_frames: int = _MOST_FRAMES) -> None:
        self._reach_m, self.frames, self._dtype = reach_m, 0, np.min_scalar_type(most_frames)
        self._mounting = mounting or Mounting()
        self._bins = int(np.ceil(reach_m / _STEP_M))
        self._far_bins = int(np.ceil((_FAR_M - reach_m) / _FAR_STEP_M)) if reach_m < _FAR_M else 0
        self._grid: BeamGrid | None = None
        self._water, self._planes = WaterTracker(), np.zeros(4)
        self.bodies: Indices = np.empty(0, np.intp)
        """Points of the last frame that stand out of the water; none without water."""
        self.surface: WaterSurface | None = None
        """Water of the last frame."""

    def add(self, frame: Frame, *, finds_water: bool = True) -> None:
        """Add a frame; unless it ``finds_water`` itself, the water is what `see` is told."""
        if self._grid is None:
            if not frame.valid.any():
                return
            self._grid = BeamGrid.of(frame)
            directions = self._grid.size
            self._counts = np.zeros((directions, self._bins), self._dtype)
            self._far = np.zeros((directions, self._far_bins), self._dtype)
        self.frames += 1
        range_m, direction = frame.range_m[frame.valid], self._grid.directions(frame)
        _count(self._counts, direction, range_m / _STEP_M)
        _count(self._far, direction, (range_m - self._reach_m) / _FAR_STEP_M)
        if not finds_water:
            return
        xyz = frame.coordinates if frame.valid.all() else frame.coordinates[:, frame.valid]
        level = self._mounting.levelled(xyz)
        faces = Faces.of(level)
        surface = self._water.step(level, faces, frame.stamp_ns / 1e9)
        self.see(surface)
        self.bodies = np.empty(0, np.intp)
        if surface is not None:
            self.bodies = np.flatnonzero(frame.valid)[faces.stands(surface.plane.height(*level[:2]), surface.sigma_m)]

    def see(self, surface: WaterSurface | None) -> None:
        """Receive the water of the frame added last, in the levelled frame."""
        self.surface = surface
        if surface is not None:
            plane = surface.plane
            self._planes += (1, plane.slope_x, plane.slope_y, plane.level_m)

    @property
    def level_m(self) -> float | None:
        """Mean height of the water at the lidar in metres; None without water."""
        number, *_, level_m = self._planes.tolist()
        return level_m / number if number else None

    @property
    def beams_deg(self) -> Floats | None:
        """Elevations of the beams, ascending; None while they are not known."""
        return None if self._grid is None else self._grid.beams_deg

    def found(self) -> FoundStructure:
        """Return what the frames so far show."""
        if self._grid is None or self.frames < MIN_FRAMES:
            return FoundStructure(StructureMask(()), self.frames, 0, None)
        seen = int(np.count_nonzero(self._counts.any(axis=1) | self._far.any(axis=1)))
        sectors = self._sectors(self._grid)
        return FoundStructure(StructureMask(tuple(sectors)), self.frames, seen, self._rest(self._grid))

    def _sectors(self, grid: BeamGrid) -> list[Sector]:
        constant = self._counts.max(axis=1) >= _STRONG * self.frames
        rows = np.flatnonzero(constant.reshape(grid.rows, _COLUMNS).any(axis=1))
        if not len(rows):
            return []
        first, end = max(int(rows[0]) - 1, 0), int(rows[-1]) + 2
        part = BeamGrid(grid.edges_deg[first : end + 1])
        counts = self._counts.reshape(grid.rows, _COLUMNS, self._bins)[first:end]
        share = (counts / np.float32(self.frames)).astype(np.float32)
        height = self._height(part, (np.arange(self._bins) + 0.5) * _STEP_M)
        share[height.reshape(share.shape) < _ABOVE_WATER_M] = 0
        parts = _connected(share >= _STRONG, share >= _WEAK)
        parts[~_ends_within(parts, share)[parts]] = 0
        return _sectors(part, parts > 0)

    def _height(self, grid: BeamGrid, range_m: NDArray[np.floating]) -> NDArray[np.float32]:
        """Return the height above the mean water of each direction and range; infinite without water."""
        number, *sums = self._planes
        if not number:
            return np.full((grid.size, len(range_m)), np.inf, np.float32)
        slope_x, slope_y, level_m = np.array(sums) / number
        x, y, z = self._mounting.levelled(grid.centers)
        rise = (z - slope_x * x - slope_y * y).astype(np.float32)
        return np.asarray(rise[:, None] * range_m.astype(np.float32) - np.float32(level_m))

    def _rest(self, grid: BeamGrid) -> float | None:
        """Return the share of the cells beyond the reach, well above the water, that are constant."""
        range_m = self._reach_m + (np.arange(self._far_bins) + 0.5) * _FAR_STEP_M
        high = self._height(grid, range_m) >= _HIGH_M
        frames = float(self._far[high].sum()) / self.frames  # the mean number of cells that return in a frame
        if frames < _MIN_FAR_CELLS:
            return None
        constant = float(self._far[high & (self._far >= _STRONG * self.frames)].sum()) / self.frames
        return constant / frames


def _count(counts: NDArray[np.unsignedinteger], direction: Ints, depth: Floats) -> None:
    """Count each cell that has a return in a frame, together with the cell before it, once."""
    cells = counts.shape[1]
    with np.errstate(invalid="ignore"):
        inside = (depth >= 0) & (depth < cells)
    flat = direction[inside] * cells + depth[inside].astype(np.int64)
    before = flat[flat % cells > 0] - 1
    counts.reshape(-1)[np.unique(np.concatenate((flat, before)))] += 1


def _connected(strong: Mask, weak: Mask) -> NDArray[np.int32]:
    """Return the part of each weak cell, (rows, columns, bins), from 1 if connected to strong ones; else 0."""
    from scipy import ndimage  # slow to import, not needed before

    wide = np.concatenate((weak, weak[:, :1]), axis=1)  # the first column again behind the last: they touch at 180°
    parts, number = ndimage.label(wide, np.ones((3, 3, 3)))
    keep = np.zeros(number + 1, np.bool_)
    keep[parts[:, :-1][_seeds(strong)]] = True
    first, again = parts[:, 0], parts[:, -1]
    for _ in range(2):
        np.logical_or.at(keep, first, keep[again])  # one part may touch several
        np.logical_or.at(keep, again, keep[first])
    return np.where(keep[parts], parts, 0)[:, :-1]


def _seeds(strong: Mask) -> Mask:
    """Return the strong cells that touch others in other directions: in the same one, noise alone makes neighbours."""
    deep = strong.copy()
    deep[..., 1:] |= strong[..., :-1]
    deep[..., :-1] |= strong[..., 1:]
    beside = np.roll(deep, 1, axis=1) | np.roll(deep, -1, axis=1)
    around = beside | deep
    beside[1:] |= around[:-1]
    beside[:-1] |= around[1:]
    return strong & beside


def _ends_within(parts: NDArray[np.int32], share: NDArray[np.float32]) -> Mask:
    """Return for each part whether it ends at the directions beside it, instead of going on at changing ranges.

    Arrays have the shape (rows, columns, bins): the part of each cell, from 1, 0 for none, and its share of the frames.
    """
    half = _BESIDE_BINS // 2
    total = np.cumsum(np.pad(share.astype(np.float64), ((0, 0), (0, 0), (half + 1, half))), axis=2)
    mean = (total[..., _BESIDE_BINS:] - total[..., :-_BESIDE_BINS]) / _BESIDE_BINS
    near = mean.astype(np.float32) * (_BESIDE_BINS / 2)
    occupied = (parts > 0).any(axis=2)
    borders, ongoing = np.zeros(parts.max() + 1), np.zeros(parts.max() + 1)
    for step in (-1, 1):
        outside = ~np.roll(occupied, -step, axis=1)
        at_border = (parts > 0) & outside[:, :, None]
        numbers = parts[at_border]
        borders += np.bincount(numbers, minlength=len(borders))
        goes_on = np.roll(near, -step, axis=1)[at_border] >= _GOES_ON
        ongoing += np.bincount(numbers[goes_on], minlength=len(borders))
    return ongoing <= _MOST_ONGOING * borders


def _sectors(grid: BeamGrid, cells: Mask) -> list[Sector]:
    """Return a sector for each direction, from its first to its last cell."""
    found = []
    for row, column in np.argwhere(cells.any(axis=2)).tolist():
        first, last = np.flatnonzero(cells[row, column])[[0, -1]].tolist()
        left = -180 + column * _AZIMUTH_STEP_DEG
        # A cell counts the returns in the next one, too.
        near, far = max(first * _STEP_M - _MARGIN_M, 0.0), (last + 2) * _STEP_M + _MARGIN_M
        limits = (*grid.edges_deg[row : row + 2].tolist(), left, left + _AZIMUTH_STEP_DEG, near, far)
        found.append(Sector(*(round(value, _DECIMALS) for value in limits)))
    return found


def _numbered_beams(frame: Frame, elevation: Floats) -> Floats | None:
    """Return the elevations of the beams, ascending; None if no field numbers beams of constant elevation."""
    points, name = frame.cloud.points, frame.cloud.ring_name
    if name is None or points.dtype[name].shape or points.dtype[name].kind not in "iu":
        return None
    rings, ring = np.unique(points[name][frame.valid], return_inverse=True)
    if not _MIN_BEAMS <= len(rings) <= _MAX_RINGS:
        return None
    by_ring = np.split(elevation[np.argsort(ring)], np.cumsum(np.bincount(ring))[:-1])
    middle = np.sort([np.median(own) for own in by_ring])
    beams = middle[np.concatenate(([True], np.diff(middle) > _SAME_DEG))]
    spread = np.median([np.subtract(*np.quantile(own, (0.9, 0.1))) for own in by_ring])
    return beams if len(beams) >= _MIN_BEAMS and spread <= np.median(np.diff(beams)) else None


def _parted_beams(elevation: Floats) -> Floats | None:
    """Return the elevations of the beams, ascending; None if the elevations of the points are not in narrow groups."""
    groups = np.split(np.sort(elevation), np.flatnonzero(np.diff(np.sort(elevation)) > _GAP_DEG) + 1)
    groups = [group for group in groups if len(group) >= _MIN_SHARE * len(elevation)]
    if len(groups) < _MIN_BEAMS or max(group[-1] - group[0] for group in groups) > _MOST_SPREAD_DEG:
        return None
    return np.array([np.median(group) for group in groups])
