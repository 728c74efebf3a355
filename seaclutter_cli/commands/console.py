"""Console output: results on standard output; progress, warnings and errors on standard error."""

from __future__ import annotations

import re
import sys
import time
from collections import Counter
from contextlib import closing, contextmanager, suppress
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any, NoReturn

import click

from seaclutter_cli.commands.printer import show, show_error, show_exactly, show_line
from seaclutter_cli.errors import OWN_WARNINGS, OutputError, SeaclutterError, opening
from seaclutter_cli.options import OptionalPath, Options, Place, optional
from seaclutter_cli.text import json_text, printable, shortened

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from seaclutter_cli.records import Damage
    from seaclutter_cli.runs.recordings import Result

DEBUG = "seaclutter.debug"
"""Key in a context's ``meta`` that requests tracebacks."""
NOTES = "seaclutter.notes"
"""Key in a context's ``meta`` for notes about options, which the console shows."""
ARGUMENTS = "seaclutter.arguments"
"""Key in a context's ``meta`` for the arguments of the program."""
LOG = "seaclutter.log"
"""Key in a context's ``meta`` for the console with a log file."""

_LINE_SECONDS = 10.0
_SHOWN_DAMAGE = 10
_TITLE_CHARACTERS = 60
_FAILED, _DAMAGED = 1, 3
_LOG_HEAD = b"# seaclutter log\n"


class Console(Options):
    """Observer that prints to the terminal, and prints results at the end."""

    dry_run: bool = optional("--dry-run", "Show what would be done with each recording, and do nothing.")
    as_json: bool = optional("--json", "Print results as JSON.")
    quiet: bool = optional("-q --quiet", "Show no progress, no warnings, and no summary of what was written.")
    verbose: bool = optional("-v --verbose", "Show details.")
    log_file: OptionalPath = optional(
        "--log-file", "Append all messages to FILE, with times and details.", kind=Place()
    )

    def __post_init__(self) -> None:
        """Open the log file, so that an error comes before the run, and let it receive the error that ends the run."""
        context = click.get_current_context(silent=True)
        if self.log_file:
            _begin_log(self.log_file)
            if context:
                context.meta[LOG] = self
        for text in context.meta.pop(NOTES, ()) if context else ():
            self.note(text)

    def record(self, text: str, level: str = "INFO") -> None:
        """Append a line to the log file: time in UTC, level, text."""
        if self.log_file:
            with suppress(OSError), self.log_file.open("a", encoding="utf-8", errors="backslashreplace") as file:
                file.write(f"{time.strftime('%Y-%m-%dT%H:%M:%SZ', time.gmtime())} {level} {printable(text)}\n")

    @contextmanager
    def progress(self, title: str, total: int | None, unit: str = "frame") -> Iterator[Callable[[], object]]:
        """Show a progress bar on a terminal, otherwise a line every ten seconds; nothing if quiet."""
        if self.quiet:
            yield lambda: None
        elif sys.stderr.isatty():
            from tqdm import tqdm

            title = shortened(printable(title), _TITLE_CHARACTERS)
            plural = f" {unit}" if unit == "MiB" else f" {unit}s"
            with closing(tqdm(total=total, desc=title, unit=plural, leave=False, dynamic_ncols=True)) as bar:
                yield bar.update
        else:
            yield _PlainProgress(title, total, unit).step

    def note(self, text: str, *, detail: bool = False) -> None:
        """Print a message about the course of the run."""
        self.record(text)
        if self.verbose if detail else not self.quiet:
            show_line(text)

    @cached_property
    def _warned(self) -> Counter[str]:
        """Number of each warning so far, without the recording or topic that it begins with."""
        return Counter()

    def warn(self, text: str) -> None:
        """Print a warning, unless it is verbose only once for all recordings or topics that have it."""
        self.record(text, "WARNING")
        same = text.partition(": ")[2] or text
        self._warned[same] += 1
        if not self.quiet and (self.verbose or self._warned[same] == 1):
            show_line(f"Warning: {text}")

    def damage(self, damage: Sequence[Damage], *, most: int = _SHOWN_DAMAGE) -> None:
        """Print the parts of the input that could not be used: one of each kind, all of them if verbose."""
        kinds: dict[object, list[Damage]] = {}
        for number, item in enumerate(damage):
            self.record(f"damaged: {item}", "WARNING")
            kinds.setdefault(number if self.verbose else re.sub("[0-9]+", "", item.problem), []).append(item)
        shown = len(kinds) if self.verbose else most
        for first, *alike in [*kinds.values()][:shown]:
            show_line(f"Damaged: {first}" + f" (and {len(alike)} more like this; -v lists all)" * bool(alike))
        if len(kinds) > shown > 0:
            show_line(f"Damaged: {len(damage) - sum(map(len, [*kinds.values()][:shown]))} more; use -v to list all")

    def fail(self, error: SeaclutterError) -> None:
        """Print an error and continue; with ``--debug``, raise it."""
        self.record(str(error), "ERROR")
        if DEBUG in click.get_current_context().meta:
            raise error
        show_error(error)

    def done(self, line: str, damage: Sequence[Damage], error: SeaclutterError | None) -> None:
        """Print the line about one of several recordings, and all of its damage if verbose."""
        if error:
            self.fail(error)
        elif line:
            self.record(line)
            if not self.quiet:
                show_line(line)
        self.damage(damage, most=0)

    def finish(self, result: Result) -> NoReturn:
        """Print the number of warnings that were not shown again, and a result; exit with its status."""
        for text, number in self._warned.items():
            if number > 1 and not (self.quiet or self.verbose):
                show_line(f"Warning: {number - 1:,} more: {text}")
        if self.as_json or not (self.quiet and result.is_summary):
            text = result.as_detailed_text() if self.verbose else result.as_text()
            if self.as_json:
                show_exactly(json_text(result.as_dict()))
            elif text:
                show(text)
        raise click.exceptions.Exit(_FAILED if result.failed else _DAMAGED if result.damaged else 0)


class _PlainProgress:
    def __init__(self, title: str, total: int | None, unit: str) -> None:
        of = f" of {total:,}" if total else ""
        self._before, self._after = (f"{title}: ", f"{of} MiB") if unit == "MiB" else (f"{title}: {unit} ", of)
        self._count = 0
        self._next = time.monotonic() + _LINE_SECONDS

    def step(self) -> None:
        self._count += 1
        if time.monotonic() >= self._next:
            self._next += _LINE_SECONDS
            show_line(f"{self._before}{self._count:,}{self._after}")


def show_each_warning_once() -> Callable[..., None]:
    """Return a handler for Python's warnings, in place of `warnings.showwarning`."""
    show_once = cache(show_line)

    def show_warning(message: Warning | str, category: type[Warning], filename: str, line: int, *_: Any) -> None:
        own = issubclass(category, OWN_WARNINGS)
        origin = "" if own else f" ({category.__name__}, {filename}:{line})"
        show_once(f"Warning: {message}{origin}")

    return show_warning


def _begin_log(path: Path) -> None:
    """Make a log file, unless there is one; raise `OutputError` if it is another file, or cannot be written."""
    with opening(path, OutputError, "cannot be written"):
        known = b""
        if path.is_file():
            with path.open("rb") as file:
                known = file.read(len(_LOG_HEAD))
        if known and known != _LOG_HEAD:
            raise OutputError(f"{path}: is not a log file; choose another one for --log-file")
        path.parent.mkdir(exist_ok=True)  # as for other outputs: the last folder
        with path.open("ab") as file:
            file.write(b"" if known else _LOG_HEAD)
