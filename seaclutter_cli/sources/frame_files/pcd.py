"""PCD files of the Point Cloud Library: ascii, binary and binary_compressed."""

import re
import struct
from contextlib import suppress
from pathlib import Path
from typing import Any

import lzf
import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.cloud import Cloud, from_array
from seaclutter_cli.errors import CloudError
from seaclutter_cli.limits import above, limits
from seaclutter_cli.paths import open_regular, read_whole
from seaclutter_cli.sources.frame_files.reading import check_size, parse_rows
from seaclutter_cli.text import count

_SIZES = {"F": ("4", "8"), "U": ("1", "2", "4", "8"), "I": ("1", "2", "4", "8")}
_DATA_LINE = re.compile(rb"^DATA[ \t]+(\w+)[ \t]*\r?(?:\n|\Z)", re.MULTILINE)
_MAX_HEADER = 2**16
_MAX_POINT_BYTES = 2**16
_MAX_RATIO = 100  # LZF expands 3 bytes to at most 264.
_NO_VIEWPOINT = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
_GAP = "_ "  # Field names cannot contain a space.


def read_pcd(path: Path) -> Cloud:
    """Return the points of a PCD file with all fields, height and width; `CloudError` if it is damaged."""
    content = read_whole(path)
    if (match := _DATA_LINE.search(content[:_MAX_HEADER])) is None:
        raise CloudError("no PCD header with a DATA line")
    header = _header(content[: match.start()])
    dtype, (height, width) = _layout(header), _shape(header)
    points = _decode(content, match, dtype, height * width) if height * width else np.empty(0, dtype)
    kept = [name for name in dtype.names or () if not name.startswith(_GAP)]
    return from_array(points if len(kept) == len(dtype.names or ()) else points[kept], height=max(height, 1))


def has_viewpoint(path: Path) -> bool:
    """Return whether a PCD file has a viewpoint other than the origin; the reader does not apply it."""
    with open_regular(path) as file:
        content = file.read(_MAX_HEADER)
    match = _DATA_LINE.search(content)
    words = _header(content[: match.start()]).get("VIEWPOINT") if match else None
    with suppress(ValueError):
        return words is not None and tuple(map(float, words)) != _NO_VIEWPOINT
    return True


def _header(content: bytes) -> dict[str, list[str]]:
    lines = (line.split() for line in content.decode("utf-8", "replace").splitlines())
    return {words[0]: words[1:] for words in lines if words and not words[0].startswith("#")}


def _layout(header: dict[str, list[str]]) -> np.dtype[np.void]:
    names, sizes, types = (header.get(key, []) for key in ("FIELDS", "SIZE", "TYPE"))
    counts = header.get("COUNT", ["1"] * len(names))
    if not (len(names) == len(sizes) == len(types) == len(counts) > 0):
        raise CloudError("the PCD header lacks the SIZE, TYPE or COUNT of a field")
    layout = []
    for index, (name, size, kind, number) in enumerate(zip(names, sizes, types, counts, strict=True)):
        if name == "_" and int(number) == 0:
            continue
        if size not in _SIZES.get(kind, ()) or int(number) < 1:
            raise CloudError(f"field {name!r} has the invalid type {kind}{size} x {number}")
        shape = (int(number),) if int(number) > 1 else ()
        layout.append((f"{_GAP}{index}" if name == "_" else name, f"<{kind.lower()}{size}", shape))
    dtype = np.dtype(layout)
    if dtype.itemsize > _MAX_POINT_BYTES:
        raise CloudError(f"the PCD header declares points of {dtype.itemsize} bytes, more than {_MAX_POINT_BYTES}")
    return dtype


def _shape(header: dict[str, list[str]]) -> tuple[int, int]:
    height, width = (int(header.get(key, ["-1"])[0]) for key in ("HEIGHT", "WIDTH"))
    points = int(header.get("POINTS", [str(height * width)])[0])
    if height < 0 or width < 0 or height * width != points:
        raise CloudError(f"the PCD header is inconsistent: HEIGHT {height}, WIDTH {width}, POINTS {points}")
    return height, width


def _decode(content: bytes, data_line: re.Match[bytes], dtype: np.dtype[np.void], size: int) -> NDArray[Any]:
    encoding, body = data_line[1].decode(), memoryview(content)[data_line.end() :]
    if encoding == "ascii":
        points = parse_rows(bytes(body), dtype, first_line=content.count(b"\n", 0, data_line.end()) + 1)
        if len(points) != size:
            raise CloudError(f"{count(len(points), 'point')} found, but the header declares {size:,}")
        return points
    if encoding == "binary":
        check_size(size * dtype.itemsize, len(body))
        return np.frombuffer(body, dtype, size)
    if encoding == "binary_compressed":
        return _from_columns(_decompress(body, size * dtype.itemsize), dtype, size)
    raise CloudError(f"unknown PCD encoding {encoding!r}; supported: ascii, binary, binary_compressed")


def _decompress(body: memoryview, size: int) -> bytes:
    packed, unpacked = struct.unpack_from("<II", body)
    check_size(packed + 8, len(body))
    if unpacked != size or unpacked > packed * _MAX_RATIO:
        raise CloudError(f"the compressed points declare {count(unpacked, 'byte')}, the header {size:,}")
    if unpacked > limits().file_bytes(packed):
        raise CloudError(f"the points have {above(count(unpacked, 'byte'), 'file_ratio')}")
    content = bytes(body[8 : 8 + packed])
    with suppress(ValueError):
        points: bytes | None = lzf.decompress(content, size)
        if points and len(points) == size:
            return points
    if packed != size:
        raise CloudError("not a valid PCD file: error in compressed data")
    return content  # stored, because compression would not make it smaller


def _from_columns(columns: bytes, dtype: np.dtype[np.void], count: int) -> NDArray[Any]:
    """Return points from data that is stored field by field."""
    points = np.empty(count, dtype)
    at = 0
    for name in dtype.names or ():
        values = points[name]
        values[:] = np.frombuffer(columns, values.dtype, values.size, at).reshape(values.shape)
        at += values.nbytes
    return points
