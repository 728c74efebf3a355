"""Text output: printable names, tables, counts and percentages; results as JSON."""

import json
import os
import re
import textwrap
from collections.abc import Collection, Mapping, Sequence
from difflib import get_close_matches
from functools import partial
from itertools import dropwhile
from typing import Any

SCHEMA_VERSION = 1
"""Version of results as JSON; it changes when a key is removed or gets another meaning."""

UNKNOWN = "–"
"""Stands for a value that is not known, or a rate without anything to count."""

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.IGNORECASE | re.ASCII)
_CELL_CHARACTERS = 200
_LINE_CHARACTERS = 80


def printable(text: str) -> str:
    r"""Return text as one printable line, with control characters escaped."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def json_text(data: Any) -> str:
    """Return results as JSON, which begins with the version of their schema, in each element of a list."""
    return json.dumps([_versioned(item) for item in data] if isinstance(data, list) else _versioned(data), indent=2)


def _versioned(data: Any) -> Any:
    return {"schema_version": SCHEMA_VERSION, **data} if isinstance(data, dict) else data


def harmless(value: object) -> object:
    """Return a value of a table (CSV); an apostrophe precedes a text that looks like a formula of a spreadsheet.

    Numbers that are written as text stay as they are.
    """
    if not isinstance(value, str) or not value.startswith(("=", "+", "-", "@", "\t", "\r")):
        return value
    return value if _NUMBER.fullmatch(value) else f"'{value}"


def shortened(text: str, limit: int) -> str:
    """Return text of at most ``limit`` characters with an ellipsis in place of its middle, as in ``/lid…ints``."""
    end = (limit - 1) // 2
    return text if len(text) <= limit else f"{text[: limit - 1 - end]}…{text[-end:]}"


def suggestion(name: str, known: Collection[str]) -> str:
    """Return a question whether a similar name is meant, to be put before a list of those that are known."""
    close = get_close_matches(name.casefold()[:_CELL_CHARACTERS], {text.casefold(): text for text in known}, n=1)
    meant = next((text for text in known if close and text.casefold() == close[0]), None)
    return f"did you mean {meant!r}? " if meant else ""


def named_folder(path: str | os.PathLike[str]) -> bool:
    """Return whether a path is written as that of a folder, with a slash at its end."""
    return os.fspath(path).endswith((os.sep, "/"))


def table(head: Sequence[str], rows: Sequence[Sequence[object]], notes: Sequence[str] = ()) -> str:
    """Return a table with a left-aligned first column and right-aligned other columns; long cells are cut.

    Behind each row, there is a note of any length, if there are any.
    """
    cells = [[shortened(printable(str(cell)), _CELL_CHARACTERS) for cell in row] for row in (head, *rows)]
    widths = [max(len(row[column]) for row in cells) for column in range(len(head))]
    lines = []
    for (first, *rest), note in zip(cells, ("", *(notes or [""] * len(rows))), strict=True):
        others = (cell.rjust(width) for cell, width in zip(rest, widths[1:], strict=True))
        lines.append("  ".join((first.ljust(widths[0]), *others, printable(note))).rstrip())
    return "\n".join(lines)


def legend(meanings: Mapping[str, str]) -> str:
    """Return terms with their meanings, wrapped at 80 characters."""
    width = max(map(len, meanings)) + 2
    wrap = partial(textwrap.fill, width=_LINE_CHARACTERS, subsequent_indent=" " * width)
    return "\n".join(wrap(meaning, initial_indent=term.ljust(width)) for term, meaning in meanings.items())


def count(number: int, noun: str) -> str:
    """Return a number with its noun in the singular or plural: ``1,200 points``, ``2 boxes``."""
    plural = "es" if noun.endswith("x") else "s"
    return f"{number:,} {noun}{'' if number == 1 else plural}"


def listed(names: Sequence[str], most: int = 3) -> str:
    """Return names in a line: the first ones, and how many more there are."""
    shown, more = ", ".join(names[:most]), len(names) - most
    return f"{shown} and {more:,} more" if more > 0 else shown


def duration(seconds: float) -> str:
    """Return a duration in its two largest units: ``2 h 1 min``, ``0.2 s``."""
    if seconds < 10:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    units = (whole // 86400, "d"), (whole // 3600 % 24, "h"), (whole // 60 % 60, "min"), (whole % 60, "s")
    largest = list(dropwhile(lambda unit: not unit[0], units))[:2]
    return " ".join(f"{number} {name}" for number, name in largest if number)


def data_size(size: float) -> str:
    """Return an amount of data in bytes with three digits and a decimal unit: ``999 B``, ``1.5 MB``."""
    units = ("B", "kB", "MB", "GB", "TB", "PB")
    step = 0
    while size >= 999.5 and step < len(units) - 1:
        size, step = size / 1000, step + 1
    return f"{size:.3g} {units[step]}"


def share(part: float, whole: float) -> str:
    """Return a percentage, such as ``12.5 %``, or a dash if the whole is 0."""
    return f"{100 * part / whole:.1f} %" if whole else UNKNOWN
