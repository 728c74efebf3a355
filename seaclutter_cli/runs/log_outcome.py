"""Outcome of work that writes a log for each recording."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from seaclutter_cli.buckets import mirror_of
from seaclutter_cli.pipeline import TopicTally
from seaclutter_cli.runs.batch import size_of
from seaclutter_cli.runs.recordings import Outcome, RecordingsResult, statuses
from seaclutter_cli.text import data_size


@dataclass(kw_only=True)
class LogOutcome(Outcome):
    """Outcome of work on one recording, with a log as output, or the first of its parts.

    ``topics`` are sums over the frames of each cloud topic; ``bytes_in`` and ``bytes_out`` are the sizes of recording
    and log.
    """

    output: Path
    topics: dict[str, TopicTally] = field(default_factory=dict)
    bytes_in: int = 0
    bytes_out: int = 0

    @property
    def frames(self) -> int:
        """Number of frames of all topics."""
        return sum(tally.frames for tally in self.topics.values())

    @property
    def points_in(self) -> int:
        """Number of points of all topics."""
        return sum(tally.points_in for tally in self.topics.values())

    def counts(self) -> dict[str, Any]:
        """Return further columns of the manifest of a run."""
        return {
            "output": None if self.error else str(self.output),
            "frames": self.frames,
            "points_in": self.points_in,
            "bytes_in": self.bytes_in,
            "bytes_out": self.bytes_out,
        }


def output_size(outcome: LogOutcome) -> int:
    """Return the size of an output in bytes; 0 if there is none."""
    if outcome.error:
        return 0
    mirror = mirror_of(outcome.output)
    return mirror.size(outcome.output) if mirror else size_of(outcome.output)


@dataclass(frozen=True)
class LogSummary(RecordingsResult):
    """Outcomes of work on several recordings with logs as outputs, and the duration of the run in seconds."""

    is_summary = True

    outcomes: Sequence[LogOutcome]
    seconds: float = 0.0

    def as_text(self) -> str:
        """Return the outcome of one recording, or the totals of several, as human-readable text."""
        return self.details() if len(self.outcomes) == 1 else self.totals()

    def totals(self) -> str:
        """Return how the recordings ended, and sizes."""
        read, written = (sum(getattr(one, name) for one in self.outcomes) for name in ("bytes_in", "bytes_out"))
        return f"{statuses(self.outcomes)}; {data_size(read)} in, {data_size(written)} out"
