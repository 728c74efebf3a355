"""Point clouds as views of message bytes, with operations that need no decoding."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import CloudError, FieldError
from seaclutter_cli.records import Buffer
from seaclutter_cli.text import count

FIELD_TYPES = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
"""Types of point fields that every supported message encoding has, as numpy codes."""

INTENSITY_NAMES = (
    *("intensity", "i", "reflectivity", "signal"),
    *("remission", "intensities", "reflectance", "scalar_intensity"),
)
"""Usual names of the intensity field, most likely first; case is ignored."""

_RING_NAMES = ("ring", "channel", "line", "laser_id")

MAX_FIELDS = 1024
"""Number of fields that a cloud may have."""

_MAX_POINT_BYTES = 10_000_000
_MAX_OVERLAP = 8
_MAX_STAMP_NS = 2**63
_MAX_SMALL_POINTS, _XYZ_BYTES = 2**20, 12
"""Few bytes could be very many points, and each point costs memory: more than this must have room for coordinates."""
_FALLBACK = {"b1": "u1", "f2": "f4", "i8": "f8", "u8": "f8"}


@dataclass(frozen=True, slots=True)
class PointField:
    """A field of a point: its offset in bytes and its type, one of `FIELD_TYPES`."""

    name: str
    offset: int
    type: str
    count: int = 1

    @property
    def end(self) -> int:
        """Offset of the first byte after the field; a count of 0, which old drivers write, means one value."""
        return self.offset + int(self.type[1]) * max(self.count, 1)


@lru_cache(maxsize=256)
def point_dtype(fields: tuple[PointField, ...], point_step: int, big_endian: bool) -> np.dtype[np.void]:
    """Return the structured dtype of one point; a repeated name gets an underscore, since names must be distinct.

    `CloudError` if a field does not fit into the point, or the size of a point is negative or greater than 10 MB.
    """
    order = ">" if big_endian else "<"
    if not 0 <= point_step <= _MAX_POINT_BYTES:
        raise CloudError(f"a point must have 0 to {_MAX_POINT_BYTES} bytes, got {point_step}")
    names: dict[str, int] = {}
    formats: list[Any] = []
    for field in fields:
        if not 0 <= field.offset < field.end <= point_step:
            raise CloudError(f"field {field.name!r} does not fit into a point of {count(point_step, 'byte')}")
        names[_next_name(field.name or "unnamed", names)] = 1
        formats.append((order + field.type, (field.count,)) if field.count > 1 else order + field.type)
    offsets = [field.offset for field in fields]
    return np.dtype({"names": list(names), "formats": formats, "offsets": offsets, "itemsize": point_step})


def _next_name(name: str, taken: dict[str, int]) -> str:
    """Return what `free_name` does, in a time that does not depend on how often a name is repeated."""
    name += "_" * (taken[name] - 1 if name in taken else 0)
    start, name = name, free_name(name, taken)
    if start != name:
        taken[start] = len(name) - len(start) + 1
    return name


def free_name(name: str, taken: Collection[str]) -> str:
    """Return a name with as many underscores after it as it takes to be a new one."""
    while name in taken:
        name += "_"
    return name


@dataclass(frozen=True, slots=True)
class Cloud:
    """A point cloud whose points remain in the bytes of the message.

    The stamp of the header is 0 if unknown. Height and width are the number of rows, one for an unorganised cloud, and
    of points per row; the steps are in bytes. A cloud is ``dense`` if the message declares all points valid. ``extra``
    is what only the message encoding uses, needed to write the cloud again. The pose is that of the origin of points
    which are relative to it: position in metres, and orientation as the quaternion x, y, z, w.
    """

    stamp_ns: int
    frame_id: str
    height: int
    width: int
    fields: tuple[PointField, ...]
    point_step: int
    row_step: int
    big_endian: bool
    dense: bool
    data: Buffer
    extra: Any = None
    pose: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        if len(self.fields) > MAX_FIELDS:
            raise CloudError(f"{count(len(self.fields), 'field')}, at most {MAX_FIELDS:,} are supported")
        if not -_MAX_STAMP_NS <= self.stamp_ns < _MAX_STAMP_NS:
            raise CloudError("the stamp of the header is not between the years 1677 and 2262")
        if self.size and self.point_step <= 0:
            raise CloudError(f"point_step must be positive for {count(self.size, 'point')}, got {self.point_step}")
        if self.size and sum(field.end - field.offset for field in self.fields) > _MAX_OVERLAP * self.point_step:
            raise CloudError(f"the fields overlap: they have more than {_MAX_OVERLAP} times the bytes of a point")
        if self._pitch < self.width * self.point_step:
            raise CloudError(
                f"a row of {count(self.row_step, 'byte')} cannot contain {count(self.width, 'point')} of "
                f"{count(self.point_step, 'byte')}"
            )
        if self.size > _MAX_SMALL_POINTS and self.point_step < _XYZ_BYTES:
            raise CloudError(f"{count(self.size, 'point')} of {count(self.point_step, 'byte')} cannot have coordinates")
        needed = (self.height - 1) * self._pitch + self.width * self.point_step if self.size else 0
        if len(self.data) < needed:
            raise CloudError(f"the points occupy {count(needed, 'byte')}, but the message has {len(self.data):,}")
        _ = self.dtype

    @property
    def size(self) -> int:
        """Number of points."""
        return self.height * self.width

    @property
    def ring_name(self) -> str | None:
        """Name of the field with the number of the beam; None without one."""
        return next((name for name in _RING_NAMES if name in (self.dtype.names or ())), None)

    @property
    def dtype(self) -> np.dtype[np.void]:
        """Structured dtype of one point; a cloud without points may have fields but no point step."""
        step = self.point_step if self.size else max((self.point_step, *(field.end for field in self.fields)))
        return point_dtype(self.fields, step, self.big_endian)

    @property
    def _pitch(self) -> int:
        """Bytes from row to row; computed from the width for a single row or if the row step is missing or wrong."""
        is_stated = self.height > 1 and self.row_step and not self.has_wrong_rows
        return self.row_step if is_stated else self.width * self.point_step

    @property
    def has_wrong_rows(self) -> bool:
        """Whether the data are those of rows without padding, but the row step is another."""
        tight = self.width * self.point_step
        return self.height > 1 and self.row_step not in (0, tight) and len(self.data) == self.height * tight

    @property
    def repeated_name(self) -> str | None:
        """Name of several fields, of coordinates or intensities; the first one has it."""
        names = [field.name for field in self.fields]
        return next((name for name in ("x", "y", "z", *INTENSITY_NAMES) if names.count(name) > 1), None)

    @property
    def points(self) -> NDArray[Any]:
        """Points as a structured array, shape (N,): a view, or a copy if the rows are padded."""
        return self._as(self.dtype)

    def _as(self, dtype: np.dtype[Any]) -> NDArray[Any]:
        if self.size == 0:
            return np.empty(0, dtype)
        if self._pitch == self.width * self.point_step:
            return np.frombuffer(self.data, dtype, self.size)
        return self._rows(dtype, self.data).reshape(-1)

    def _rows(self, dtype: np.dtype[Any], data: Buffer | bytearray) -> NDArray[Any]:
        return np.ndarray((self.height, self.width), dtype, data, strides=(self._pitch, self.point_step))

    @property
    def _opaque(self) -> np.dtype[np.void]:
        """Dtype of a point as plain bytes, which copies several times faster than a structured dtype."""
        return np.dtype((np.void, self.dtype.itemsize))

    def select(self, keep: NDArray[np.bool_]) -> "Cloud":
        """Return an unorganised cloud of the points for which ``keep``, shape (N,), is true, in the same order."""
        return self._unorganised(np.take(self._as(self._opaque), np.flatnonzero(keep)), self.fields)

    def blank(self, removed: NDArray[np.bool_]) -> "Cloud":
        """Return a cloud of this shape, NaN where ``removed``, (N,), is true; `FieldError` without floats."""
        self._require_floats("removed points cannot become NaN")
        data = bytearray(self.data)
        if self.size:
            points = self._rows(self.dtype, data)
            for axis in "xyz":
                np.copyto(points[axis], np.nan, where=removed.reshape(points.shape))
        return replace(self, data=memoryview(data), dense=False)

    @property
    def is_moved(self) -> bool:
        """Whether the cloud has a pose other than the origin."""
        return self.pose is not None and any(self.pose[:6])

    def posed(self) -> "Cloud":
        """Return a cloud without pose, whose points are relative to the origin; `FieldError` without floats."""
        if self.pose is None or not self.is_moved:
            return replace(self, pose=None)
        data = bytearray(self.data)
        if self.size:
            points = self._rows(self.dtype, data)
            self._require_floats("the pose of the cloud cannot be applied")
            xyz = np.stack([points[axis].astype(np.float64) for axis in "xyz"])
            moved = np.tensordot(rotation(*self.pose[3:]), xyz, 1)
            for axis, values, origin in zip("xyz", moved, self.pose[:3], strict=True):
                points[axis] = values + origin
        return replace(self, data=memoryview(data), pose=None)

    def _require_floats(self, else_: str) -> None:
        for axis in "xyz":
            if axis not in (self.dtype.names or ()) or self.dtype[axis].kind != "f":
                raise FieldError(f"field {axis!r} is not a floating-point number, so {else_}")

    def with_field(self, name: str, values: NDArray[Any]) -> "Cloud":
        """Return an unorganised cloud with a further last field, shape (N,); a name that exists gets an underscore."""
        kind, opaque = _field_type(values.dtype), self._opaque
        field = PointField(free_name(name, [field.name for field in self.fields]), opaque.itemsize, kind)
        order = ">" if self.big_endian else "<"
        points = np.empty(self.size, [("point", opaque), ("value", order + kind)])
        points["point"] = self._as(opaque)
        points["value"] = values
        return self._unorganised(points, (*self.fields, field))

    def _unorganised(self, points: NDArray[Any], fields: tuple[PointField, ...]) -> "Cloud":
        step, data = points.dtype.itemsize, points.view(np.uint8).data
        return replace(self, height=1, width=len(points), fields=fields, point_step=step, row_step=len(data), data=data)


def rotation(x: float, y: float, z: float, w: float) -> NDArray[np.float64]:
    """Return the rotation matrix of a quaternion of any length; no rotation if all of it is 0."""
    x, y, z, w = np.array((x, y, z, w)) / (np.sqrt(x * x + y * y + z * z + w * w) or 1.0)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + 2 * (w * cross + cross @ cross))


def _field_type(dtype: np.dtype[Any]) -> str:
    code = dtype.str[1:]
    if _FALLBACK.get(code, code) not in FIELD_TYPES:
        raise FieldError(f"a point field cannot have the type {dtype}")
    return _FALLBACK.get(code, code)


def structured(columns: Mapping[str, NDArray[Any]]) -> NDArray[Any]:
    """Return columns of N values, or of N rows of values, as a structured array, shape (N,)."""
    layout = [(name, values.dtype, values.shape[1:]) for name, values in columns.items()]
    points = np.empty(len(next(iter(columns.values()))), layout)
    for name, values in columns.items():
        points[name] = values
    return points


def from_array(points: NDArray[Any], *, stamp_ns: int = 0, frame_id: str = "lidar", height: int = 1) -> Cloud:
    """Return a cloud made from a structured array, shape (N,), with a number of rows that divides N.

    Types that point fields lack are converted: 64-bit integers to float64, booleans to uint8, float16 to float32.
    """
    dtype = points.dtype
    layout = [(name, _field_type(dtype[name].base), dtype[name].shape) for name in dtype.names or ()]
    packed = np.dtype([(name, "<" + code, shape) for name, code, shape in layout])
    fields = tuple(
        PointField(name, packed.fields[name][1], code, int(np.prod(shape, dtype=int)))  # type: ignore[index]
        for name, code, shape in layout
    )
    data = np.ascontiguousarray(points.astype(packed, copy=False))
    width = len(points) // height if height else 0
    step = packed.itemsize
    return Cloud(stamp_ns, frame_id, height, width, fields, step, width * step, False, False, data.view(np.uint8).data)
