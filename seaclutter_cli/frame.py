"""Lidar frames and the results of filtering them."""

from dataclasses import dataclass, field, fields
from enum import IntEnum
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.cloud import INTENSITY_NAMES, Cloud, from_array, structured
from seaclutter_cli.errors import ArrayError, FieldError
from seaclutter_cli.records import Message
from seaclutter_cli.text import printable


class Reason(IntEnum):
    """Reason why a point was removed; `KEPT` if it was not.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.Reason.OUTLIER, int(seaclutter.Reason.OUTLIER), seaclutter.Reason(2).name
    (<Reason.OUTLIER: 4>, 4, 'NEAR')
    """

    KEPT = 0
    INVALID = 1
    NEAR = 2
    LOW_INTENSITY = 3
    OUTLIER = 4
    FAR = 5
    EXCLUDED = 6
    UNCONFIRMED = 7
    MIRRORED = 8


class Attitude(NamedTuple):
    """Rotation from the axes of a lidar to fixed ones, shape (3, 3), and its source: topic, body and number of breaks.

    Only attitudes of one source have the same fixed axes.
    """

    rotation: NDArray[np.float64]
    source: tuple[str, str, int]

    def of_axes(self, axes: NDArray[np.float64]) -> "Attitude":
        """Return the attitude of other axes, given the rotation to them from those of the lidar, shape (3, 3)."""
        return self._replace(rotation=self.rotation @ axes.T)

    def turn_from(self, other: "Attitude | None") -> NDArray[np.float64] | None:
        """Return the rotation from the axes of another attitude to these, shape (3, 3); None if it is not known."""
        return None if other is None or other.source != self.source else self.rotation.T @ other.rotation


