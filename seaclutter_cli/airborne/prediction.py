"""Elevation of the water under objects, predicted from the water around them."""

import itertools

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.grids.elevation import BLOCK, ElevationGrid

Cells = NDArray[np.float64]
Mask = NDArray[np.bool_]

_REACH_CELLS = 40
_MARGIN_CELLS, _NEAR_CELLS = 14, 3
_MANY_CELLS = 300
_LEAST_CELLS = 20
_RIDGE, _LEAST_M2 = 0.02, 1e-6
_SIDE_CELLS = 32


def predict_under(
    grid: ElevationGrid, lowest: Cells, water: Mask, objects: Mask, level_m: float
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the best linear prediction of the water under objects (simple kriging).

    Parameters
    ----------
    grid : ElevationGrid
        Grid of the points of one strip.
    lowest : ndarray, shape (S, 256, 256), float64
        Lowest elevations.
    water : ndarray, shape (S, 256, 256), bool
        Cells of water, with finite elevations.
    objects : ndarray, shape (S, 256, 256), bool
        Cells of objects.
    level_m : float
        Level of the water.

    Returns
    -------
    (ndarray, shape (M,), int64), (ndarray, shape (M,), float64), (ndarray, shape (M,), float64)
        Cells of objects as indices into ``lowest.ravel()``, elevation of the water there, and variance of its error.

    Notes
    -----
    The prediction is a weighted sum of the water up to 14 cells away. The weights follow from the autocovariance of the
    water of the strip over both directions, so waves and swell go on below an object in the direction in which they
    travel. Far from any water, the prediction is the level, with the variance of the waves. Objects are divided into
    squares of 32 cells.
    """
    covariance = _covariance(np.where(water, lowest - level_m, 0), water)
    cell = np.flatnonzero(objects)
    place = np.array(list(grid.blocks), np.int64).reshape(-1, 2)
    at = place[cell // BLOCK**2].T * BLOCK + np.stack(np.divmod(cell % BLOCK**2, BLOCK))
    square = np.unique(at // _SIDE_CELLS, axis=1, return_inverse=True)[1].reshape(-1)
    order = np.argsort(square, kind="stable")
    elevation, variance = np.full(len(cell), level_m), np.full(len(cell), covariance[0, 0])
    for own in np.split(order, np.flatnonzero(np.diff(square[order])) + 1):
        corner = at[:, own].min(axis=1) - _MARGIN_CELLS
        window = _window(grid, corner, at[:, own].max(axis=1) + _MARGIN_CELLS + 1)
        known = _data(window, water, cell[own])
        if known.shape[1] >= _LEAST_CELLS:
            values = lowest.reshape(-1)[window[tuple(known)]] - level_m
            mean, variance[own] = _krige(covariance, known, values, at[:, own] - corner[:, None])
            elevation[own] += mean
    return cell, elevation, variance


def _window(grid: ElevationGrid, low: NDArray[np.int64], high: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the index of each cell of a rectangle, also across blocks; -1 for none."""
    x, y = (np.arange(*ends) for ends in zip(low, high, strict=True))
    index = np.full((len(x), len(y)), -1, np.int64)
    for block in itertools.product(np.unique(x // BLOCK).tolist(), np.unique(y // BLOCK).tolist()):
        slot = grid.blocks.get(block)
        if slot is not None:
            own = x // BLOCK == block[0], y // BLOCK == block[1]
            inside = (x[own[0]] % BLOCK)[:, None] * BLOCK + y[own[1]] % BLOCK
            index[np.ix_(*own)] = slot * BLOCK**2 + inside
    return index


def _data(window: NDArray[np.int64], water: Mask, own: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the cells of a window that the prediction is made from: all of the nearest, and some of the others."""
    from scipy import ndimage

    wet = (window >= 0) & water.reshape(-1)[window]
    distance = ndimage.distance_transform_edt(~np.isin(window, own))
    column, row = np.indices(window.shape)
    some = (distance <= _NEAR_CELLS) | (column % 2 + row % 2 == 0)
    found = np.stack(np.nonzero(wet & some & (distance <= _MARGIN_CELLS)))
    return found[:, :: max(-(-found.shape[1] // _MANY_CELLS), 1)]


def _covariance(elevation: Cells, water: Mask) -> NDArray[np.float64]:
    """Return the autocovariance by lag along both axes; negative lags are at the end, as in an FFT."""
    side = BLOCK + _REACH_CELLS
    shape = (side, side)
    total, pairs = (
        np.fft.irfft2(sum(np.abs(np.fft.rfft2(block.astype(np.float32), shape)) ** 2 for block in values), shape)
        for values in (elevation, water)
    )
    lag = np.minimum(np.arange(side), side - np.arange(side))
    taper = np.cos(np.pi / 2 * np.minimum(lag / _REACH_CELLS, 1)) ** 2
    covariance = np.where(pairs > 1, total / np.maximum(pairs, 1), 0) * taper[:, None] * taper
    spectrum = np.maximum(np.fft.rfft2(covariance).real, 0)  # so that the matrix of any cells has an inverse
    return np.asarray(np.fft.irfft2(spectrum, shape), np.float64)


def _krige(
    covariance: NDArray[np.float64], data: NDArray[np.int64], values: NDArray[np.float64], cells: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return prediction and variance of its error at cells, shape (2, M), from values at others, shape (2, N)."""
    from scipy import linalg

    def between(one: NDArray[np.int64], other: NDArray[np.int64]) -> NDArray[np.float64]:
        column, row = one[:, :, None] - other[:, None]
        return np.asarray(covariance[column, row])

    variance = float(covariance[0, 0])
    own = between(data, data)
    own[np.diag_indices_from(own)] += _RIDGE * variance + _LEAST_M2
    across = between(cells, data)
    root = linalg.cholesky(own, lower=True)
    half = linalg.solve_triangular(root, np.column_stack((across.T, values)), lower=True)
    explained = (half[:, :-1] ** 2).sum(axis=0)
    return np.asarray(half[:, :-1].T @ half[:, -1]), np.clip(variance - explained, _RIDGE * variance, variance)
