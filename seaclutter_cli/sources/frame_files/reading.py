"""Parts of frame readers: handling of damaged files, default names of columns, rows of text."""

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import CloudError, MissingExtraError
from seaclutter_cli.paths import WrongFileError
from seaclutter_cli.text import count

MAX_LINE_BYTES = 1 << 16

_OF_FILES = (IsADirectoryError, WrongFileError)
_COLUMNS = ("x", "y", "z", "intensity", "ring")

# As the C library of Windows writes them.
_WINDOWS_NAN = re.compile(rb"[+-]?(?:nan\([a-z]*\)|1\.#(?:QNAN|SNAN|IND|NAN)\d*)", re.IGNORECASE)
_WINDOWS_INF = re.compile(rb"([+-]?)1\.#INF\d*", re.IGNORECASE)


@contextmanager
def reading(kind: str) -> Iterator[None]:
    """Convert the errors that a format's library raises on damaged bytes to a one-line `CloudError`."""
    try:
        yield
    except (CloudError, MissingExtraError, MemoryError, FileNotFoundError, PermissionError, *_OF_FILES):
        raise
    except Exception as error:
        text = str(error) if " " in str(error) else repr(error)
        raise CloudError(f"not a valid {kind} file: {' '.join(text.split())}") from error


def check_size(needed: int, found: int) -> None:
    """Raise `CloudError` if a file declares more bytes than it contains; call it before allocating memory."""
    if needed > found:
        declared = count(needed, "byte")
        raise CloudError(f"the header declares {declared} of data, but the file contains {found:,}; it is truncated")


def column_names(count: int) -> tuple[str, ...]:
    """Return default names for at least three columns; `CloudError` for fewer."""
    if count < len("xyz"):
        raise CloudError(f"expected at least 3 columns (x, y, z), got {count}")
    return (*_COLUMNS[:count], *(f"field_{index}" for index in range(len(_COLUMNS), count)))


def parse_rows(
    body: bytes,
    dtype: np.dtype[np.void],
    *,
    delimiter: str | None = None,
    first_line: int = 1,
    max_rows: int | None = None,
) -> NDArray[Any]:
    r"""Return lines of numbers as a structured array, shape (N,).

    Blank lines, everything after a ``#``, and rows after ``max_rows`` are skipped. `CloudError` names the first line
    with other than the right number of numbers, counted from ``first_line``.
    """
    check_lines(body, first_line)
    body = _WINDOWS_NAN.sub(b"nan", _WINDOWS_INF.sub(rb"\1inf", body))
    if not body.strip():
        return np.empty(0, dtype)
    try:
        return np.loadtxt(io.BytesIO(body), dtype, delimiter=delimiter, ndmin=1, max_rows=max_rows)
    except ValueError as error:
        fault = _first_fault(body, dtype, delimiter, first_line)
        raise CloudError(fault or " ".join(str(error).split())) from error


def check_lines(body: bytes, first_line: int = 1) -> None:
    """Raise `CloudError` if a line is longer than `MAX_LINE_BYTES`: libraries need a hundred times its size."""
    at = 0
    while len(body) - at > MAX_LINE_BYTES:
        # The last line that ends within the limit: a few steps for many lines.
        end = body.rfind(b"\n", at, at + MAX_LINE_BYTES + 1)
        if end < 0:
            line = first_line + body.count(b"\n", 0, at)
            raise CloudError(f"line {line} is longer than {MAX_LINE_BYTES:,} bytes")
        at = end + 1


def _first_fault(body: bytes, dtype: np.dtype[np.void], delimiter: str | None, first_line: int) -> str | None:
    """Return a message about the first invalid line; slow, and only called if there is one."""
    kinds = [dtype[name].kind for name in dtype.names or () for _ in range(int(np.prod(dtype[name].shape, dtype=int)))]
    for number, raw in enumerate(io.BytesIO(body), first_line):
        line = raw.decode("latin-1").partition("#")[0].strip()
        cells = line.split(delimiter) if line else []
        if line and len(cells) != len(kinds):
            return f"line {number} has {count(len(cells), 'value')}, expected {len(kinds)}"
        for cell, kind in zip(cells, kinds, strict=False):
            if kind != "S" and not is_number(cell):
                return f"line {number}: {cell.strip()[:40]!r} is not a number"
    return None


def is_number(cell: str) -> bool:
    """Return whether a cell of a table can be read as a number."""
    try:
        float(cell)
    except ValueError:
        return False
    return True
