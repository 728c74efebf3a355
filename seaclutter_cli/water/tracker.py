"""The water surface from frame to frame."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from seaclutter_cli.arrays import Floats, Mask
from seaclutter_cli.frame import Attitude
from seaclutter_cli.water.faces import LEAST_M, Faces
from seaclutter_cli.water.plane import LEAST_SUPPORT, MIN_SUPPORT, Plane, PolarCells, fit_plane, in_reach, mean_level
from seaclutter_cli.water.surface import RANGE_NOISE_M, WaterSurface, grid_cells, swell_of
from seaclutter_cli.water.trial import Trial

Level = Callable[[float], tuple[float, float]]

_START_SIGMA_M = 0.1
_START_PASSES = 5
_BAND_SIGMAS = 3.5
_MIN_BAND_M = 0.15
_SIGMA_TIME_S = 1.0
_MEMORY_S, _TURNED_MEMORY_S = 5.0, 15.0
_BODY_M = 0.5
_CRESTS = 1.25


class WaterTracker:
    """Estimator of the water surface, frame by frame.

    Notes
    -----
    For each frame, in order:

    1. *Plane*: the lowest echo of each polar cell of 10° by 3 m, from 5 to 45 m; a plane through them by iteratively
       reweighted least squares, from the plane of the frame before, at the likeliest of five scales, because calm water
       is at one height amid decks and images. Echoes in faces belong to bodies, as do those above their feet, such as
       decks; none of them counts. Feet stand in the water or are mirrored, so they count little. Cells count more that
       are near and have several echoes at one height, and none above, as fog has. If more cells have echoes below the
       plane, without a body above as high, than are at it, it is no water, and another is searched.
    2. *Level and deviation*: medians over the echoes near that plane, with the weights of the cells.
    3. *Swell*: a mean over 2.5 m of the echoes near the plane, and then of those near this surface, so that it follows
       crests. Echoes in faces do not count.
    4. *Deviation of the level*: the standard error of the plane; 1.25 times the water's deviation, as grazing
       beams see crests rather than troughs; the noise of ranges; and, while no trusted cell is seen, own ship's heave,
       a random walk by one deviation in a second.

    **State**: the plane of the last frame with water, its covariance, the deviation averaged over a second, and their
    time. Without water in a frame, they hold for five seconds; fifteen if own ship's attitude agreed with the water
    before (`Trial`). The plane turns with it meanwhile, and echoes with hardly any weight are no water.
    """

    def __init__(self) -> None:
        self.trial = Trial()
        self.reset()

    def reset(self) -> None:
        """Forget the water."""
        self._plane: Plane | None = None
        self._sigma_m = 0.0
        self._covariance = np.zeros((3, 3))
        self._seen_s = 0.0
        self._attitude: Attitude | None = None

    def step(
        self, xyz: Floats, faces: Faces, time_s: float, attitude: Attitude | None = None, own: Mask | None = None
    ) -> WaterSurface | None:
        """Return the water surface of a frame; None if no water was seen in the last seconds.

        The points, shape (3, N), are finite; those of own ship, ``own`` of shape (N,), do not count as water.
        """
        turn = attitude.turn_from(self._attitude) if attitude and self.trial.passed else None
        memory_s = _MEMORY_S if turn is None else _TURNED_MEMORY_S
        if self._plane is not None and not 0 <= time_s - self._seen_s <= memory_s:
            self.reset()
        known = self._plane.turned(turn) if self._plane is not None and turn is not None else self._plane
        x, y, z = xyz
        near = in_reach(x, y) if own is None else in_reach(x, y) & ~own
        of_bodies = near & (faces.height_m > _BODY_M + 2 * self._known_sigma_m)
        bodies = np.stack([values[of_bodies] for values in (x, y, faces.low_m, faces.top_m)])
        used = np.flatnonzero(near & (faces.height_m <= LEAST_M + self._known_sigma_m))
        cells = PolarCells.of(xyz.take(used, axis=1), bodies)
        lowest, weight = fit_plane(cells, known) if cells.enough else (known, None)
        if turn is not None and weight is not None and weight.sum() < MIN_SUPPORT:
            lowest, weight = known, None
        if lowest is None:
            return None
        if weight is not None and cells.contradict(lowest, weight):  # boats lie below it
            self.reset()
            lowest, weight = fit_plane(cells, None)
            if cells.contradict(lowest, weight):
                return None
        height = z - lowest.height(x, y)
        stands = faces.stands(z - height, self._known_sigma_m)
        if weight is not None:
            if weight.any():
                fitted = self._plane is None or weight.sum() >= LEAST_SUPPORT
                spread = cells.covariance(lowest, weight) if fitted else self._covariance_at(time_s)
                level = partial(mean_level, cells, height[used], cells.in_water(weight) & ~stands[used])
                self._update(lowest, spread, level, time_s, attitude)
            lowest = self._plane
        if lowest is None:
            return None
        flat = np.flatnonzero(~stands)
        grid, band = grid_cells(x[flat], y[flat]), band_m(self._sigma_m)
        height = (z - lowest.height(x, y))[flat]
        swell = swell_of(grid, height, np.abs(height) <= band)
        swell = swell_of(grid, height, np.abs(height - swell[0, grid]) <= band)
        spread = self._covariance_at(time_s)
        deviation = math.hypot(math.sqrt(spread[0, 0]), _CRESTS * self._sigma_m, RANGE_NOISE_M)
        return WaterSurface(lowest, self._sigma_m, swell, deviation, spread)

    def _update(self, lowest: Plane, spread: Floats, level: Level, time_s: float, attitude: Attitude | None) -> None:
        """Move the plane of the lowest echoes to the mean ``level`` in a band around it, unless that is overhead."""
        known = self._plane is not None
        sigma, offset = self._known_sigma_m, 0.0
        for _ in range(1 if known else _START_PASSES):
            offset, sigma = level(band_m(sigma))
        plane = replace(lowest, level_m=lowest.level_m + offset)
        if plane.level_m >= 0:  # water is below the lidar
            return
        share = np.exp((self._seen_s - time_s) / _SIGMA_TIME_S) if known else 0.0
        self._sigma_m = float(share * self._sigma_m + (1 - share) * sigma)
        self._plane, self._covariance, self._seen_s, self._attitude = plane, spread, time_s, attitude
        if attitude:
            self.trial.add(plane, attitude, time_s)

    def _covariance_at(self, time_s: float) -> Floats:
        """Return the covariance of the plane at a time at which it holds."""
        heave = np.diag((1.0, 0.0, 0.0))
        return self._covariance + heave * (self._sigma_m**2 * (time_s - self._seen_s) / _SIGMA_TIME_S)

    @property
    def _known_sigma_m(self) -> float:
        return _START_SIGMA_M if self._plane is None else self._sigma_m


def band_m(sigma_m: float) -> float:
    """Return the height around the water within which echoes count as water."""
    return max(_MIN_BAND_M, _BAND_SIGMAS * sigma_m)
