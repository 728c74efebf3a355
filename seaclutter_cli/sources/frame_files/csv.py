"""Points as lines of text: CSV with any usual separator, and the XYZ files of other tools."""

import codecs
import io
import re
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from seaclutter_cli.cloud import Cloud, from_array
from seaclutter_cli.errors import CloudError
from seaclutter_cli.paths import open_regular, read_whole
from seaclutter_cli.sources.frame_files.headerless import check_usual
from seaclutter_cli.sources.frame_files.reading import MAX_LINE_BYTES, check_lines, column_names, is_number, parse_rows
from seaclutter_cli.text import count

_BOMS = {codecs.BOM_UTF8: "utf-8", codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}
_MAX_HEAD_LINES = 1000
_LOOKED_AT = 100
_UNIT = re.compile(r"(?P<name>.*?)[ _]*[\[(](?P<unit>[^\])]*)[\])]")
_METRES = ("m", "meter", "metre", "meters", "metres", "")
_COMPONENT = re.compile(r".*(?:points|xyz).*:(?P<axis>[012])", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(rb"^[^,\n]*\d,\d+[ \t;]", re.MULTILINE)


class _Head(NamedTuple):
    """Column names, whether the file has them, separator, lines of points, and the number of the first of these."""

    names: tuple[str, ...]
    is_named: bool
    delimiter: str | None
    body: bytes
    line: int


def read_csv(path: Path, columns: Sequence[str] = ()) -> Cloud:
    """Return the points of a text file, every column float64, empty cells NaN; `CloudError` if a line is not valid.

    Names of columns, in the first line after an optional ``#``, contain x, y and z, with an optional unit; without,
    they are ``columns`` or see `column_names`. Columns of text are left out.
    """
    content = _utf8(read_whole(path))
    check_lines(content)
    head = _head(content)
    names, body, line = head.names, head.body, head.line
    if columns and not head.is_named:
        if len(columns) != len(names):
            raise CloudError(f"{count(len(names), 'column')}, but --columns names {len(columns)}")
        names = tuple(columns)
    if head.delimiter is not None:
        body, line = _fill_empty_cells(body, head.delimiter.encode()), line - 1
    texts = _columns_of_text(body, head) if head.is_named else set()
    dtype = np.dtype([(name, "S1" if index in texts else "<f8") for index, name in enumerate(names)])
    try:
        points = parse_rows(body, dtype, delimiter=head.delimiter, first_line=line)
    except CloudError as error:
        hint = "; write decimal points, not commas" if _DECIMAL_COMMA.search(head.body[:MAX_LINE_BYTES]) else ""
        raise CloudError(f"{error}{hint}") from error
    if texts:
        points = points[[name for index, name in enumerate(names) if index not in texts]]
    return from_array(points if head.is_named or columns else check_usual(points))


def _utf8(content: bytes) -> bytes:
    """Return text without a byte order mark, and in UTF-8 if the mark is of UTF-16."""
    mark = next((mark for mark in _BOMS if content.startswith(mark)), b"")
    content = content.removeprefix(mark)
    return content if _BOMS.get(mark, "utf-8") == "utf-8" else content.decode(_BOMS[mark], "replace").encode()


def is_point_table(path: Path) -> bool:
    """Return whether a text file starts like a table of points; tables of results and settings do not."""
    with open_regular(path) as file:
        start = file.read(MAX_LINE_BYTES)
    try:
        _head(_utf8(start))
    except CloudError:
        return False
    return True


def _head(content: bytes) -> _Head:
    at = 0
    for number, raw in enumerate(islice(io.BytesIO(content), _MAX_HEAD_LINES), 1):
        line = raw.decode("utf-8", "replace").strip()
        delimiter = next((mark for mark in ";,\t" if mark in line), None)
        cells = [cell.strip(" \"'") for cell in line.lstrip("#/ ").split(delimiter)]
        named = [_name(cell) or f"field_{index}" for index, cell in enumerate(cells)]
        if {"x", "y", "z"} <= set(named):
            return _Head(tuple(named), True, delimiter, content[at + len(raw) :], number + 1)
        if any(cells) and all(is_number(cell) for cell in cells if cell):
            return _Head(column_names(len(cells)), False, delimiter, content[at:], number)
        if line and not line.startswith(("#", "//")):
            hint = "; write decimal points, not commas" if _DECIMAL_COMMA.search(raw) else ""
            problem = "contains neither numbers nor the column names x, y and z"
            raise CloudError(f"line {number} {problem}: {line[:60]!r}{hint}")
        at += len(raw)
    raise CloudError("the file contains no points and no column names")


def _name(cell: str) -> str:
    """Return the name of a column: without a unit, and x, y or z if it is one of them, or so in ParaView."""
    if component := _COMPONENT.fullmatch(cell):
        return "xyz"[int(component["axis"])]
    found = _UNIT.fullmatch(cell)
    name = found["name"] if found else cell
    if name.lower() not in ("x", "y", "z"):
        return cell
    if found and found["unit"].strip().lower() not in _METRES:
        raise CloudError(f"column {name} is in {found['unit'].strip()}; coordinates must be in metres")
    return name.lower()


def _columns_of_text(body: bytes, head: _Head) -> set[int]:
    """Return the columns, other than coordinates, in which one of the first lines has text."""
    lines = (raw.decode("utf-8", "replace").strip() for raw in islice(io.BytesIO(body), _LOOKED_AT))
    return {
        index
        for line in lines
        for index, cell in enumerate(line.split(head.delimiter) if line and not line.startswith("#") else ())
        if index < len(head.names) and head.names[index] not in ("x", "y", "z") and not is_number(cell)
        if not _DECIMAL_COMMA.match(cell.encode() + b" ")
    }


def _fill_empty_cells(body: bytes, mark: bytes) -> bytes:
    """Return the lines with nan between adjacent separators, and between a separator and either end of a line."""
    body = b"\n" + body + b"\n"
    if not any(hint in body for hint in (mark + mark, mark + b" ", mark + b"\r", mark + b"\n", b"\n" + mark)):
        return body
    blank = rb" *" if mark == b"\t" else rb"[ \t]*"
    return re.sub(rb"(?<=[\n%b])%b(?=%b)|(?<=%b)%b(?=\r?\n)" % (mark, blank, mark, mark, blank), b"nan", body)
