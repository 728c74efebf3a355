"""Points against the water: what stands out, what is bright, what stands upright."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.filters.confirmation.echoes import Echoes
from seaclutter_cli.filters.confirmation.params import ConfirmedParams
from seaclutter_cli.water import WaterSurface

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_RISE_PER_M = 0.006
_RISE_FROM_M = 30.0
_WAVE_SIGMAS = 6.0
_GROWTH_SIGMAS = 1.5
_UNSEEN_M = 100.0
_OWN, _SHOWN = 4.0, 12.0


@dataclass(frozen=True)
class Heights:
    """The M echoes of a frame against the water; all arrays have shape (M,).

    Parameters
    ----------
    height_m, rise_m, wave_m : ndarray, float64
        Height above the water, height at which a point stands out, and height that no wave reaches.
    high, bright, low, upright, grows : ndarray, bool
        Whether a point stands out; is near the water and reaches its threshold; does not reach it; is in a column with
        echoes at several heights; is high enough to return to a confirmed object.
    brightness : ndarray, float64
        Intensity divided by the threshold; 0 without thresholds.
    unseen : ndarray, float64
        1 where the water has no echoes but those that an object itself may have, 0 where echoes show it all around.
    sigma_m : float
        Standard deviation of the water; 0 without water.
    """

    height_m: Floats
    rise_m: Floats
    wave_m: Floats
    high: Mask
    bright: Mask
    low: Mask
    upright: Mask
    grows: Mask
    brightness: Floats
    unseen: Floats
    sigma_m: float


def measure(echoes: Echoes, threshold: Floats, water: WaterSurface | None, params: ConfirmedParams) -> Heights:
    """Return the echoes of a frame against the water. Without water, every point stands out.

    Parameters
    ----------
    echoes : Echoes
        The M echoes.
    threshold : ndarray, shape (M,), float64
        Their intensity thresholds; minus infinity beyond the range rings.
    water : WaterSurface or None
        The water.
    params : ConfirmedParams
        Config keys of the method.
    """
    x, y, z = echoes.xyz
    if water is None:
        height, deviation, shown = z + _UNSEEN_M, np.zeros(echoes.size), np.zeros(echoes.size)
        sigma, upright = 0.0, np.zeros(echoes.size, np.bool_)
    else:
        height, deviation, shown = water.above(x, y, z, water.cells)
        sigma, upright = water.sigma_m, water.upright
    beyond = _RISE_PER_M * np.maximum(echoes.range_m - _RISE_FROM_M, 0)
    rise = np.maximum(params.min_rise_m, params.rise_sigmas * deviation) + beyond
    reached, brightness = _brightness(echoes, threshold)
    return Heights(
        height,
        rise,
        _WAVE_SIGMAS * deviation + beyond,
        height > rise,
        reached & (np.abs(height) <= rise),
        ~reached,
        upright,
        height > np.maximum(params.growth_height_m, _GROWTH_SIGMAS * deviation),
        brightness,
        np.clip((_SHOWN - shown) / (_SHOWN - _OWN), 0, 1),
        sigma,
    )


def _brightness(echoes: Echoes, threshold: Floats) -> tuple[Mask, Floats]:
    """Return which points reach their threshold, and intensity divided by threshold."""
    if echoes.intensity is None:
        return np.zeros(echoes.size, np.bool_), np.zeros(echoes.size)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(threshold > 0, echoes.intensity / threshold, 1.0)
    return echoes.intensity >= threshold, ratio