@dataclass(frozen=True)
class Frame:
    """A point cloud and its position in a recording; derived arrays are computed once, when first used.

    Parameters
    ----------
    cloud : Cloud
        The points.
    topic : str, optional
        Topic that the frame belongs to.
    stamp_ns : int, optional
        Time of the frame in nanoseconds: the stamp of its header, otherwise its log time.
    index : int, optional
        Index of the frame within its topic, from 0.
    intensity_field : str, optional
        Name of the intensity field; None selects one of `INTENSITY_NAMES`.
    message : Message, optional
        Message that the frame was read from; None for a frame made from arrays.
    attitude : Attitude, optional
        Attitude of the lidar at the time of the frame, for methods that use it and where the log has one.

    Examples
    --------
    >>> import seaclutter
    >>> with seaclutter.open_log("samples/sea.mcap") as log:
    ...     frame = next(log.frames())
    >>> frame.topic, frame.index, frame.stamp_ns, frame.size, frame.intensity_name
    ('/points', 0, 1700000000100000000, 2012, 'intensity')
    """

    cloud: Cloud
    topic: str = "/points"
    stamp_ns: int = 0
    index: int = 0
    intensity_field: str | None = None
    message: Message | None = None
    attitude: Attitude | None = None

    @classmethod
    def of_message(cls, message: Message, cloud: Cloud, index: int, intensity_field: str | None = None) -> Self:
        """Return the frame of a message and the cloud decoded from it."""
        return cls(cloud, message.channel.topic, cloud.stamp_ns or message.log_time_ns, index, intensity_field, message)

    @classmethod
    def of_arrays(
        cls,
        xyz: NDArray[np.floating],
        intensity: NDArray[Any] | None = None,
        *,
        topic: str = "/points",
        stamp_ns: int = 0,
        index: int = 0,
    ) -> Self:
        """Return a frame made from arrays.

        Parameters
        ----------
        xyz : ndarray, shape (N, 3), float32 or float64
            Coordinates in metres in the coordinate frame of the lidar.
        intensity : ndarray, shape (N,), optional
            Intensity in the sensor's unit. If it is missing, methods that need it raise `FieldError`.
        topic, stamp_ns, index : optional
            As for `Frame`.

        Raises
        ------
        ValueError
            If the shapes do not match or an array does not contain numbers.

        Examples
        --------
        >>> Frame.of_arrays(np.array([[3.0, 4.0, 0.0]]), np.array([12])).range_m
        array([5.])
        """
        try:
            points_xyz = np.asarray(xyz)
            values = None if intensity is None else np.asarray(intensity)
        except ValueError as error:
            raise ArrayError(f"xyz and intensity must be arrays ({error})") from error
        if points_xyz.ndim != 2 or points_xyz.shape[1] != 3:
            raise ArrayError(f"xyz must have the shape (N, 3), got {points_xyz.shape}")
        columns = dict(zip("xyz", points_xyz.T, strict=True))
        if values is not None:
            columns["intensity"] = values
        for name, values in columns.items():
            if values.shape != (len(points_xyz),):
                raise ArrayError(f"{name} must have the shape ({len(points_xyz)},), got {values.shape}")
            if values.dtype.kind not in "fiu":
                raise ArrayError(f"{name} must contain numbers, got {values.dtype}")
        return cls(from_array(structured(columns), stamp_ns=stamp_ns), topic, stamp_ns, index)

    @property
    def size(self) -> int:
        """Number of points, N."""
        return self.cloud.size

    @property
    def nbytes(self) -> int:
        """Size in bytes of the message that the frame was read from, otherwise of its points."""
        return len(self.cloud.data if self.message is None else self.message.data)

    @property
    def log_time_ns(self) -> int:
        """Log time of the message in nanoseconds, otherwise the stamp."""
        return self.stamp_ns if self.message is None else self.message.log_time_ns

    @property
    def xyz(self) -> NDArray[np.float64]:
        """Coordinates in metres, shape (N, 3), as a view; raises the errors of `coordinates`."""
        return self.coordinates.T

    @cached_property
    def coordinates(self) -> NDArray[np.float64]:
        """Coordinates in metres, shape (3, N), one contiguous row for each axis.

        Raises
        ------
        FieldError
            If x, y or z is missing or is not a single number.
        """
        return _coordinates(self.cloud.points) if self.size else np.empty((3, 0))

    def coordinates_of(self, index: NDArray[np.integer]) -> NDArray[np.float64]:
        """Return the coordinates of some points in metres, shape (3, n); raises the errors of `coordinates`."""
        return _coordinates(self.cloud.points.take(index))

    def release(self) -> None:
        """Forget coordinates, ranges and intensities, so that the frame takes less memory; they are computed anew."""
        for name in ("coordinates", "intensity", "range_m"):
            vars(self).pop(name, None)

    @cached_property
    def range_m(self) -> NDArray[np.float64]:
        """Distance from the lidar, shape (N,); not finite where a coordinate is not."""
        x, y, z = self.coordinates
        with np.errstate(over="ignore", invalid="ignore"):
            return np.asarray(np.sqrt(x * x + y * y + z * z))

    @cached_property
    def intensity_name(self) -> str | None:
        """Name of the intensity field; None if the cloud has none and `intensity_field` is None."""
        wanted, names = self.intensity_field, self.cloud.dtype.names or ()
        if wanted is None:
            folded = {name.lower(): name for name in reversed(names)}
            return next((folded[usual] for usual in INTENSITY_NAMES if usual in folded), None)
        if wanted not in names and self.size:
            raise FieldError(f"no field {wanted!r}; the cloud has {_listed(names)}")
        return wanted if wanted in names else None

    @cached_property
    def intensity(self) -> NDArray[np.float64]:
        """Intensity in the sensor's unit, shape (N,).

        Raises
        ------
        FieldError
            If the intensity field is missing or is not a single number.
        """
        if not self.size:
            return np.empty(0)
        if self.intensity_name is None:
            names = _listed(self.cloud.dtype.names)
            raise FieldError(f"no intensity field; the cloud has {names}; name one with --intensity-field")
        with np.errstate(invalid="ignore"):
            return _column(self.cloud.points, self.intensity_name).astype(np.float64)

    def other_intensities(self) -> list[str]:
        """Return the names of other fields with a usual name of the intensity that have values other than zero."""
        points = self.cloud.points
        folded = {name.lower(): name for name in points.dtype.names or ()}
        found = [folded[usual] for usual in INTENSITY_NAMES if usual in folded]
        return [name for name in found if name != self.intensity_name and np.nan_to_num(points[name]).any()]

    @cached_property
    def valid(self) -> NDArray[np.bool_]:
        """Whether each point is a return, shape (N,): finite coordinates and intensity, not at the origin."""
        range_m = self.range_m
        valid = range_m > 0
        near_zero = np.flatnonzero(range_m == 0)
        valid[near_zero] = self.coordinates[:, near_zero].any(axis=0)  # squares can underflow to 0
        if not np.isfinite(range_m).all():
            valid &= np.isfinite(self.coordinates).all(axis=0)
        if self.intensity_name is not None:
            valid &= np.isfinite(self.intensity)
        return valid


def _listed(names: tuple[str, ...] | None) -> str:
    return printable(", ".join(names or ())) or "no fields"


def _coordinates(points: NDArray[Any]) -> NDArray[np.float64]:
    xyz = np.empty((3, len(points)))
    with np.errstate(invalid="ignore"):  # converting a signalling NaN warns
        for row, axis in enumerate("xyz"):
            xyz[row] = _column(points, axis)
    return xyz


def _column(points: NDArray[Any], name: str) -> NDArray[Any]:
    if name not in (points.dtype.names or ()):
        raise FieldError(f"no field {name!r}; the cloud has {_listed(points.dtype.names)}")
    if points.dtype[name].shape:
        raise FieldError(f"field {name!r} has {points.dtype[name].shape[0]} values per point; it must have one")
    return points[name]


