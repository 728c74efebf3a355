"""What a lidar reports that is not there: the two kinds of noise of S3."""

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
        Share of the beams without an echo that report a near place all the same (lost information).
    false_return_reach_m : float
        Mean distance of these places beyond the least range.
    mixed_pixel_share : float
        Share of the beams across an edge that report a place between the two surfaces (escape values).

    Notes
    -----
    S3 shows both kinds and gives no amount of either; those of the lidars here are assumptions.
    """

    false_return_share: Annotated[float, Interval(ge=0, le=1)] = renamed(0.0, formerly="lost_share")
    false_return_reach_m: Annotated[float, Gt(0)] = renamed(0.6, formerly="lost_reach_m")
    mixed_pixel_share: Annotated[float, Interval(ge=0, le=1)] = renamed(0.0, formerly="edge_share")


NO_NOISE = NoiseParams()


def mix_edges(echoes: Echoes, columns: int, noise: NoiseParams, rng: np.random.Generator) -> None:
    r"""Turn some echoes at edges into escape values.

    Parameters
    ----------
    echoes : Echoes
        Of a turn, column by column; changed in place.
    columns : int
        Columns a turn.
    noise : NoiseParams
        How often.
    rng : numpy.random.Generator
        Source of chance.

    Notes
    -----
    Where the centres of two beams side by side meet different surfaces, the edge runs through one of the two beams:
    either with the same chance, and its larger part, a share s uniform from 0.5 to 1, is on the beam's own surface. The
    light of both parts adds up, so that the beam reports the mean of their ranges weighted by their power,
    :math:`s P_1` and :math:`(1-s) P_2` with :math:`P \propto \rho \cos\theta / R^2`. It is clutter where it is more
    than 10 cm from both.
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
    own, other = np.where(swap, right[edges], left[edges]), np.where(swap, left[edges], right[edges])
    share = 0.5 + 0.5 * rng.random(len(edges))
    first, second = echoes.range_m[own], echoes.range_m[other]
    power = share * echoes.reflectance[own] / first**2
    power_behind = (1 - share) * echoes.reflectance[other] / second**2
    both = np.maximum(power + power_behind, 1e-30)
    mixed = (power * first + power_behind * second) / both
    away = np.minimum(np.abs(mixed - first), np.abs(mixed - second)) > _SURFACE_M
    own, mixed, both = own[away], mixed[away], both[away]
    echoes.range_m[own], echoes.reflectance[own], echoes.label[own] = mixed, both * mixed**2, CLUTTER


def lost_ranges(
    silent: NDArray[np.int64], least_m: float, noise: NoiseParams, rng: np.random.Generator
) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Return which of the shots without an echo report a place all the same, its distance and intensity.

    Parameters
    ----------
    silent : ndarray, shape (S,), int64
        Shots without an echo.
    least_m : float
        Least range of the lidar in metres.
    noise : NoiseParams
        How many, and how near.
    rng : numpy.random.Generator
        Source of chance.

    Returns
    -------
    (ndarray, shape (L,), int64), (ndarray, shape (L,), float64), (ndarray, shape (L,), float64)
        Distances fall off exponentially from the least range; intensities are the least that there are.
    """
    if not noise.false_return_share:
        return silent[:0], np.empty(0), np.empty(0)
    lost = silent[rng.random(len(silent)) < noise.false_return_share]
    ranges = least_m + noise.false_return_reach_m * rng.standard_exponential(len(lost))
    return lost, ranges, rng.integers(1, 4, len(lost)).astype(np.float64)
