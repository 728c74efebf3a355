"""One lidar frame, and what a filter says about its points."""

from dataclasses import dataclass, fields
from enum import IntEnum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.cloud import Cloud
from seaclutter_cli.errors import FieldError, printable
from seaclutter_cli.records import Message

INTENSITY_NAMES = (
    "intensity",
    "i",
    "reflectivity",
    "signal",
    "remission",
    "intensities",
    "reflectance",
    "scalar_intensity",
)
"""Usual names of the intensity field, the likeliest first; upper and lower case are the same."""


class Reason(IntEnum):
    """Why a point was removed."""

    KEPT = 0
    INVALID = 1
    NEAR = 2
    LOW_INTENSITY = 3
    OUTLIER = 4
    FAR = 5
    EXCLUDED = 6


@dataclass(frozen=True)
class Frame:
    """A point cloud with its place in the log. What filters need of it is computed once, when first asked for.

    Parameters
    ----------
    cloud : Cloud
        The points.
    message : Message
        The record that the cloud came in.
    index : int
        Number of the frame within its topic, from 0.
    intensity_field : str, optional
        Name of the intensity field; None looks for one of `INTENSITY_NAMES`.
    """

    cloud: Cloud
    message: Message
    index: int
    intensity_field: str | None = None

    @property
    def topic(self) -> str:
        """Topic of the frame."""
        return self.message.channel.topic

    @property
    def size(self) -> int:
        """Number of points, N."""
        return self.cloud.size

    @property
    def stamp_ns(self) -> int:
        """Stamp of the header, else the log time."""
        return self.cloud.stamp_ns or self.message.log_time_ns

    @cached_property
    def xyz(self) -> NDArray[np.float64]:
        """Coordinates in metres, shape (3, N).

        Raises
        ------
        FieldError
            If the cloud has no x, y or z, or one that is no number.
        """
        points = self.cloud.points
        xyz = np.empty((3, len(points)))
        with np.errstate(invalid="ignore"):  # a signalling NaN is a NaN
            for row, axis in enumerate("xyz"):
                xyz[row] = _column(points, axis)
        return xyz

    @cached_property
    def range_m(self) -> NDArray[np.float64]:
        """Distance from the lidar, shape (N,); not finite where a coordinate is not."""
        x, y, z = self.xyz
        with np.errstate(over="ignore", invalid="ignore"):
            return np.asarray(np.sqrt(x * x + y * y + z * z))

    @cached_property
    def intensity_name(self) -> str | None:
        """Name of the intensity field; None if there is none and none was asked for."""
        names = self.cloud.dtype.names or ()
        if self.intensity_field is not None:
            if self.intensity_field not in names:
                raise FieldError(f"no field {self.intensity_field!r}; the cloud has {_listed(names)}")
            return self.intensity_field
        folded = {name.lower(): name for name in reversed(names)}
        return next((folded[usual] for usual in INTENSITY_NAMES if usual in folded), None)

    @cached_property
    def intensity(self) -> NDArray[np.float64]:
        """Intensity in the sensor's unit, shape (N,).

        Raises
        ------
        FieldError
            If the cloud has no intensity field, or one that is no number.
        """
        if self.intensity_name is None:
            names = _listed(self.cloud.dtype.names)
            raise FieldError(f"no intensity field; the cloud has {names}: name one with --intensity-field")
        with np.errstate(invalid="ignore"):
            return _column(self.cloud.points, self.intensity_name).astype(np.float64)

    @cached_property
    def valid(self) -> NDArray[np.bool_]:
        """Whether a point is a return, shape (N,): finite coordinates and intensity, not exactly at the origin."""
        range_m = self.range_m
        valid = range_m > 0
        near_zero = np.flatnonzero(range_m == 0)
        valid[near_zero] = self.xyz[:, near_zero].any(axis=0)  # a square can be 0 where a coordinate is not
        if not np.isfinite(range_m).all():
            valid &= np.isfinite(self.xyz).all(axis=0)
        if self.intensity_name is not None:
            valid &= np.isfinite(self.intensity)
        return valid


def _listed(names: tuple[str, ...] | None) -> str:
    return printable(", ".join(names or ())) or "no fields"


def _column(points: NDArray[Any], name: str) -> NDArray[Any]:
    if name not in (points.dtype.names or ()):
        raise FieldError(f"no field {name!r}; the cloud has {_listed(points.dtype.names)}")
    if points.dtype[name].shape:
        raise FieldError(f"field {name!r} holds {points.dtype[name].shape[0]} values a point, one is needed")
    return points[name]


@dataclass(frozen=True)
class Rings:
    """What a ring filter did in one frame; every array has shape (K,), one value a ring.

    Parameters
    ----------
    thresholds : ndarray, float64
        Intensity thresholds used, :math:`I`.
    corrections : ndarray, float64
        Corrections used, :math:`I_m`; 0 where none applied.
    points, low_intensity, outliers : ndarray, int64
        Points in the ring before the filter, and those removed for each reason.
    """

    thresholds: NDArray[np.float64]
    corrections: NDArray[np.float64]
    points: NDArray[np.int64]
    low_intensity: NDArray[np.int64]
    outliers: NDArray[np.int64]

    def __add__(self, other: "Rings") -> "Rings":
        """Return the sums, for means over frames."""
        return Rings(*(getattr(self, item.name) + getattr(other, item.name) for item in fields(self)))


@dataclass(frozen=True)
class FilterResult:
    """A frame and one `Reason` a point, so that all who come after the filter see the same N points.

    Parameters
    ----------
    frame : Frame
        The frame as it was read.
    reason : ndarray, shape (N,), uint8
        `Reason` of each point; 0 means kept.
    rings : Rings, optional
        Present for filters that work in rings.
    scene : str, optional
        Class of scene whose parameters went; present for filters that know scenes.
    """

    frame: Frame
    reason: NDArray[np.uint8]
    rings: Rings | None = None
    scene: str | None = None

    @cached_property
    def keep(self) -> NDArray[np.bool_]:
        """Whether a point is kept, shape (N,)."""
        return np.equal(self.reason, Reason.KEPT)

    @cached_property
    def counts(self) -> NDArray[np.int64]:
        """Number of points for each `Reason`, shape (7,); the first entry counts those kept."""
        return np.bincount(self.reason, minlength=len(Reason))
