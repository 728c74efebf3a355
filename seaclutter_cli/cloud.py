"""A point cloud as a view on message bytes, and what can be done with it without decoding it."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import CloudError, FieldError
from seaclutter_cli.records import Buffer

FIELD_TYPES = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
"""Point field types that every supported message encoding knows, as numpy codes."""

_FALLBACK = {"b1": "u1", "f2": "f4", "i8": "f8", "u8": "f8"}


@dataclass(frozen=True, slots=True)
class PointField:
    """One field of a point: its place and type; ``type`` is one of `FIELD_TYPES`."""

    name: str
    offset: int
    type: str
    count: int = 1


@lru_cache(maxsize=256)
def point_dtype(fields: tuple[PointField, ...], point_step: int, big_endian: bool) -> np.dtype[np.void]:
    """Return the structured dtype of one point.

    Names that occur twice get a number, since a dtype needs distinct ones.

    Raises
    ------
    CloudError
        If a field does not fit into the point.

    Examples
    --------
    >>> point_dtype((PointField("x", 0, "f4"), PointField("ring", 5, "u2")), 8, False).itemsize
    8
    """
    order = ">" if big_endian else "<"
    names: list[str] = []
    formats: list[Any] = []
    for field in fields:
        name = field.name or "unnamed"
        while name in names:
            name += "_"
        names.append(name)
        base = np.dtype(order + field.type)
        formats.append((base, (field.count,)) if field.count > 1 else base)
        if field.offset + base.itemsize * max(field.count, 1) > point_step:
            raise CloudError(f"field {field.name!r} ends beyond the point of {point_step} bytes")
    offsets = [field.offset for field in fields]
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": point_step})


@dataclass(frozen=True, slots=True)
class Cloud:
    """A point cloud, its points still in the bytes of the message.

    Parameters
    ----------
    stamp_ns : int
        Stamp of the header; 0 where nothing is known.
    frame_id : str
        Coordinate frame.
    height, width : int
        Rows and points per row. An unorganised cloud has one row.
    fields : tuple of PointField
        Layout of a point.
    point_step, row_step : int
        Bytes from point to point and from row to row.
    big_endian, dense : bool
        Byte order of the points; whether none of them is declared invalid.
    data : bytes or memoryview
        The points' bytes.
    extra : object
        What only the message encoding knows and needs again to write the cloud.
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

    def __post_init__(self) -> None:
        """Check that the layout fits the data."""
        if self.size == 0:
            return
        if self.point_step <= 0:
            raise CloudError(f"a cloud of {self.size} points has a point step of {self.point_step}")
        if self.row_step < self.width * self.point_step:
            raise CloudError(
                f"a row of {self.row_step} bytes cannot hold {self.width} points of {self.point_step} bytes"
            )
        needed = (self.height - 1) * self.row_step + self.width * self.point_step
        if len(self.data) < needed:
            raise CloudError(f"{self.size} points need {needed} bytes, the message has {len(self.data)}")

    @property
    def size(self) -> int:
        """Number of points."""
        return self.height * self.width

    @property
    def dtype(self) -> np.dtype[np.void]:
        """Structured dtype of one point."""
        return point_dtype(self.fields, self.point_step, self.big_endian)

    @property
    def points(self) -> NDArray[Any]:
        """Points as a structured array, shape (N,): a view, but for padded rows of an organised cloud."""
        return self._as(self.dtype)

    def _as(self, dtype: np.dtype[Any]) -> NDArray[Any]:
        if self.size == 0:
            return np.empty(0, dtype)
        if self.height == 1 or self.row_step == self.width * self.point_step:
            return np.frombuffer(self.data, dtype, self.size)
        strides = (self.row_step, self.point_step)
        return np.ndarray((self.height, self.width), dtype, self.data, strides=strides).reshape(-1)

    def select(self, keep: NDArray[np.bool_]) -> "Cloud":
        """Return an unorganised cloud of the points where ``keep``, shape (N,), is true, in their order."""
        # Opaque items copy several times faster than structured ones.
        points = np.take(self._as(np.dtype((np.void, max(self.point_step, 1)))), np.flatnonzero(keep))
        return _unorganised(self, points)

    def blank(self, removed: NDArray[np.bool_]) -> "Cloud":
        """Return the cloud with its shape kept and NaN coordinates where ``removed``, shape (N,), is true.

        Raises
        ------
        FieldError
            If the coordinates are not floating-point numbers.
        """
        data = bytearray(self.data)
        strides = (self.row_step, self.point_step)
        points: NDArray[Any] = np.ndarray((self.height, self.width), self.dtype, data, strides=strides)
        for axis in "xyz":
            if points.dtype[axis].kind != "f":
                raise FieldError(f"field {axis!r} is no floating-point number, so an organised cloud cannot hold NaN")
            points[axis][removed.reshape(points.shape)] = np.nan
        return replace(self, data=bytes(data), dense=False)

    def with_field(self, name: str, values: NDArray[Any]) -> "Cloud":
        """Return an unorganised cloud with one more field behind the others; values of shape (N,)."""
        values = np.asarray(values)
        field = PointField(name, self.point_step, _field_type(values.dtype))
        step = self.point_step + values.dtype.itemsize
        points = np.empty((self.size, step), np.uint8)
        points[:, : self.point_step] = (
            self._as(np.dtype((np.void, self.point_step))).view(np.uint8).reshape(self.size, -1)
        )
        tail = np.ascontiguousarray(values.astype(values.dtype.newbyteorder(">" if self.big_endian else "<")))
        points[:, self.point_step :] = tail.view(np.uint8).reshape(self.size, -1)
        return _unorganised(replace(self, fields=(*self.fields, field), point_step=step, height=0), points)


