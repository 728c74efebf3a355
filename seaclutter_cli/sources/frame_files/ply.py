"""PLY files: the vertices of ascii, little-endian and big-endian files."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.cloud import Cloud, from_array
from seaclutter_cli.errors import CloudError
from seaclutter_cli.paths import read_whole
from seaclutter_cli.sources.frame_files.reading import check_size, parse_rows

_SHORT = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"}
_SIZED = {"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"}
_TYPES = _SHORT | _SIZED | {"float": "f4", "float32": "f4", "double": "f8", "float64": "f8"}
_ORDERS = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}
_HEADER = re.compile(rb"\Aply\s*?\n(.*?)^end_header[ \t]*\r?(?:\n|\Z)", re.DOTALL | re.MULTILINE)
_MAX_HEADER = 2**20


@dataclass
class _Element:
    name: str
    count: int
    properties: list[tuple[str, str]] = field(default_factory=list)
    lists: list[str] = field(default_factory=list)

    def dtype(self, order: str) -> np.dtype[np.void]:
        if self.lists:
            raise CloudError(f"property {self.lists[0]!r} of element {self.name!r} is a list; lists are not supported")
        return np.dtype([(name, order + code) for name, code in self.properties])


def read_ply(path: Path) -> Cloud:
    """Return the vertices of a PLY file with all their properties; `CloudError` if it is damaged, or has lists."""
    content = read_whole(path)
    if (match := _HEADER.match(content[:_MAX_HEADER])) is None:
        raise CloudError("no PLY header from 'ply' to 'end_header'")
    encoding, elements = _parse_header(match[1].decode("utf-8", "replace"))
    names = [element.name for element in elements]
    if "vertex" not in names:
        raise CloudError(f"no element 'vertex'; the file has {', '.join(names) or 'none'}")
    at = names.index("vertex")
    head, body = content[: match.end()], memoryview(content)[match.end() :]
    if encoding == "ascii":
        return from_array(_read_ascii(body, elements[:at], elements[at], head.count(b"\n") + 1))
    order, vertex = _ORDERS[encoding], elements[at]
    dtype = vertex.dtype(order)
    start = sum(element.count * element.dtype(order).itemsize for element in elements[:at])
    check_size(start + vertex.count * dtype.itemsize, len(body))
    return from_array(np.frombuffer(body, dtype, vertex.count, start))


def _parse_header(text: str) -> tuple[str, list[_Element]]:
    encoding, elements = "", list[_Element]()
    for line in text.splitlines():
        match line.split():
            case ["format", kind, _] if kind in _ORDERS:
                encoding = kind
            case ["element", name, count]:
                elements.append(_Element(name, int(count)))
            case ["property", "list", _, _, name] if elements:
                elements[-1].lists.append(name)
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].properties.append((name, _TYPES[kind]))
            case [] | ["comment" | "obj_info", *_]:
                pass
            case _:
                raise CloudError(f"invalid line in the PLY header: {line[:60]!r}")
    if not encoding:
        raise CloudError("the PLY header has no format line")
    return encoding, elements


def _read_ascii(body: memoryview, before: Sequence[_Element], vertex: _Element, line: int) -> NDArray[Any]:
    dtype = vertex.dtype("<")
    skipped = sum(element.count for element in before)
    check_size(skipped + vertex.count * 2 * len(vertex.properties) - 1, len(body))
    rest = bytes(body).split(b"\n", skipped)[skipped:]
    points = parse_rows(rest[0] if rest else b"", dtype, first_line=line + skipped, max_rows=vertex.count)
    if len(points) != vertex.count:
        declared = f"the header declares {vertex.count:,} vertices"
        raise CloudError(f"{declared}, but the file contains {len(points):,}; it is truncated")
    return points
