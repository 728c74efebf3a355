"""Text output: printable names, tables, counts and percentages."""

import os
import textwrap
from collections.abc import Collection, Mapping, Sequence
from difflib import get_close_matches

UNKNOWN = "–"
"""Stands for a value that is not known, or a rate without anything to count."""

_CELL_CHARACTERS = 200
_LINE_CHARACTERS = 80


def printable(text: str) -> str:
    r"""Return text as one printable line, with control characters escaped.

    Examples
    --------
    >>> print(printable("inten\nity, é"))
    inten\nity, é
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def shortened(text: str, limit: int) -> str:
    """Return text of at most ``limit`` characters with an ellipsis in place of its middle.

    Examples
    --------
    >>> shortened("/lidar/left/points", 9)
    '/lid…ints'
    """
    end = (limit - 1) // 2
    return text if len(text) <= limit else f"{text[: limit - 1 - end]}…{text[-end:]}"


def suggestion(name: str, known: Collection[str]) -> str:
    """Return a question whether a similar name is meant, to be put before a list of those that are known.

    Examples
    --------
    >>> suggestion("jiont", ["joint", "sor"]), suggestion("x", ["joint", "sor"])
    ("did you mean 'joint'? ", '')
    """
    close = get_close_matches(name.casefold()[:_CELL_CHARACTERS], {text.casefold(): text for text in known}, n=1)
    meant = next((text for text in known if close and text.casefold() == close[0]), None)
    return f"did you mean {meant!r}? " if meant else ""


def named_folder(path: str | os.PathLike[str]) -> bool:
    """Return whether a path is written as that of a folder, with a slash at its end.

    Examples
    --------
    >>> named_folder("filtered/"), named_folder("filtered.mcap")
    (True, False)
    """
    return os.fspath(path).endswith((os.sep, "/"))


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Return a table with a left-aligned first column and right-aligned other columns; long cells are cut.

    Examples
    --------
    >>> print(table(("range", "points"), [("10-25 m", 1200), ("25-40 m", 7)]))
    range    points
    10-25 m    1200
    25-40 m       7
    """
    cells = [[shortened(printable(str(cell)), _CELL_CHARACTERS) for cell in row] for row in (head, *rows)]
    widths = [max(len(row[column]) for row in cells) for column in range(len(head))]
    lines = []
    for first, *rest in cells:
        others = (cell.rjust(width) for cell, width in zip(rest, widths[1:], strict=True))
        lines.append("  ".join((first.ljust(widths[0]), *others)).rstrip())
    return "\n".join(lines)


def legend(meanings: Mapping[str, str]) -> str:
    """Return terms with their meanings, wrapped at 80 characters.

    Examples
    --------
    >>> print(legend({"F1": "harmonic mean", "R_c": "share of clutter"}))
    F1   harmonic mean
    R_c  share of clutter
    """
    width = max(map(len, meanings)) + 2
    lines = []
    for term, meaning in meanings.items():
        first = term.ljust(width)
        lines.append(textwrap.fill(meaning, _LINE_CHARACTERS, initial_indent=first, subsequent_indent=" " * width))
    return "\n".join(lines)


def indented(text: str) -> str:
    """Return text with every line indented by two spaces."""
    return "\n".join("  " + line for line in text.splitlines())


def count(number: int, noun: str) -> str:
    """Return a number with its noun in the singular or plural.

    Examples
    --------
    >>> count(1, "point"), count(1200, "point"), count(2, "box")
    ('1 point', '1,200 points', '2 boxes')
    """
    plural = "es" if noun.endswith("x") else "s"
    return f"{number:,} {noun}{'' if number == 1 else plural}"


def listed(names: Sequence[str], most: int = 3) -> str:
    """Return names in a line: the first ones, and how many more there are.

    Examples
    --------
    >>> listed(["a", "b"]), listed(["a", "b", "c", "d", "e"])
    ('a, b', 'a, b, c and 2 more')
    """
    shown, more = ", ".join(names[:most]), len(names) - most
    return f"{shown} and {more:,} more" if more > 0 else shown


def duration(seconds: float) -> str:
    """Return a duration in its two largest units.

    Examples
    --------
    >>> duration(7261), duration(61.4), duration(0.25)
    ('2 h 1 min', '1 min 1 s', '0.2 s')
    """
    if seconds < 10:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    units = {"d": whole // 86400, "h": whole // 3600 % 24, "min": whole // 60 % 60, "s": whole % 60}
    names = list(units)
    first = next(number for number, name in enumerate(names) if units[name])
    return " ".join(f"{units[name]} {name}" for name in names[first : first + 2] if units[name])


def data_size(size: float) -> str:
    """Return an amount of data in bytes with three digits and a decimal unit.

    Examples
    --------
    >>> data_size(999), data_size(1_500_000), data_size(41e9)
    ('999 B', '1.5 MB', '41 GB')
    """
    units = ("B", "kB", "MB", "GB", "TB", "PB")
    step = 0
    while size >= 999.5 and step < len(units) - 1:
        size, step = size / 1000, step + 1
    return f"{size:.3g} {units[step]}"


def share(part: float, whole: float) -> str:
    """Return a percentage, or a dash if the whole is 0.

    Examples
    --------
    >>> share(1, 8), share(0, 0)
    ('12.5 %', '–')
    """
    return f"{100 * part / whole:.1f} %" if whole else UNKNOWN
