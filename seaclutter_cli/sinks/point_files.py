"""Files of single point clouds: frames of a recording, and tiles."""

import zipfile
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Floats
from seaclutter_cli.cloud import Cloud, free_name, from_array, structured
from seaclutter_cli.errors import OutputError
from seaclutter_cli.messages import CODECS
from seaclutter_cli.messages.definitions import ros2_schema
from seaclutter_cli.records import Channel, Metadata
from seaclutter_cli.sinks.las import import_laspy
from seaclutter_cli.sinks.mcap_writer import McapWriter
from seaclutter_cli.text import count

_TYPE = "sensor_msgs/msg/PointCloud2"
_PLY = {"i1": "char", "u1": "uchar", "i2": "short", "u2": "ushort", "i4": "int", "u4": "uint", "f4": "float"}
_PLY_NAMES = {**_PLY, "f8": "double"}
_PACKED = ("X", "Y", "Z")
"""Dimensions of LAS with the whole numbers of the coordinates."""
_LAS_SCALE, _LAS_STEPS, _LAS_NAME_BYTES = 1e-4, 4e9, 32
_LAS_POINT_BYTES, _LAS_DIMENSIONS = 2**16 - 1, (2**16 - 1) // 192
"""Limits of LAS: bytes of a point, and extra dimensions, whose descriptions are one record."""
NO_COORDINATES, TOO_FAR, NAMES = "without coordinates", "too far away", "full names of fields"
Lost = Counter[str]
"""Number of points that a file cannot contain, by the reason; `NAMES` if names of fields had to be changed."""
FrameWriter = Callable[[BinaryIO, Cloud], Lost | None]
"""Function that writes a cloud to a file, and returns what that cannot contain."""
_ZIP_TIME = (1980, 1, 1, 0, 0, 0)


def with_columns(cloud: Cloud, columns: Mapping[str, NDArray[Any]]) -> Cloud:
    """Return an unorganised cloud with columns of shape (N,) added or, if fields of that name exist, replaced."""
    points = cloud.points
    kept = {name: points[name] for name in points.dtype.names or () if name not in columns}
    return replace(from_array(structured({**kept, **columns})), stamp_ns=cloud.stamp_ns, frame_id=cloud.frame_id)


def _write_pcd(stream: BinaryIO, cloud: Cloud) -> Lost:
    """Write a binary PCD file with all fields; an organised cloud keeps its height and width."""
    packed, lost = _packed(cloud)
    names = _words(field.name for field in packed.fields)
    lost += Lost({NAMES: int(names != [field.name for field in packed.fields])})
    rows = {
        "FIELDS": names,
        "SIZE": [field.type[1] for field in packed.fields],
        "TYPE": [field.type[0].upper() for field in packed.fields],
        "COUNT": [str(max(field.count, 1)) for field in packed.fields],
    }
    lines = ["# .PCD v0.7 - Point Cloud Data file format", "VERSION 0.7"]
    lines += [f"{key} {' '.join(values)}" for key, values in rows.items()]
    lines += [f"WIDTH {packed.width}", f"HEIGHT {packed.height}", "VIEWPOINT 0 0 0 1 0 0 0"]
    lines += [f"POINTS {packed.size}", "DATA binary", ""]
    stream.write("\n".join(lines).encode())
    stream.write(packed.data)
    return lost


def _write_ply(stream: BinaryIO, cloud: Cloud) -> None:
    """Write a binary PLY file of a packed cloud; each value of a field with several values becomes a property."""
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {cloud.size}"]
    for name, field in zip(_words(field.name for field in cloud.fields), cloud.fields, strict=True):
        names = [name] if field.count <= 1 else [f"{name}_{number}" for number in range(field.count)]
        lines += [f"property {_PLY_NAMES[field.type]} {each}" for each in names]
    stream.write("\n".join([*lines, "end_header", ""]).encode(errors="replace"))
    stream.write(cloud.data)


def write_mcap(stream: BinaryIO, clouds: Iterable[Cloud], *metadata: Metadata) -> None:
    """Write clouds, numbered from 0, as ROS 2 PointCloud2 on ``/points`` of an MCAP file."""
    writer = McapWriter(stream, profile="ros2")
    try:
        for record in metadata:
            writer.add_metadata(record)
        writer.add_channel(Channel(1, "/points", "cdr", ros2_schema(_TYPE)))
        encode = CODECS[_TYPE, "cdr"].encode
        for number, one in enumerate(clouds):
            writer.write(1, one.stamp_ns, one.stamp_ns, number, encode(one))
        writer.finish()
    except BaseException:
        writer.abort()
        raise


