"""The way out: all that the program prints goes through here.

Names of files, topics and fields and the errors of libraries come from outside. Whatever they contain, a terminal
receives printable text of bounded length; results as JSON or YAML are printed exactly, and their formats escape.
"""

import logging
import os
import re
import sys
import traceback
from contextlib import nullcontext
from types import TracebackType

import click

from seaclutter_cli.errors import OutputError
from seaclutter_cli.text import printable, shortened

_WORD_CHARACTERS, _LINE_CHARACTERS = 200, 4000
_LONG_WORD = re.compile(rf"\S{{{_WORD_CHARACTERS + 1},}}")
_FOREIGN_LINE_BREAK = re.compile(r"\n(?!  )")


def show(text: str, *, err: bool = False) -> None:
    """Print text with its line breaks; other control characters are escaped, long words and lines cut."""
    show_exactly("\n".join(map(_presentable, text.split("\n"))), err=err)


def show_line(text: str) -> None:
    """Print text as one line to standard error."""
    show(printable(text), err=True)


def show_error(error: Exception) -> None:
    """Print an error; line breaks are escaped, except those that begin an indented item of a list."""
    text = str(error)
    if isinstance(error, OSError) and error.strerror:
        text = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    show("Error: " + _FOREIGN_LINE_BREAK.sub(r"\\n", text), err=True)


def show_traceback(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Print an error that was not expected, in place of `sys.excepthook`."""
    show("".join(traceback.format_exception(kind, error, trace)).rstrip("\n"), err=True)


class LogHandler(logging.Handler):
    """Handler that prints what libraries log, in place of `logging.lastResort`."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print a record as a warning."""
        show_line(f"Warning: {record.getMessage()} ({record.name})")


def show_exactly(text: str, *, err: bool = False) -> None:
    """Print text as it is, JSON or YAML; raise `OutputError` if standard output cannot be written."""
    try:
        with sys.modules["tqdm"].tqdm.external_write_mode() if "tqdm" in sys.modules else nullcontext():
            click.echo(text, err=err)
    except BrokenPipeError:
        raise
    except OSError as error:
        if not err:
            raise OutputError(f"standard output: cannot be written ({error.strerror})") from error


def close_output() -> None:
    """Write what standard output still holds; drop what cannot be written, or Python would print a traceback."""
    if sys.stdout is None:  # closed by the shell
        return
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _presentable(line: str) -> str:
    words = _LONG_WORD.sub(lambda word: shortened(word[0], _WORD_CHARACTERS), printable(line))
    return shortened(words, _LINE_CHARACTERS)
