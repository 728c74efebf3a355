"""Work on recordings, and the files of a run, before anything is read or written."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from seaclutter_cli.interfaces import Source
from seaclutter_cli.records import Channel
from seaclutter_cli.runs.log_outcome import LogOutcome
from seaclutter_cli.runs.outputs import Paths, Root
from seaclutter_cli.sources import Recording


class PlannedWork(Protocol):
    """Work on one recording, as far as its plan and estimate need it."""

    @property
    def options(self) -> Any:
        """Options of the run, with ``reading``, ``batch`` and ``force``."""

    @property
    def recording(self) -> Recording:
        """The recording."""

    @property
    def target(self) -> Path:
        """Its output."""

    @property
    def output(self) -> Path:
        """Its output, or the first of its parts."""

    @property
    def form(self) -> str:
        """Name of the format of the output."""

    def clouds(self, source: Source) -> list[Channel]:
        """Return the channels whose frames count."""

    def sample(self, target: Path, frames: int) -> LogOutcome:
        """Do the work with the first frames and another output."""

    def without_result(self, reason: str | None) -> LogOutcome:
        """Return an outcome without frames."""

    def earlier(self) -> tuple[LogOutcome | None, str]:
        """Return the outcome of an earlier run whose output is complete, or what differs."""


W = TypeVar("W", bound=PlannedWork)


@dataclass(frozen=True)
class PlannedWorks(Generic[W]):
    """Work on each recording of a run, and the files that the run reads and writes.

    Parameters
    ----------
    works : list of PlannedWork
        Work on each recording.
    inputs, outputs : mapping of str to path, paths or None
        Files by option.
    root : Root
        Folder of the outputs, or the only one.
    """

    works: list[W]
    inputs: Paths
    outputs: Paths
    root: Root
