"""What people see: progress, warnings, tables. Results go to standard output, everything else to standard error."""

import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import TracebackType
from typing import Any, Protocol, Self

import click

from seaclutter_cli.commands.options import DEBUG
from seaclutter_cli.errors import SeaclutterError, UsageError
from seaclutter_cli.records import Damage
from seaclutter_cli.text import printable

_LINE_SECONDS = 10.0
_SHOWN_DAMAGE = 10


class Progress:
    """A bar on a terminal, a plain line every ten seconds elsewhere, nothing when quiet.

    Parameters
    ----------
    total : int or None
        Frames to come, if known.
    title : str
        What is worked on.
    quiet : bool
        Show nothing.
    """

    def __init__(self, total: int | None, title: str, *, quiet: bool) -> None:
        self._title, self._total, self._count = title, total, 0
        self._bar: Any = None
        self._plain = not quiet and not sys.stderr.isatty()
        self._next = time.monotonic() + _LINE_SECONDS
        if not quiet and not self._plain:
            from tqdm import tqdm

            self._bar = tqdm(total=total, desc=title, unit=" frames", leave=False, dynamic_ncols=True)

    def __enter__(self) -> Self:
        """Start showing."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop showing."""
        if self._bar is not None:
            self._bar.close()

    def step(self) -> None:
        """Count a frame."""
        self._count += 1
        if self._bar is not None:
            self._bar.update()
        elif self._plain and time.monotonic() >= self._next:
            self._next += _LINE_SECONDS
            of = f" of {self._total}" if self._total else ""
            click.echo(f"{self._title}: {self._count}{of} frames", err=True)


def fail(error: SeaclutterError) -> None:
    """Print an error and go on; with ``--debug``, raise it."""
    if DEBUG in click.get_current_context().meta:
        raise error
    show_error(error)


class Told(Protocol):
    """What became of a recording."""

    error: str | None
    seconds: float


@contextmanager
def told_errors(outcome: Told) -> Iterator[None]:
    """Tell and keep an error of one recording, so that the others are worked on all the same; take the time.

    Raises
    ------
    UsageError
        It would be the same for all recordings.
    """
    started = time.perf_counter()
    try:
        yield
    except UsageError:
        raise
    except SeaclutterError as error:
        outcome.error = str(error)
        fail(error)
    outcome.seconds = time.perf_counter() - started


def show_error(error: SeaclutterError) -> None:
    """Print an error; what it quotes from a file cannot steer the terminal."""
    click.echo("Error: " + "\n".join(printable(line) for line in str(error).split("\n")), err=True)


def warn(text: str, *, quiet: bool = False) -> None:
    """Print a warning."""
    if not quiet:
        click.echo(f"Warning: {printable(text)}", err=True)


def report_damage(damage: Sequence[Damage], *, verbose: bool) -> None:
    """Print what could not be used of the input; all of it if verbose."""
    shown = len(damage) if verbose else _SHOWN_DAMAGE
    for item in damage[:shown]:
        click.echo(f"Damaged: {item}", err=True)
    if len(damage) > shown:
        click.echo(f"Damaged: {len(damage) - shown} more places; -v lists them all", err=True)


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Return a table: the first column to the left, all others to the right.

    Examples
    --------
    >>> print(table(("ring", "points"), [("10-25 m", 1200), ("25-40 m", 7)]))
    ring     points
    10-25 m    1200
    25-40 m       7
    """
    cells = [[printable(str(cell)) for cell in row] for row in (head, *rows)]
    widths = [max(len(row[column]) for row in cells) for column in range(len(head))]
    lines = []
    for first, *rest in cells:
        others = (cell.rjust(width) for cell, width in zip(rest, widths[1:], strict=True))
        lines.append("  ".join((first.ljust(widths[0]), *others)).rstrip())
    return "\n".join(lines)


def count(frames: int) -> str:
    """Return a number of frames in words.

    Examples
    --------
    >>> count(1), count(2)
    ('1 frame', '2 frames')
    """
    return counted(frames, "frame")


def counted(number: int, thing: str) -> str:
    """Return a number of things in words.

    Examples
    --------
    >>> counted(1, "point"), counted(1200, "point")
    ('1 point', '1,200 points')
    """
    return f"{number:,} {thing}{'' if number == 1 else 's'}"


def share(part: float, whole: float) -> str:
    """Return a percentage; a dash of nothing.

    Examples
    --------
    >>> share(1, 8), share(0, 0)
    ('12.5 %', '-')
    """
    return f"{100 * part / whole:.1f} %" if whole else "-"
