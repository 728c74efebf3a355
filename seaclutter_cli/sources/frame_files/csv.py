"""Points as lines of text: CSV with any usual separator, and the XYZ files of other tools."""

import io
import re
from itertools import islice
from pathlib import Path

import numpy as np

from seaclutter_cli.cloud import Cloud, from_array
from seaclutter_cli.errors import CloudError
from seaclutter_cli.sources.frame_files.reading import (
    MAX_LINE_BYTES,
    check_lines,
    column_names,
    is_number,
    parse_rows,
)

_BOM = b"\xef\xbb\xbf"
_MAX_HEAD_LINES = 1000


def read_csv(path: Path) -> Cloud:
    """Return the points of a text file, every column float64, empty cells NaN; `CloudError` if a line is not valid.

    Names of columns, in the first line after an optional ``#``, contain x, y and z; without, see `column_names`.
    """
    content = path.read_bytes().removeprefix(_BOM)
    check_lines(content)
    names, delimiter, body, line = _head(content)
    if delimiter is not None:
        body, line = _fill_empty_cells(body, delimiter.encode()), line - 1
    dtype = np.dtype([(name, "<f8") for name in names])
    return from_array(parse_rows(body, dtype, delimiter=delimiter, first_line=line))


def is_point_table(path: Path) -> bool:
    """Return whether a text file starts like a table of points; tables of results and settings do not."""
    with path.open("rb") as file:
        start = file.read(MAX_LINE_BYTES).removeprefix(_BOM)
    try:
        _head(start)
    except CloudError:
        return False
    return True


def _head(content: bytes) -> tuple[tuple[str, ...], str | None, bytes, int]:
    """Return the column names, the separator, the lines of points, and the number of the first of these lines."""
    at = 0
    for number, raw in enumerate(islice(io.BytesIO(content), _MAX_HEAD_LINES), 1):
        line = raw.decode("utf-8", "replace").strip()
        delimiter = next((mark for mark in ";,\t" if mark in line), None)
        cells = [cell.strip(" \"'") for cell in line.lstrip("#/ ").split(delimiter)]
        if {"x", "y", "z"} <= {cell.lower() for cell in cells}:
            named = (cell or f"field_{index}" for index, cell in enumerate(cells))
            names = tuple(name.lower() if name.lower() in ("x", "y", "z") else name for name in named)
            return names, delimiter, content[at + len(raw) :], number + 1
        if any(cells) and all(is_number(cell) for cell in cells if cell):
            return column_names(len(cells)), delimiter, content[at:], number
        if line and not line.startswith(("#", "//")):
            raise CloudError(f"line {number} contains neither numbers nor the column names x, y and z: {line[:60]!r}")
        at += len(raw)
    raise CloudError("the file contains no points and no column names")


def _fill_empty_cells(body: bytes, mark: bytes) -> bytes:
    """Return the lines with nan between adjacent separators, and between a separator and either end of a line."""
    body = b"\n" + body + b"\n"
    if not any(hint in body for hint in (mark + mark, mark + b" ", mark + b"\r", mark + b"\n", b"\n" + mark)):
        return body
    blank = rb" *" if mark == b"\t" else rb"[ \t]*"
    return re.sub(rb"(?<=[\n%b])%b(?=%b)|(?<=%b)%b(?=\r?\n)" % (mark, blank, mark, mark, blank), b"nan", body)
