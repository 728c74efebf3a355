"""Points as plain tables: what columns without names are, and rows of text."""

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import CloudError

_COLUMNS = ("x", "y", "z", "intensity", "ring")


def column_names(count: int) -> tuple[str, ...]:
    """Return the names of ``count`` columns that have none.

    Raises
    ------
    CloudError
        If there are fewer than three.

    Examples
    --------
    >>> column_names(6)
    ('x', 'y', 'z', 'intensity', 'ring', 'field_5')
    """
    if count < len("xyz"):
        raise CloudError(f"{count} columns, at least x, y and z are needed")
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

    Parameters
    ----------
    body : bytes
        Text. Blank lines and what follows a ``#`` are skipped.
    dtype : dtype
        Structured; one number of a line for each scalar in it.
    delimiter : str, optional
        What separates numbers; None stands for any white space.
    first_line : int, optional
        Number of the first line, for messages.
    max_rows : int, optional
        Rows to read; what follows them is not looked at.

    Raises
    ------
    CloudError
        If a line is of another length or holds anything but numbers; names the line.

    Examples
    --------
    >>> parse_rows(b"1 2\n3 nan\n", np.dtype([("x", "f4"), ("y", "f4")]))["y"]
    array([ 2., nan], dtype=float32)
    """
    if not body.strip():
        return np.empty(0, dtype)
    try:
        return np.loadtxt(io.BytesIO(body), dtype, delimiter=delimiter, ndmin=1, max_rows=max_rows)
    except ValueError as error:
        fault = _first_fault(body, dtype, delimiter, first_line)
        raise CloudError(fault or " ".join(str(error).split())) from error


def _first_fault(body: bytes, dtype: np.dtype[np.void], delimiter: str | None, first_line: int) -> str | None:
    """Find the line that does not fit; slow, but only run on what is known to be broken."""
    columns = sum(int(np.prod(dtype[name].shape, dtype=int)) for name in dtype.names or ())
    for number, raw in enumerate(body.decode("latin-1").split("\n"), first_line):
        line = raw.partition("#")[0].strip()
        cells = line.split(delimiter) if line else []
        if line and len(cells) != columns:
            return f"line {number} has {len(cells)} values, {columns} are needed"
        bad = next((cell for cell in cells if not is_number(cell)), None)
        if bad is not None:
            return f"line {number}: {bad.strip()[:40]!r} is no number"
    return None


def is_number(cell: str) -> bool:
    """Return whether a cell of a table can be read as a number."""
    try:
        float(cell)
    except ValueError:
        return False
    return True