def _unorganised(cloud: Cloud, points: NDArray[Any]) -> Cloud:
    data = points.reshape(-1).view(np.uint8).data
    return replace(cloud, height=1, width=len(points), row_step=len(data), data=data)


def _field_type(dtype: np.dtype[Any]) -> str:
    code = dtype.str[1:]
    if _FALLBACK.get(code, code) not in FIELD_TYPES:
        raise FieldError(f"a point field cannot be of type {dtype}")
    return _FALLBACK.get(code, code)


def from_array(points: NDArray[Any], *, stamp_ns: int = 0, frame_id: str = "lidar", height: int = 1) -> Cloud:
    """Return a cloud over a structured array.

    Parameters
    ----------
    points : ndarray, shape (N,)
        Structured. 64-bit integers, which no point field can hold, become float64, booleans uint8, float16 float32.
    stamp_ns : int, optional
        Stamp of the header.
    frame_id : str, optional
        Coordinate frame.
    height : int, optional
        Rows; must divide N.

    Examples
    --------
    >>> from_array(np.zeros(3, [("x", "f4"), ("y", "f4"), ("t", "u8")])).fields[2]
    PointField(name='t', offset=8, type='f8', count=1)
    """
    dtype = points.dtype
    layout: list[tuple[str, str, tuple[int, ...]]] = []
    for name in _names(dtype):
        base, shape = dtype[name].base, dtype[name].shape
        layout.append((name, _field_type(base), shape))
    packed = np.dtype([(name, "<" + code, shape) for name, code, shape in layout])
    fields = tuple(
        PointField(name, packed.fields[name][1], code, int(np.prod(shape, dtype=int)))  # type: ignore[index]
        for name, code, shape in layout
    )
    data = np.ascontiguousarray(points.astype(packed, copy=False))
    width = len(points) // height if height else 0
    buffer = data.view(np.uint8).data if data.size else b""
    step = packed.itemsize
    return Cloud(stamp_ns, frame_id, height, width, fields, step, width * step, False, False, buffer)


def _names(dtype: np.dtype[Any]) -> Iterable[str]:
    return dtype.names or ()
