"""False returns of a lidar: the two kinds of noise in [Bi]."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Gt, Interval
from numpy.typing import NDArray

from seaclutter_cli.simulation.lidar.echoes import Echoes
from seaclutter_cli.truth import CLUTTER
from seaclutter_cli.validation import renamed

Floats = NDArray[np.float64]

_SURFACE_M = 0.1


@dataclass(frozen=True, kw_only=True)
class NoiseParams:
    """False returns of a lidar.

    Parameters
    ----------
    false_return_share : float
        Share of the shots without an echo that report a nearby point anyway ("lost information" in [Bi]).
    false_return_reach_m : float
        Mean distance of these points beyond the minimum range.
    mixed_pixel_share : float
        Share of the shots across an edge that report a point between the two surfaces ("escape values" in [Bi]).

    Notes
    -----
    [Bi] shows both kinds but does not quantify them; the values for the lidars here are assumptions.
    """

    false_return_share: Annotated[float, Interval(ge=0, le=1)] = renamed(0.0, formerly="lost_share")
    false_return_reach_m: Annotated[float, Gt(0)] = renamed(0.6, formerly="lost_reach_m")
    mixed_pixel_share: Annotated[float, Interval(ge=0, le=1)] = renamed(0.0, formerly="edge_share")


NO_NOISE = NoiseParams()


def add_mixed_pixels(echoes: Echoes, columns: int, noise: NoiseParams, rng: np.random.Generator) -> None:
    r"""Convert some echoes at edges to mixed pixels.

    Parameters
    ----------
    echoes : Echoes
        Echoes of a frame, column by column; changed in place.
    columns : int
        Columns per frame.
    noise : NoiseParams
        Share of mixed pixels.
    rng : numpy.random.Generator
        Source of randomness.

    Notes
    -----
    If the centres of two neighbouring beams hit different surfaces, the edge runs through one of the two beams, each
    with probability 1/2. The larger part of that beam, a share s uniform from 0.5 to 1, is on its own surface. The
    light of both parts adds up, and the beam reports the mean of their ranges weighted by their power, :math:`s P_1`
    and :math:`(1-s) P_2` with :math:`P \propto \rho \cos\theta / R^2`. The point is clutter if it is more than 10 cm
    from both surfaces.
    """
    if not noise.mixed_pixel_share:
        return
    shots = np.arange(len(echoes.range_m)).reshape(columns, -1)
    left, right = shots[:-1].reshape(-1), shots[1:].reshape(-1)
    with np.errstate(invalid="ignore"):
        step = np.abs(echoes.range_m[left] - echoes.range_m[right])
    edges = np.flatnonzero(
        np.isfinite(step) & (step > 2 * _SURFACE_M) & (rng.random(len(left)) < noise.mixed_pixel_share)
    )
    swap = rng.random(len(edges)) < 0.5
    main, other = np.where(swap, right[edges], left[edges]), np.where(swap, left[edges], right[edges])
    share = 0.5 + 0.5 * rng.random(len(edges))
    first, second = echoes.range_m[main], echoes.range_m[other]
    main_power = share * echoes.reflectance[main] / first**2
    other_power = (1 - share) * echoes.reflectance[other] / second**2
    total = np.maximum(main_power + other_power, 1e-30)
    mixed = (main_power * first + other_power * second) / total
    clear = np.minimum(np.abs(mixed - first), np.abs(mixed - second)) > _SURFACE_M
    main, mixed, total = main[clear], mixed[clear], total[clear]
    echoes.range_m[main], echoes.reflectance[main], echoes.label[main] = mixed, total * mixed**2, CLUTTER


def false_returns(
    silent: NDArray[np.int64], min_range_m: float, noise: NoiseParams, rng: np.random.Generator
) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Return the shots without an echo that report a point anyway, with distances and intensities.

    Parameters
    ----------
    silent : ndarray, shape (S,), int64
        Shots without an echo.
    min_range_m : float
        Minimum range of the lidar in metres.
    noise : NoiseParams
        Share and mean distance of false returns.
    rng : numpy.random.Generator
        Source of randomness.

    Returns
    -------
    (ndarray, shape (L,), int64), (ndarray, shape (L,), float64), (ndarray, shape (L,), float64)
        Distances beyond the minimum range are distributed exponentially; intensities are the lowest, 1 to 3.
    """
    if not noise.false_return_share:
        return silent[:0], np.empty(0), np.empty(0)
    chosen = silent[rng.random(len(silent)) < noise.false_return_share]
    ranges = min_range_m + noise.false_return_reach_m * rng.standard_exponential(len(chosen))
    return chosen, ranges, rng.integers(1, 4, len(chosen)).astype(np.float64)
