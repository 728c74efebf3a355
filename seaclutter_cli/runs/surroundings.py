"""What a lidar can see around own ship: where own ship ends, what is beside it, and how small a body its beams meet."""

import math

import numpy as np

from seaclutter_cli.arrays import Floats, Indices, Ints, Mask
from seaclutter_cli.filters.zones import AUTO_M, LEAST_M
from seaclutter_cli.frame import Frame, WaterState
from seaclutter_cli.simulation.lidar import LIDARS
from seaclutter_cli.structure.mask import azimuth_deg
from seaclutter_cli.structure.own_ship import OwnShip
from seaclutter_cli.structure.search import BeamGrid
from seaclutter_cli.text import count, share
from seaclutter_cli.water import Mounting
from seaclutter_cli.water.plane import NEAREST_M, Plane
from seaclutter_cli.water.tracker import band_m

_BUOY_M = 0.4
_FARTHEST_M = 300
_MIN_SHARE = 0.1
_EVERY = 20
MOST_M = 20.0
"""Largest range within which surroundings are looked at."""
_GRAZING_HEIGHTS, _FLAT = (6, 12), 1 / 3
_OF_LAND, _LEAST_SHOTS, _MOST_FRAMES = 0.5, 500, 20
_FEW, _APART_DEG = 0.1, 0.02


class Ground:
    """Count of the shots that a flat surface, taken for water, returns at grazing angles of 5° to 9°.

    There, land returns most shots that nothing in front of it stops, water a third at most. The shots in a column of 1°
    of a beam follow from the smallest steps between echoes. Rough surfaces, which are waves or fog, do not count, nor
    do frames that do not show the beams.
    """

    def __init__(self, mounting: Mounting | None = None) -> None:
        self._mounting = mounting or Mounting()
        self._grid: BeamGrid | None = None
        self._frames = self._shots = self._returned = 0
        self._level_m = 0.0

    def add(self, frame: Frame, water: WaterState) -> None:
        """Add one of the first frames, and what was taken for its water, in the levelled frame."""
        band = band_m(water.significant_wave_height_m / 4)
        if self._frames >= _MOST_FRAMES or band > -_FLAT * water.level_m:
            return
        roll, pitch = np.tan(np.radians((water.roll_deg, water.pitch_deg))).tolist()
        plane, self._grid = Plane(water.level_m, pitch, -roll), self._grid or BeamGrid.of(frame)
        if self._grid.beams_deg is None:
            return
        direction, echo, shots = _echoes(frame, self._grid)
        x, y, z = self._mounting.levelled(frame.coordinates[:, echo])
        is_surface = np.abs(z - plane.height(x, y)) <= band
        met, others = (np.bincount(direction[one], minlength=self._grid.size) for one in (is_surface, ~is_surface))
        met = np.minimum(met, shots)
        asked = self._grazing(self._grid, plane)
        self._returned += int(met[asked].sum())
        self._shots += int(np.maximum(shots - others, met)[asked].sum())
        self._level_m += plane.level_m
        self._frames += 1

    def _grazing(self, grid: BeamGrid, plane: Plane) -> Mask:
        """Return the directions that meet the plane at a grazing angle and not too near, shape (size,)."""
        x, y, z = self._mounting.levelled(grid.centers)
        down = z - plane.slope_x * x - plane.slope_y * y
        with np.errstate(divide="ignore"):
            distance = np.where(down < 0, plane.level_m / down, np.inf) * np.hypot(x, y)
        nearest, farthest = (-heights * plane.level_m for heights in _GRAZING_HEIGHTS)
        return np.asarray((distance >= max(nearest, NEAREST_M)) & (distance < farthest))

    def warning(self) -> str | None:
        """Return a warning if the surface is land; else None."""
        if self._shots < _LEAST_SHOTS or self._returned < _OF_LAND * self._shots:
            return None
        return (
            f"the surface {-self._level_m / self._frames:.1f} m below the lidar seems to be land: it returns "
            f"{share(self._returned, self._shots)} of the shots at grazing angles of 5° to 9°, water a third at most; "
            "methods that estimate the water are for logs from vessels"
        )