@dataclass(frozen=True)
class Rings:
    """Thresholds and counts of a frame by range ring; arrays have the shape (K,).

    Parameters
    ----------
    thresholds : ndarray, float64
        Intensity thresholds, :math:`I`.
    corrections : ndarray, float64
        Corrections, :math:`I_m`; 0 where none applies.
    points, low_intensity, outliers : ndarray, int64
        Points in the range ring before filtering, and points removed for each of the two reasons.
    beyond : ndarray, shape (2,), int64
        Points at the end of the last range ring and beyond, before and after filtering.

    Examples
    --------
    >>> import numpy as np
    >>> import seaclutter
    >>> xyz = np.array([[20.0, 0, 0], [20, 1, 0], [30, 0, 0]])
    >>> rings = seaclutter.filter_points(xyz, np.array([90, 8, 30])).rings
    >>> rings.thresholds, rings.points, rings.low_intensity
    (array([30., 16.,  7.,  4.]), array([2, 1, 0, 0]), array([1, 0, 0, 0]))
    """

    thresholds: NDArray[np.float64]
    corrections: NDArray[np.float64]
    points: NDArray[np.int64]
    low_intensity: NDArray[np.int64]
    outliers: NDArray[np.int64]
    beyond: NDArray[np.int64] = field(default_factory=lambda: np.zeros(2, np.int64))

    def __add__(self, other: "Rings") -> "Rings":
        """Return element-wise sums, from which means over frames are computed."""
        return Rings(*(getattr(self, item.name) + getattr(other, item.name) for item in fields(self)))


@dataclass(frozen=True)
class WaterState:
    """The water around the lidar in one frame.

    Parameters
    ----------
    level_m : float
        Height of the water at the lidar, in metres; negative if the lidar is above the water.
    roll_deg, pitch_deg : float
        Attitude against the water; positive if the left side (+y) is up, or the front (+x) down. It is that of the
        lidar, without the mounting that the configuration gives.
    significant_wave_height_m : float
        Four standard deviations of the surface, in metres.
    level_deviation_m : float
        Standard deviation of the error of the level, in metres.

    Examples
    --------
    >>> import seaclutter
    >>> with seaclutter.open_log("samples/sea.mcap") as log:
    ...     frame = next(log.frames())
    >>> method = seaclutter.make_filter("confirmed")
    >>> round(method.step(frame).water.level_m, 1)
    -2.5
    """

    level_m: float
    roll_deg: float
    pitch_deg: float
    significant_wave_height_m: float
    level_deviation_m: float


WATER_REASONS = (Reason.UNCONFIRMED, Reason.MIRRORED)
"""Reasons that only methods have that estimate the water."""

WATER_COLUMNS = ("water_level_m", "roll_deg", "pitch_deg", "significant_wave_height_m", "water_level_deviation_m")
"""Names of the values of `WaterState` in tables and messages."""


@dataclass(frozen=True)
class FilterResult:
    """A frame and the `Reason` of each of its N points.

    Parameters
    ----------
    frame : Frame
        The unfiltered frame.
    reason : ndarray, shape (N,), uint8
        `Reason` of each point; 0 means kept.
    rings : Rings, optional
        Thresholds and counts, for filters that use range rings.
    scene : str, optional
        Class of scene whose preset was used, for filters with presets.
    water : WaterState, optional
        The water, for filters that estimate it and where there is some.
    undecided : ndarray, shape (2, 2), int64, optional
        Objects that evidence does not decide, and their points: those removed, and those kept.

    Examples
    --------
    >>> import numpy as np
    >>> import seaclutter
    >>> result = seaclutter.filter_points(np.array([[20.0, 0, 0], [5, 0, 0]]), np.array([90, 90]))
    >>> result.keep, result.reason, result.counts
    (array([ True, False]), array([0, 2], dtype=uint8), array([1, 0, 1, 0, 0, 0, 0, 0, 0]))
    """

    frame: Frame
    reason: NDArray[np.uint8]
    rings: Rings | None = None
    scene: str | None = None
    water: WaterState | None = None
    undecided: NDArray[np.int64] | None = None

    def __post_init__(self) -> None:
        given, size = self.reason, self.frame.size
        if given.shape != (size,) or given.dtype != np.uint8:
            raise ArrayError(f"reasons must be uint8 of shape ({size},), got {given.dtype} of shape {given.shape}")

    @cached_property
    def keep(self) -> NDArray[np.bool_]:
        """Whether each point is kept, shape (N,)."""
        return np.equal(self.reason, Reason.KEPT)

    @cached_property
    def counts(self) -> NDArray[np.int64]:
        """Number of points for each `Reason`, shape (9,); the first entry counts the points kept."""
        counts = np.bincount(self.reason, minlength=len(Reason))
        if len(counts) > len(Reason):
            raise ArrayError(f"{len(counts) - 1} is none of Reason")
        return counts
