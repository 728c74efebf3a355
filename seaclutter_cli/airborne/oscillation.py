"""Oscillation of elevations: how long waves are, and how much they are the opposite half a length away."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Cells = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAX_TILT = 0.5
"""Deviation of a plane through waves, at most, relative to that of the waves."""
_REACH_CELLS = 64
_REACH = np.r_[0 : _REACH_CELLS + 1]
_LAGS = np.r_[_REACH, -_REACH[:0:-1]]
_SPARSE, _CERTAIN = 0.5, 5.0


def oscillation(elevation: Cells, water: Mask, step: int = 1) -> tuple[float, float]:
    """Return the wave length in cells, and the depth of the minimum of the autocovariance relative to the variance.

    ``elevation``, shape (n, m): elevations above the level of the water; ``water``, shape (n, m): cells of the water;
    the others do not count; ``step``: every so many cells are in the arrays.

    Sums of products of pairs are not divided by the number of pairs, so that of many minima the nearest is the deepest.
    A sparse grid has few pairs: there, each sum is scaled to the pairs that a full grid would have, and a minimum needs
    a depth of 5 standard errors.
    """
    covariance = _products(np.where(water, elevation, 0))
    correlation = covariance / max(float(covariance[0, 0]), 1e-12)
    if _density(water) < _SPARSE:
        pairs = np.maximum(_products(water), 1)
        rows, columns = (1 - np.abs(lags) / side for lags, side in zip((_REACH, _LAGS), water.shape, strict=True))
        correlation *= rows[:, None] * columns * pairs[0, 0] / pairs
        correlation[-correlation < _CERTAIN / np.sqrt(pairs)] = 0
    i, j = np.unravel_index(np.argmin(correlation), correlation.shape)
    if max(_REACH[i], abs(_LAGS[j])) == _REACH_CELLS:
        # Over more than half of its width, or in part of a block, a slope has a minimum, too.
        slope = tilt(np.where(water, elevation, np.inf)) if water.any() else np.inf
        if len(elevation) < 4 * _REACH_CELLS or slope > MAX_TILT * float(elevation[water].std()):
            return 0.0, 0.0
        return oscillation(elevation[::2, ::2], water[::2, ::2], 2 * step)
    return 2 * step * float(np.hypot(_REACH[i], _LAGS[j])), -float(correlation[i, j])


def _density(known: Mask) -> float:
    """Return the share of the neighbours of known cells that are known; 1 without any."""
    neighbors = known[1:][known[:-1]]
    return float(np.count_nonzero(neighbors) / len(neighbors)) if len(neighbors) else 1.0


def _products(values: NDArray[Any]) -> NDArray[np.floating[Any]]:
    """Return the sums of products of pairs of cells, by lag in half of all directions: shape (65, 129)."""
    shape = [side + _REACH_CELLS for side in values.shape]
    spectrum = np.fft.rfft2(values.astype(np.float32), shape)
    power = spectrum.real**2 + spectrum.imag**2
    rows = np.fft.ifft(power, axis=0)[_REACH]  # the other half is the same, mirrored
    return np.fft.irfft(rows, shape[1], axis=1)[:, _LAGS]


def tilt(lowest: Cells) -> float:
    """Return the standard deviation of a plane through the finite cells: large on slopes, small on waves."""
    known = np.isfinite(lowest)
    place = np.stack(np.nonzero(known)).astype(np.float64)
    place -= place.mean(axis=1, keepdims=True)
    slope = place @ (lowest[known] - lowest[known].mean()) / (place**2).sum(axis=1)
    return float((slope @ place).std())