def _echoes(frame: Frame, grid: BeamGrid) -> tuple[Ints, Indices, int]:
    """Return direction and index of the echoes of a frame, one of several of a shot, and the shots in a direction."""
    valid, direction = np.flatnonzero(frame.valid), grid.directions(frame)
    azimuth = azimuth_deg(frame.coordinates[:, valid])
    order = np.lexsort((azimuth, direction))
    step, begins = np.diff(azimuth[order], prepend=-np.inf), np.diff(direction[order], prepend=-1) != 0
    steps = step[~begins & (step > _APART_DEG)]
    order = order[begins | (step > _APART_DEG)]
    shots = round(1 / float(np.quantile(steps, _FEW))) if len(steps) else 1
    return direction[order], valid[order], max(shots, 1)


class Surroundings(OwnShip):
    """Own ship and what is beside it within a range, from a few frames of a topic."""

    def __init__(self, reach_m: float = MOST_M) -> None:
        super().__init__(reach_m, LEAST_M, every=_EVERY)
        self.ground = Ground()

    def add(self, frame: Frame, *, finds_water: bool = True) -> None:
        """Add the next frame."""
        super().add(frame, finds_water=finds_water)
        if self._is_due and (surface := self._search.surface):
            self.ground.add(frame, surface.state)

    def own_ship(self) -> str | None:
        """Return where own ship ends and the settings that suit it; None if it is not known."""
        end_m = self.end_m
        if end_m is None:
            return "not known, because the vessel is at rest" if self.is_at_rest else None
        if not end_m:
            return f"nothing constant from {LEAST_M:g} to {self.reach_m:g} m; filter.start_m: {LEAST_M:g} suffices"
        start_m = math.ceil(end_m + 0.1)
        other = "auto" if start_m <= AUTO_M else "10 with a mask (seaclutter mask)"
        return f"reaches {end_m:.1f} m; filter.start_m: {start_m} suffices, or {other}"

    def warning(self) -> str | None:
        """Return a warning if bodies other than own ship are often nearer than the reach; else None."""
        if self.end_m is None or not self.beside or self.beside < _MIN_SHARE * self.seen:
            return None
        own = f"own ship reaches {self.end_m:.1f} m" if self.end_m else "nothing there is constant, as own ship is"
        return (
            f"what stands out of the water nearer than {self.reach_m:g} m (filter.start_m) moves in {self.beside} of "
            f"{count(self.seen, 'frame')} examined, as a boat beside own ship does, and is removed; {own}: "
            "use filter.start_m: auto, or a lower one"
        )


def smallest(models: tuple[str, ...], beams_deg: Floats | None, level_m: float | None) -> str | None:
    """Return up to which range the beams of a lidar meet a small buoy; None if beams or water are unknown.

    Beams are those of the first known model, else at ascending elevations; the water is at a height from the lidar.
    """
    known = [LIDARS[name].elevations_deg for name in models if name in LIDARS]
    elevations = np.sort(known[0]) if known else beams_deg
    if elevations is None or level_m is None or level_m >= 0:
        return None
    one, two = (met_up_to_m(elevations, _BUOY_M, -level_m, beams) for beams in (1, 2))
    by_two = f"by two up to {two} m" if two else "nowhere by two"
    met = f"is met by one beam up to {one} m, {by_two}" if one else "can lie between beams"
    return f"a buoy of {_BUOY_M} m {met}"


def met_up_to_m(elevations_deg: Floats, height_m: float, lidar_m: float, beams: int) -> int:
    """Return the range up to which a number of beams meet a body on the water, wherever between them it is; 0 for none.

    The lidar is ``lidar_m`` above the water, and level. Beams are lines: their divergence is not known.

    Examples
    --------
    >>> met_up_to_m(np.arange(-15.0, 16.0, 1.0), 0.4, 2.0, 1)
    22
    """
    ranges = np.arange(1, _FARTHEST_M)
    foot, top = (np.degrees(np.arctan2(height - lidar_m, ranges)) for height in (0.0, height_m))
    low, high = elevations_deg[:-beams], elevations_deg[beams:]
    can_be_in = (low <= top[:, None]) & (high >= foot[:, None])
    widest = np.where(can_be_in, high - low, 0).max(axis=1)
    return int(ranges[can_be_in.any(axis=1) & (widest <= top - foot)].max(initial=0))