def _write_npz(stream: BinaryIO, cloud: Cloud) -> Lost:
    """Write an array for each field, of shape (N,), or (height, width) of an organised cloud, and the stamp.

    A field with several values has one more axis. ``stamp_ns`` and ``frame_id`` are arrays without axes, unless fields
    have these names.
    """
    shape = (cloud.height, cloud.width) if cloud.height > 1 else (cloud.size,)
    packed, lost = _packed(cloud)
    points = packed.points
    arrays: dict[str, NDArray[Any]] = {
        name: points[name].reshape(shape + points.dtype[name].shape) for name in points.dtype.names or ()
    }
    arrays.setdefault("stamp_ns", np.array(cloud.stamp_ns, np.int64))
    arrays.setdefault("frame_id", np.array(_utf8(cloud.frame_id)))
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        for name, values in arrays.items():
            entry = zipfile.ZipInfo(f"{name}.npy", _ZIP_TIME)  # the same bytes in every run
            with archive.open(entry, "w", force_zip64=True) as file:
                np.lib.format.write_array(file, values, allow_pickle=False)
    return lost


def _write_las(stream: BinaryIO, cloud: Cloud, *, packed: bool) -> Lost:
    """Write a LAS 1.4 or a LAZ file, and return the number of points that it cannot contain.

    They are those without coordinates, and those more than 200 km from the others: coordinates have a resolution of
    0.1 mm. Fields with the name and the type of a
    dimension of LAS are stored in it, all others in extra dimensions, those with several values in one for each value.
    An intensity that is no 8 or 16 bit number is rounded, and also stored as ``original_intensity``.

    `MissingExtraError` if laspy or its LAZ backend is not installed; `OutputError` if LAS has no room for the fields.
    """
    laspy = import_laspy(packed=packed)
    _require_room(cloud)
    whole, lost = _packed(cloud)
    points = whole.points
    names = points.dtype.names or ()
    xyz = np.array([points[axis] if axis in names else np.zeros(len(points)) for axis in "xyz"], np.float64)
    valid = np.isfinite(xyz).all(axis=0)
    with np.errstate(invalid="ignore", over="ignore"):
        middle = np.median(xyz[:, valid], axis=1, keepdims=True) if valid.any() else np.zeros((3, 1))
        near = valid & (np.abs(xyz - middle) < _LAS_SCALE * _LAS_STEPS / 2).all(axis=0)
    lost += Lost({NO_COORDINATES: np.count_nonzero(~valid), TOO_FAR: np.count_nonzero(valid & ~near)})
    points, xyz = points[near], xyz[:, near]
    header = laspy.LasHeader(point_format=7 if {"red", "green", "blue"} <= set(names) else 6, version="1.4")
    header.creation_date = datetime.fromtimestamp(max(cloud.stamp_ns, 0) // 10**9, UTC).date()
    header.generating_software = "seaclutter"
    header.global_encoding.wkt = True  # LAS 1.4 requires it from point format 6, also without a reference system
    header.scales, header.offsets = np.full(3, _LAS_SCALE), _offsets(xyz)
    columns, shortened = _las_columns(laspy, header, points)
    lost += Lost({NAMES: int(shortened)})
    las = laspy.LasData(header, laspy.ScaleAwarePointRecord.zeros(len(points), header=header))
    las.x, las.y, las.z = xyz
    for name, values in columns.items():
        las[name] = values
    las.write(stream, do_compress=packed, laz_backend=laspy.LazBackend.LazrsParallel if packed else None)
    return lost


def _require_room(cloud: Cloud) -> None:
    """Raise `OutputError` if LAS has no room for the values of a point; all but a few are extra dimensions."""
    values = sum(max(field.count, 1) for field in cloud.fields)
    size = sum(field.end - field.offset for field in cloud.fields)
    if values > _LAS_DIMENSIONS or size > _LAS_POINT_BYTES - 100:
        raise OutputError(
            f"LAS has room for {_LAS_DIMENSIONS} values of a point, but the cloud has {count(values, 'value')} of "
            f"{count(size, 'byte')}; write npz or pcd"
        )


def _offsets(xyz: Floats) -> Floats:
    """Return offsets with which all coordinates fit into 32 bits: zero where possible."""
    if not xyz.size:
        return np.zeros(3)
    is_far = np.abs(xyz).max(axis=1) > _LAS_SCALE * 2**30
    return np.where(is_far, np.floor((xyz.min(axis=1) + xyz.max(axis=1)) / 2), 0.0)


def _las_columns(laspy: Any, header: Any, points: NDArray[Any]) -> tuple[dict[str, NDArray[Any]], bool]:
    """Return all dimensions but coordinates, after adding what LAS lacks to the header; whether a name was cut."""
    standard = {dimension.name: dimension for dimension in header.point_format.standard_dimensions}
    columns: dict[str, NDArray[Any]] = {}
    extra: dict[str, NDArray[Any]] = {}
    wished = set[str]()
    for name in points.dtype.names or ():
        values = points[name]
        if name in ("x", "y", "z"):
            continue
        if name == "intensity":
            columns[name] = np.clip(np.nan_to_num(np.rint(values.astype(np.float64))), 0, 2**16 - 1).astype(np.uint16)
        if name in standard and name not in _PACKED and _fits(values, standard[name]):
            columns[name] = values
        elif values.ndim == 1:
            wished.add(new := f"original_{name}" if name in (*standard, *_PACKED) else name)
            extra[_free(new, extra)] = values
        else:
            for number, part in enumerate(values.reshape(len(values), int(np.prod(values.shape[1:]))).T):
                wished.add(new := f"{name}_{number}")
                extra[_free(new, extra)] = part
    header.add_extra_dims([laspy.ExtraBytesParams(name, values.dtype.str[1:]) for name, values in extra.items()])
    return columns | extra, not wished.issuperset(extra)


def _fits(values: NDArray[Any], dimension: Any) -> bool:
    """Return whether a dimension of LAS holds values exactly."""
    if values.ndim != 1 or values.dtype.kind not in "ui" or dimension.kind.name == "FloatingPoint":
        return values.ndim == 1 and values.dtype == np.float64 and dimension.kind.name == "FloatingPoint"
    if values.dtype.itemsize * 8 > max(dimension.num_bits, 8):
        return False
    least, most = (0, 2**dimension.num_bits - 1) if dimension.min >= 0 else (dimension.min, dimension.max)
    return not len(values) or (int(values.min()) >= least and int(values.max()) <= most)


def _free(name: str, taken: Mapping[str, object]) -> str:
    """Return a name that is short enough for LAS and not taken."""
    number, short = 1, name.encode()[:_LAS_NAME_BYTES].decode(errors="ignore")
    while short in taken:
        end = f"_{number}"
        short = name.encode()[: _LAS_NAME_BYTES - len(end)].decode(errors="ignore") + end
        number += 1
    return short


def _packed(cloud: Cloud) -> tuple[Cloud, Lost]:
    """Return a cloud without gaps between the fields, in little endian, with distinct names in UTF-8."""
    named = replace(cloud, fields=tuple(replace(field, name=_utf8(field.name)) for field in cloud.fields))
    whole = from_array(named.points, stamp_ns=cloud.stamp_ns, frame_id=cloud.frame_id, height=max(cloud.height, 1))
    return whole, Lost({NAMES: int(named.fields != cloud.fields)})


def _utf8(text: str) -> str:
    """Return text with a question mark for what is not UTF-8."""
    return text.encode(errors="replace").decode()


def _words(names: Iterable[str]) -> list[str]:
    """Return names as distinct words; a single underscore is padding in PCD files."""
    words = {"_": None}
    for name in names:
        words[free_name("".join("_" if c.isspace() else c for c in name), words)] = None
    return list(words)[1:]


FRAME_WRITERS: Mapping[str, FrameWriter] = {
    "pcd": _write_pcd,
    "las": partial(_write_las, packed=False),
    "laz": partial(_write_las, packed=True),
    "npz": _write_npz,
}
"""Writers of frames by the name of the format; they return what a file cannot contain."""

POINT_WRITERS: Mapping[str, FrameWriter] = {
    ".pcd": _write_pcd,
    ".ply": _write_ply,
    ".mcap": lambda stream, cloud: write_mcap(stream, [cloud]),
}
"""Writers of tiles, as unorganised, packed clouds, by file extension. To add a format, add a line here."""
