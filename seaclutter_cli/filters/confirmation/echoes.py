"""The points of a frame that may belong to water or objects: which stand out of the water, are bright or upright."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Bytes, Floats, Indices, Mask
from seaclutter_cli.filters.confirmation import ConfirmedParams
from seaclutter_cli.filters.confirmation.background import Background
from seaclutter_cli.filters.zones import LEAST_M
from seaclutter_cli.frame import Attitude, Frame, Reason
from seaclutter_cli.water import Faces, WaterSurface, WaterTracker
from seaclutter_cli.water.beams import Beams
from seaclutter_cli.water.surface import beside, grid_cells

_GROWTH_SIGMAS = 1.5
_UNSEEN_M = 100.0
_OWN, _SHOWN = 4.0, 12.0
_COMMON = 0.25
_NEIGHBORS = 2 / 3
_RINGS, _MAX_RING, _LEAST_ECHOES, _BRIGHTER = 9, 1000, 3, 4.0
_ALONE, _ROW = 0.75, 8
_MIXED = np.sqrt((2.0, 3.0, 5.0))


@dataclass(frozen=True, eq=False)
class Echoes:
    """The M points of a frame that may belong to water or objects; all arrays but ``xyz``, (3, M), have shape (M,).

    They are valid, not excluded, not far if far points are dropped, and at least 3 m away. ``index`` are their indices
    in the frame, ``xyz`` their coordinates in the levelled frame, ``intensity`` is None if the method ignores it, and
    zone 0 is own ship.
    """

    index: Indices
    xyz: Floats
    range_m: Floats
    intensity: Floats | None
    zone: Bytes

    @classmethod
    def of(cls, frame: Frame, zone: Bytes, reason: Bytes, params: ConfirmedParams) -> "Echoes":
        """Return the echoes among the points of a frame, given their zones and the reasons that follow from them."""
        in_reach = (reason == Reason.KEPT) | (reason == Reason.NEAR)
        index = np.flatnonzero(in_reach & (frame.range_m >= min(LEAST_M, params.own_ship_m)))
        every = len(index) == frame.size  # no copies of whole frames
        used = slice(None) if every else index
        xyz = params.mounting.levelled(frame.coordinates if every else frame.coordinates.take(index, axis=1))
        intensity = frame.intensity[used] if params.use_intensity else None
        return cls(index, xyz, frame.range_m[used], intensity, zone[used])

    @property
    def size(self) -> int:
        """Number of echoes, M."""
        return len(self.index)

    @property
    def is_near(self) -> Mask:
        """Whether they are own ship, shape (M,)."""
        return np.asarray(self.zone == 0)


def repeated(frame: Frame) -> tuple[Indices, Indices]:
    """Return which valid points repeat another one of the frame, and the first of each, both of shape (n,).

    A lidar that records two returns has those of most pulses twice: they are one echo.
    """
    valid = np.flatnonzero(frame.valid)
    x, y, z = xyz = frame.coordinates.take(valid, axis=1)
    key = _MIXED[0] * x + _MIXED[1] * y + _MIXED[2] * z
    ordered = np.sort(key)
    if (ordered[1:] != ordered[:-1]).all():
        return valid[:0], valid[:0]
    order = np.argsort(key, kind="stable")
    same = np.append(False, (xyz[:, order[1:]] == xyz[:, order[:-1]]).all(axis=0))
    first = np.maximum.accumulate(np.where(same, 0, np.arange(len(order))))
    return valid[order[same]], valid[order[first[same]]]


@dataclass(frozen=True)
class Heights:
    """The M echoes of a frame against the water; all arrays have shape (M,).

    Parameters
    ----------
    height_m, rise_m : ndarray, float64
        Height above the water, and height at which a point stands out.
    face_m : ndarray, float64
        Height of the face that a point belongs to.
    linked, loose : ndarray, int32
        Numbers of neighbours that stand out, too, and lie on one surface with a point, or do not.
    high, bright, low, upright, grows, isolated, mirrored : ndarray, bool
        Whether a point stands out; is near the water, reaches its threshold or four times the intensity of the water,
        and is brighter than most water at its range; reaches neither; belongs to a face that water does not have; may
        return to a confirmed object; is where the water has no echoes, or in a row of eight or more where the water has
        no rows as long; is below the water under a body.
    brightness : ndarray, float64
        Intensity divided by the threshold, or by four times that of the water, if less; 0 without thresholds.
    unseen : ndarray, float64
        1 where the water has no echoes but those that an object itself may have, 0 where echoes show it all around.
    alone : ndarray, float64
        The same, or 1 where the water has no echoes at the range of a point, 0 where it has them in a quarter of the
        other directions; for points that neither stand out nor are bright, rows as long as theirs count, not echoes.
    seen : ndarray, float64
        Share of the other directions in which the water has echoes at the range of a point.
    run : ndarray, int32
        Number of echoes in the row of a point: beside each other in one beam, at nearly one range.
    apart : ndarray or None, bool
        Whether a point is in no face and beside none, as wash behind a hull is; None without water.
    awash : ndarray, bool
        Whether a point is bright only, and the water has echoes around it.
    water : WaterSurface or None
        The water; None if it is not seen.
    """

    height_m: Floats
    rise_m: Floats
    face_m: Floats
    linked: NDArray[np.int32]
    loose: NDArray[np.int32]
    high: Mask
    bright: Mask
    low: Mask
    upright: Mask
    grows: Mask
    isolated: Mask
    mirrored: Mask
    brightness: Floats
    unseen: Floats
    alone: Floats
    seen: Floats
    run: NDArray[np.int32]
    apart: Mask | None
    awash: Mask
    water: WaterSurface | None


class Sea:
    """The water and what it shows around a lidar, and its beams, frame by frame, against which echoes are measured."""

    def __init__(self, params: ConfirmedParams) -> None:
        self.params = params
        self.water, self.beams, self._background = WaterTracker(), Beams(params.mounting), Background()

    def measure(
        self,
        echoes: Echoes,
        threshold: Floats,
        time_s: float,
        attitude: Attitude | None = None,
        own: Mask | None = None,
    ) -> Heights:
        """Return the M echoes of the next frame against the water. Without water, every point stands out.

        ``threshold`` are their intensity thresholds, shape (M,); minus infinity beyond the range rings. Those of own
        ship's structure, ``own`` of shape (M,), do not show the water. What is below the water is mirrored or noise.
        """
        x, y, z = echoes.xyz
        self.beams.add(echoes.xyz)
        elevation = self.beams.elevation_deg(echoes.xyz)
        faces = Faces.of(echoes.xyz, elevation, self.beams.gaps(elevation, elevation)[1])
        water = self.water.step(echoes.xyz, faces, time_s, attitude, own)
        if water is None:
            height, deviation, shown = z + _UNSEEN_M, np.zeros(echoes.size), np.zeros(echoes.size)
        else:
            height, deviation, shown = water.above(x, y, z)
        level, sigma = z - height, 0.0 if water is None else water.sigma_m
        rise = np.maximum(self.params.min_rise_m, self.params.rise_sigmas * deviation)
        high = height > rise
        linked, loose = faces.neighbors(high)
        upright = faces.stands(level, sigma)
        if water is None:
            deep = mirrored = np.zeros(echoes.size, np.bool_)
        else:
            deep, mirrored = water.below(x, y, height, deviation, high | upright)
        upright &= ~deep
        bodies = high | upright
        beside_water = np.abs(height) <= rise
        of_water = beside_water & ~upright
        apart = None if water is None else ~beside(grid_cells(x, y), upright)
        ring = np.hypot(x, y) / self.params.cluster_tolerance_m
        reached, brightness = _brightness(echoes, threshold, ring, of_water / faces.run)
        bright = reached & beside_water
        if apart is not None and echoes.intensity is not None:
            bright &= ~_is_common(echoes.intensity, ring, bright & apart)
        unseen = np.clip((_SHOWN - shown) / (_SHOWN - _OWN), 0, 1)
        seen, in_rows = self._background.shares(echoes.xyz, faces.run, of_water, time_s)
        by_echoes, by_rows = (np.maximum(unseen, 1 - share / _COMMON) for share in (seen, in_rows))
        grows = height > np.maximum(self.params.growth_height_m, _GROWTH_SIGMAS * deviation)
        isolated = (by_echoes > _ALONE) & ~deep
        grows |= upright | isolated
        awash = bright & (by_echoes <= _ALONE) & ~bodies
        isolated |= (by_rows > _ALONE) & ~deep & (faces.run >= _ROW)
        alone = np.where(high | bright, by_echoes, by_rows)  # a bright crest in a row is no second sign
        return Heights(
            height,
            rise,
            faces.above_m(level),
            linked,
            loose,
            high,
            bright,
            ~reached,
            upright,
            grows,
            isolated,
            mirrored,
            brightness,
            unseen,
            alone,
            seen,
            faces.run,
            apart,
            awash,
            water,
        )


def _brightness(echoes: Echoes, threshold: Floats, ring: Floats, weight: Floats) -> tuple[Mask, Floats]:
    """Return which points reach their threshold, and intensity divided by threshold.

    Where the water is dark, few of its echoes reach four times its mean intensity, which is the threshold there. Those
    beside each other in one beam have the ``weight`` of one, so that a long log is not taken for water; others have 0.
    """
    if echoes.intensity is None:
        return np.zeros(echoes.size, np.bool_), np.zeros(echoes.size)
    number = np.minimum(ring, _MAX_RING).astype(np.int64)
    count, total = (
        np.convolve(np.bincount(number, one, _RINGS), np.ones(_RINGS), "same")
        for one in (weight, weight * echoes.intensity)
    )
    mean = np.divide(total, count, out=np.full(len(count), np.inf), where=(count >= _LEAST_ECHOES) & (total > 0))
    threshold = np.minimum(threshold, _BRIGHTER * mean[number])
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(threshold > 0, echoes.intensity / threshold, 1.0)
    return echoes.intensity >= threshold, ratio


def _is_common(intensity: Floats, ring: Floats, bright: Mask) -> Mask:
    """Return which bright echoes are not among the brightest at their range, as where the water itself is bright.

    Rings are as wide as the tolerance, so number k has the area of 2 k + 1 circles of neighbours. Echoes that have two
    thirds of a neighbour in the mean join into clusters of three in the mean, the least of an object. With more, all
    the water would join, and what floats on it.
    """
    used = np.flatnonzero(bright)
    number = ring[used].astype(np.int64)
    order = np.lexsort((-intensity[used], number))
    number = number[order]
    rank = np.arange(len(number)) - np.searchsorted(number, number)
    common = np.zeros_like(bright)
    common[used[order[rank >= _NEIGHBORS * (2 * number + 1)]]] = True
    return common
