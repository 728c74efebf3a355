"""The progress, warnings and errors of a run, reported to whoever wants to show them."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol

from seaclutter_cli.errors import SeaclutterError
from seaclutter_cli.records import Damage

Step = Callable[[], object]
"""Counts one more frame."""


class Observer(Protocol):
    """Receives what a run reports while it works."""

    def progress(self, title: str, total: int | None) -> AbstractContextManager[Step]:
        """Start a progress display of ``total`` frames, if known; yield the function that counts one."""
        ...

    def note(self, text: str, *, detail: bool = False) -> None:
        """Take a line on the course of the run; a detail is for verbose output only."""
        ...

    def warn(self, text: str) -> None:
        """Take a warning."""
        ...

    def damage(self, damage: Sequence[Damage]) -> None:
        """Take the parts of a recording that could not be used."""
        ...

    def fail(self, error: SeaclutterError) -> None:
        """Take the error that ended the work on one recording; the run goes on with the others."""
        ...


class Silent:
    """An observer that shows nothing."""

    @contextmanager
    def progress(self, title: str, total: int | None) -> Iterator[Step]:  # noqa: ARG002
        """Yield a function that does nothing."""
        yield lambda: None

    def note(self, text: str, *, detail: bool = False) -> None:
        """Ignore a note."""

    def warn(self, text: str) -> None:
        """Ignore a warning."""

    def damage(self, damage: Sequence[Damage]) -> None:
        """Ignore damage; results hold it too."""

    def fail(self, error: SeaclutterError) -> None:
        """Ignore an error; results hold it too."""


SILENT = Silent()
