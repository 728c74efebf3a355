"""Signs that level regions of a tile are water or land."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.echoes import Echoes
from seaclutter_cli.airborne.reflection import DIFFUSE, LIKE_GROUND, SPECULAR, median_of
from seaclutter_cli.airborne.regions import are_joined, band_of, edge_of, is_even, is_widely_even, relief_of, waves_in
from seaclutter_cli.airborne.squares import LEAST_SQUARES, RELIEF_M, Squares, SquareWaves, is_relief
from seaclutter_cli.airborne.terrain import SEVERAL

Values = NDArray[np.float64]

LARGEST = 0.5
"""Share of the squares of a tile from which a region needs less evidence."""
_LOWER_SHARE, _WEIR_SHARE, _HIGHER_SHARE = 0.1, 0.3, 0.02
_CERTAIN = 100
_GROUND_M, _GROUND_SHARE = 0.2, 0.5
_SHORT_WAVES = 0.7
_LEAST_MOVING, _MOVING_SHARE = 8, 0.5
_MEASURED_SHARE, _SEEN_SHARE, _HIGH_M, _STEEP = 0.3, 0.1, 0.15, 0.25
_GROUPS = 1.5
_STEP_M, _BUMPS_M, _TILT_M, _SLOPE = 0.04, 0.05, 0.02, 0.001


def signs_of(
    squares: Squares, echoes: Echoes, regions: Sequence[NDArray[np.int64]], waves: SquareWaves, *, has_mirrors: bool
) -> NDArray[np.int64]:
    """Return the number of signs that each region is water, less those that it is land.

    Parameters
    ----------
    squares : Squares
        The squares of the tile.
    echoes : Echoes
        Their echoes.
    regions : sequence of ndarray, int64
        The squares of each region.
    waves : SquareWaves
        Waves in each square.
    has_mirrors : bool
        Whether a twentieth of the tile reflects like a mirror.

    Notes
    -----
    * Water lies in a hollow: something along its edge is higher (+1). Land is a region from which water would run off
      along a tenth of its edge (-2): a slope, a bank, a field above a ditch. What is higher holds it back, and if the
      region is flat, a wall in the lower square does, too. A region of 64 squares that is as even as still water may
      lose it over one stretch of three tenths of its edge: a weir. Waves come in groups: where they were measured in
      three tenths of a region, troughs beside it may be 1.5 times as deep as theirs.
    * Still water is level. A plane through a slope or a river falls by more than one in a thousand (-2); for a
      region like a mirror, by more than chance makes of the differences between its squares, or the waves do. Wind
      and strips that do not match cause less. In waves, only squares count in which these were measured: the foot of a
      beach is no higher than they are.
    * Water is flat. Neighbouring squares that differ by more than 4 cm, or means over 64 cells by more than 5 cm,
      beyond what waves explain, are a sign of land (-1). Short waves are not: the squares of an even region of 64 or
      more may differ by 0.7 times their spread.
    * Water reflects like a mirror, and an echo depends on the facet that it met: a coefficient of variation of at least
      0.6 among neighbouring intensities (+1; the speckle of many facets has 0.7 and more). Ground scatters light in all
      directions: 0.45 at most (-1, if a twentieth of the tile does reflect like a mirror). Squares of ground and others
      are not joined; a region with ground at its level along half of its edge is a part of it (-2). Squares of water
      may vary less by chance: the median of these must be that of ground.
    * A pulse has several echoes under trees, and one on water (-1). Nothing rises two metres and more in most squares
      of water, with a twentieth of their echoes (-1).
    * Waves move, and still water is level: squares that deviate by 3 cm, and do so alike in two strips, or by half of
      that in nearly the same way, are land (-2), unless they reflect like a mirror: rapids stay where they are. Water
      is a region of which most squares rise and fall from strip to strip (+2).
    """
    return np.array([_signs(squares, echoes, own, waves, has_mirrors=has_mirrors) for own in regions], np.int64)


def _signs(squares: Squares, echoes: Echoes, own: NDArray[np.int64], around: SquareWaves, *, has_mirrors: bool) -> int:
    """Return the number of signs that a region is water, less those that it is land."""
    if known := int(echoes.known[own[0]]):
        return _CERTAIN * known
    level = float(np.median(squares.level_m[own]))
    waves = waves_in(squares, own, around.deviation_m)
    measured = own[around.measured[own]]  # waves are as high as the foot of a beach, which slopes
    variation, several = (median_of(values[own]) for values in (echoes.variation, echoes.several))
    in_waves = waves > 0 and len(measured) >= LEAST_SQUARES
    relief = relief_of(squares, measured if in_waves else own)
    is_flat = relief.step_m <= np.hypot(_STEP_M, waves) and relief.bumps_m <= np.hypot(_BUMPS_M, waves)
    is_still = is_widely_even(squares, own)
    is_flat |= is_still and relief.step_m <= _SHORT_WAVES * np.median(squares.spread_m[own])
    is_mirror = variation >= SPECULAR
    band = band_of(waves)
    # What reflects like water around water may be its troughs.
    groups = _GROUPS if in_waves and len(measured) > _MEASURED_SHARE * len(own) else 1.0
    trough = np.where(has_mirrors & is_mirror & (echoes.variation >= SPECULAR), 2 * band, groups * band)
    signs = _hollow(squares, own, level + band, level - trough, has_walls=is_flat) - (not is_flat)
    chance = 2 * relief.step_m * np.sqrt(2 / len(own)) if is_mirror else 0.0
    tilt_in_waves = max(np.hypot(_TILT_M, waves if is_mirror else waves / 2), chance)
    signs -= 2 * (relief.slope > _SLOPE and relief.tilt_m > tilt_in_waves)
    signs += int(is_mirror) - int(has_mirrors and variation <= DIFFUSE)
    signs -= 2 * (has_mirrors and _goes_on_as_ground(squares, echoes, own, level))
    signs -= several > SEVERAL
    signs -= median_of(echoes.tall[own]) > SEVERAL
    signs -= 2 * (not is_mirror and has_relief(squares, echoes, own))
    signs += 2 * _moves(echoes, own)
    return int(signs)


def has_relief(squares: Squares, echoes: Echoes, own: NDArray[np.int64]) -> bool:
    """Return whether two strips show the elevations of a region alike."""
    return is_relief(squares, echoes.change_m, own, RELIEF_M) is True


def _moves(echoes: Echoes, own: NDArray[np.int64]) -> bool:
    """Return whether most squares of a region that two strips show are moving, and they are not few."""
    moving = np.count_nonzero(echoes.moving[own])
    return bool(moving >= max(_LEAST_MOVING, _MOVING_SHARE * np.count_nonzero(np.isfinite(echoes.change_m[own]))))


def _hollow(squares: Squares, own: NDArray[np.int64], high_m: float, low_m: float | Values, *, has_walls: bool) -> int:
    """Return -2 if water would run off a region, over at most one square beyond it; 1 if it is in a hollow."""
    beyond, runs_off = edge_of(squares, own, high_m, low_m, has_walls=has_walls)
    if _drains(squares, own, beyond[runs_off], len(beyond)):
        return -2
    higher = np.append(squares.top_m > high_m, False)[beyond]
    return int(np.count_nonzero(higher) > _HIGHER_SHARE * len(beyond))


def _drains(squares: Squares, own: NDArray[np.int64], outlets: NDArray[np.int64], edge: int) -> bool:
    """Return whether water would run off a region along too much of its edge; a weir is one outlet of a still pool."""
    if len(outlets) <= _LOWER_SHARE * edge:
        return False
    is_weir = len(outlets) <= _WEIR_SHARE * edge and is_widely_even(squares, own) and are_joined(squares, own, outlets)
    return not is_weir


def _goes_on_as_ground(squares: Squares, echoes: Echoes, own: NDArray[np.int64], level_m: float) -> bool:
    """Return whether half of the edge of a region touches ground at its level."""
    inside = np.zeros(len(squares.index) + 1, np.bool_)
    inside[own] = True
    beyond = squares.neighbor[:, own]
    beyond = beyond[~inside[beyond]]
    at_level = np.append((echoes.variation <= LIKE_GROUND) & (np.abs(squares.level_m - level_m) <= _GROUND_M), False)
    ground = beyond[at_level[beyond]]
    if len(ground) <= _GROUND_SHARE * len(beyond):
        return False
    return median_of(echoes.variation[ground]) <= DIFFUSE  # water that varies less by chance is no ground


def is_basin(squares: Squares, own: NDArray[np.int64], waves: SquareWaves) -> bool:
    """Return whether a region looks like water, and is held back along its edge in the tile or is half of it."""
    level, band = float(np.median(squares.level_m[own])), band_of(waves_in(squares, own, waves.deviation_m))
    beyond, runs_off = edge_of(squares, own, level + band, level - band, has_walls=True)
    is_held = not _drains(squares, own, beyond[runs_off], int(np.count_nonzero(beyond >= 0)))
    return (is_held or len(own) >= LARGEST * len(squares.index)) and looks_like_water(squares, own, waves)


def looks_like_water(squares: Squares, own: NDArray[np.int64], waves: SquareWaves, least_m: float = 0.0) -> bool:
    """Return whether a region is as even over wide distances as over short ones, or has waves.

    ``least_m`` is the deviation that waves exceed. They are measured in three tenths of the region, or in a tenth if
    they are high and short: ground that rises and falls as far does so over longer distances.
    """
    deviation_m = float(np.median(waves.deviation_m[own]))
    is_clear = deviation_m >= _HIGH_M and np.median(squares.spread_m[own]) >= _STEEP * deviation_m
    least_share = _SEEN_SHARE if is_clear else _MEASURED_SHARE
    has_waves = deviation_m > least_m and waves.measured[own].mean() > least_share
    return bool(has_waves or is_even(squares, own))
