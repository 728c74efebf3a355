"""An observer for work in another process: what it receives is sent along with the result."""

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

    Attributes
    ----------
    messages : list
        Method, arguments and options of the calls to repeat.
    error : SeaclutterError or None
        Error that ended the work.
    """

    report: Report
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
        """Keep a note."""
        self.messages.append(("note", text, detail))

    def warn(self, text: str) -> None:
        """Keep a warning."""
        self.messages.append(("warn", text, False))

    def damage(self, damage: Sequence[Damage]) -> None:
        """Ignore damage: the outcome lists it."""

    def fail(self, error: SeaclutterError) -> None:
        """Keep an error."""
        self.error = error

    def done(self, line: str, damage: Sequence[Damage], error: SeaclutterError | None) -> None:
        """Ignore the end: who started the work reports it."""

    def repeat(self, name: str, observer: Observer) -> None:
        """Repeat the messages of a recording for another observer."""
        for kind, text, detail in self.messages:
            named = text if text.startswith(f"{name}:") else f"{name}: {text}"
            if kind == "warn":
                observer.warn(named)
            else:
                observer.note(named, detail=detail)
