"""The water surface from frame to frame."""

import numpy as np

from seaclutter_cli.water.columns import upright
from seaclutter_cli.water.plane import FARTHEST_M, NEAREST_M, Floats, Plane, PolarCells, WaterEchoes, fit_plane
from seaclutter_cli.water.surface import GridCells, Swell, WaterSurface

_START_SIGMA_M = 0.1
_START_PASSES = 5
_BAND_SIGMAS = 3.5
_MIN_BAND_M = 0.15
_SIGMA_TIME_S = 1.0
_MEMORY_S = 5.0


class WaterTracker:
    """Estimator of the water surface, frame by frame.

    Notes
    -----
    For each frame, in order:

    1. *Plane*: the lowest echo of each polar cell of 10° by 3 m, from 5 to 45 m; a plane through them by iteratively
       reweighted least squares, from the plane of the frame before.
    2. *Level and deviation*: medians over the echoes near that plane, with the same weight for each cell.
    3. *Swell*: a mean over 2.5 m of the echoes near the plane, and then of those near this surface, so that it follows
       crests. Echoes in columns with several heights belong to objects and do not count.

    **State**: the plane of the last frame with water, the deviation averaged over a second, and their time. Without
    water in a frame, they hold for five seconds.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the water."""
        self._plane: Plane | None = None
        self._sigma_m = 0.0
        self._seen_s = 0.0

    def step(self, xyz: Floats, time_s: float) -> WaterSurface | None:
        """Return the water surface of a frame; None if no water was seen in the last five seconds.

        Parameters
        ----------
        xyz : ndarray, shape (3, N), float64
            Finite points of the frame in metres, without own ship.
        time_s : float
            Time of the frame in seconds.
        """
        if self._plane is not None and not 0 <= time_s - self._seen_s <= _MEMORY_S:
            self.reset()
        x, y, z = xyz
        distance = np.hypot(x, y)
        near = np.flatnonzero((distance >= NEAREST_M) & (distance < FARTHEST_M))
        cells = PolarCells.of(xyz.take(near, axis=1))
        lowest, weight = fit_plane(cells, self._plane) if cells.enough else (self._plane, None)
        if lowest is None:
            return None
        height = z - lowest.height(x, y)
        stands = upright(x, y, height, upright_span_m(self._known_sigma_m))
        if weight is not None:
            self._update(lowest, WaterEchoes.of(cells, height[near], weight, ~stands[near]), time_s)
        if self._plane is None:
            return None
        flat = np.flatnonzero(~stands)
        grid = GridCells.of(x, y)
        swell = self._swell(GridCells(grid.number[flat]), (z - self._plane.height(x, y))[flat])
        return WaterSurface(self._plane, self._sigma_m, swell, stands, grid)

    def _update(self, lowest: Plane, echoes: WaterEchoes, time_s: float) -> None:
        known = self._plane is not None
        sigma, offset = self._known_sigma_m, 0.0
        for _ in range(1 if known else _START_PASSES):
            offset, sigma = echoes.mean_level(_band(sigma))
        plane = lowest.shifted(offset)
        if plane.level_m >= 0:  # water is below the lidar
            return
        share = np.exp((self._seen_s - time_s) / _SIGMA_TIME_S) if known else 0.0
        self._sigma_m = float(share * self._sigma_m + (1 - share) * sigma)
        self._plane, self._seen_s = plane, time_s

    @property
    def _known_sigma_m(self) -> float:
        return _START_SIGMA_M if self._plane is None else self._sigma_m

    def _swell(self, cells: GridCells, height: Floats) -> Swell:
        """Return the swell through the echoes of the water among points, by their heights above the plane."""
        band = _band(self._sigma_m)
        swell = Swell.of(cells, height, np.abs(height) <= band)
        return Swell.of(cells, height, np.abs(height - swell.at(cells)[0]) <= band)


def upright_span_m(sigma_m: float) -> float:
    """Return the height that the echoes of a column of 1 m must span to belong to an object, in metres."""
    return 0.25 + sigma_m


def _band(sigma_m: float) -> float:
    """Return the height around the water within which echoes count as water."""
    return max(_MIN_BAND_M, _BAND_SIGMAS * sigma_m)
