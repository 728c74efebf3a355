"""Observers, which receive the progress, warnings and errors of a run."""

import itertools
import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any, Protocol, cast

from seaclutter_cli.errors import SeaclutterError
from seaclutter_cli.records import Damage
from seaclutter_cli.text import count

Step = Callable[[], object]
"""Function to call after each frame."""


class Observer(Protocol):
    """Receiver of the progress, warnings and errors of a run.

    Examples
    --------
    >>> import seaclutter
    >>> class Warnings(seaclutter.LoggingObserver):
    ...     def warn(self, text: str) -> None:
    ...         print("!", text)
    >>> done = seaclutter.filter_log(
    ...     "samples/sea.mcap", folder / "f.mcap", config={"filter": {"initial_thresholds": [256] * 4}},
    ...     observer=Warnings(),
    ... )
    ! /points: no point can pass: ...
    """

    def progress(self, title: str, total: int | None, unit: str = "frame") -> AbstractContextManager[Step]:  # noqa: ARG002
        """Start a progress display of ``total`` frames, if known; yield the function to call after each frame.

        Over several recordings or tiles, the unit is ``MiB`` of input, or ``recording`` or ``tile`` if there is less
        than one MiB.
        """
        return nullcontext(lambda: None)

    def note(self, text: str, *, detail: bool = False) -> None:
        """Receive a message about the course of the run; a detail is for verbose output only."""

    def warn(self, text: str) -> None:
        """Receive a warning."""

    def damage(self, damage: Sequence[Damage]) -> None:
        """Receive the parts of a recording that could not be used."""

    def fail(self, error: SeaclutterError) -> None:
        """Receive the error that ended the work on a single recording."""

    def done(self, line: str, damage: Sequence[Damage], error: SeaclutterError | None) -> None:
        """Receive the end of one of several recordings: a line about it, its damage, and the error that ended it."""


class Silent(Observer):
    """Observer that shows nothing."""

    def __repr__(self) -> str:
        """Return the name of the only one that is needed, for the documentation of functions."""
        return "SILENT"

    def _ignore(self, *_: Any, **__: Any) -> None: ...

    note = warn = damage = fail = done = _ignore


SILENT = Silent()


class _Raising:
    """Observer that raises the error of a recording, and passes on everything else."""

    def __init__(self, inner: Observer) -> None:
        self.inner = inner

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)

    def fail(self, error: SeaclutterError) -> None:
        raise error

    def done(self, line: str, damage: Sequence[Damage], error: SeaclutterError | None) -> None:
        if error:
            raise error
        self.inner.done(line, damage, error)


def raising(observer: Observer) -> Observer:
    """Return an observer that raises the error of a recording."""
    return cast("Observer", _Raising(observer))


class LoggingObserver:
    """Observer that passes everything to a logger of the standard library.

    Parameters
    ----------
    logger : logging.Logger, optional
        By default the logger ``seaclutter``.

    Examples
    --------
    >>> import logging, sys
    >>> import seaclutter
    >>> logger = logging.Logger("trial")
    >>> logger.addHandler(logging.StreamHandler(sys.stdout))
    >>> seaclutter.LoggingObserver(logger).warn("/points: no point can pass")
    /points: no point can pass
    """

    def __init__(self, logger: logging.Logger | None = None) -> None:
        self._logger = logger or logging.getLogger("seaclutter")

    @contextmanager
    def progress(self, title: str, total: int | None, unit: str = "frame") -> Iterator[Step]:
        """Log the start and the number of frames at the end."""
        counted = itertools.count()
        self._logger.info("%s: %s", title, "started" if total is None else f"started, {_amount(total, unit)} expected")
        yield lambda: next(counted)
        self._logger.info("%s: %s", title, _amount(next(counted), unit))

    def note(self, text: str, *, detail: bool = False) -> None:
        """Log a note, or a detail for debugging."""
        self._logger.log(logging.DEBUG if detail else logging.INFO, "%s", text)

    def warn(self, text: str) -> None:
        """Log a warning."""
        self._logger.warning("%s", text)

    def damage(self, damage: Sequence[Damage]) -> None:
        """Log each part that could not be used."""
        for item in damage:
            self._logger.warning("damaged: %s", item)

    def fail(self, error: SeaclutterError) -> None:
        """Log the error of one recording."""
        self._logger.error("%s", error)

    def done(self, line: str, damage: Sequence[Damage], error: SeaclutterError | None) -> None:
        """Log the end of one of several recordings, with its damage or error."""
        self.damage(damage)
        if error:
            self.fail(error)
        else:
            self._logger.info("%s", line)


def _amount(number: int, unit: str) -> str:
    return f"{number:,} MiB" if unit == "MiB" else count(number, unit)
