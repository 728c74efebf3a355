"""An observer for one of several recordings, perhaps in another process: messages come along with the result."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

from seaclutter_cli.errors import SeaclutterError
from seaclutter_cli.jobs.engine import Report
from seaclutter_cli.records import Damage
from seaclutter_cli.runs.observer import Observer, Step


@dataclass
class Relay:
    """Observer of the work on one of several recordings.

    Parameters
    ----------
    report : callable
        Receives the share of the work that is done.
    name : str
        Name of the recording, which begins its messages.
    observer : Observer or None
        Receives messages when they come; None: they are kept.

    Attributes
    ----------
    messages : list
        Kind and text of the messages that are kept, and whether each is a detail.
    error : SeaclutterError or None
        Error that ended the work.
    """

    report: Report
    name: str
    observer: Observer | None = None
    messages: list[tuple[str, str, bool]] = field(default_factory=list)
    error: SeaclutterError | None = None

    @contextmanager
    def progress(self, title: str, total: int | None, unit: str = "frame") -> Iterator[Step]:  # noqa: ARG002
        """Report the share that is done after each frame, if the total is known."""
        done = 0

        def step() -> None:
            nonlocal done
            done += 1
            if total:
                self.report(min(done / total, 1.0))

        yield step

    def note(self, text: str, *, detail: bool = False) -> None:
        """Keep a note, or pass it on."""
        self._add("note", text, detail=detail)

    def warn(self, text: str) -> None:
        """Keep a warning, or pass it on."""
        self._add("warn", text)

    def _add(self, kind: str, text: str, *, detail: bool = False) -> None:
        self.messages.append((kind, text, detail))
        if self.observer:
            self.repeat(self.observer)

    def damage(self, damage: Sequence[Damage]) -> None:
        """Ignore damage: the outcome lists it."""

    def fail(self, error: SeaclutterError) -> None:
        """Keep an error."""
        self.error = error

    def done(self, line: str, damage: Sequence[Damage], error: SeaclutterError | None) -> None:
        """Ignore the end: who started the work reports it."""

    def repeat(self, observer: Observer) -> None:
        """Pass the messages that were kept on to another observer."""
        for kind, text, detail in self.messages:
            named = text if text.startswith(f"{self.name}:") else f"{self.name}: {text}"
            if kind == "warn":
                observer.warn(named)
            else:
                observer.note(named, detail=detail)
        self.messages.clear()
