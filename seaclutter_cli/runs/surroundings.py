"""What a lidar can see around own ship: where own ship ends, what is beside it, and how small a body its beams meet."""

import math

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.filters.zones import AUTO_M, LEAST_M
from seaclutter_cli.simulation.lidar.models import LIDARS
from seaclutter_cli.structure.own_ship import OwnShip
from seaclutter_cli.text import count

_BUOY_M = 0.4
_FARTHEST_M = 300
_MIN_SHARE = 0.1
_EVERY = 20
MOST_M = 20.0
"""Largest range within which surroundings are looked at."""


class Surroundings(OwnShip):
    """Own ship and what is beside it within a range, from a few frames of a topic."""

    def __init__(self, reach_m: float = MOST_M) -> None:
        super().__init__(reach_m, LEAST_M, every=_EVERY)

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


def smallest(models: tuple[str, ...], beams_deg: NDArray[np.float64] | None, level_m: float | None) -> str | None:
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


def met_up_to_m(elevations_deg: NDArray[np.float64], height_m: float, lidar_m: float, beams: int) -> int:
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
