"""Results of conversions, as text and as data."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from seaclutter_cli.runs.log_outcome import LogOutcome
from seaclutter_cli.runs.recordings import RecordingsResult, statuses
from seaclutter_cli.text import count, data_size, printable


@dataclass(kw_only=True)
class ConvertOutcome(LogOutcome):
    """Outcome of the conversion of one recording.

    Parameters
    ----------
    form : str
        Name of the format of the output.
    messages : int
        Number of messages that were written; 0 if it is that of an earlier run.
    lost : list of str
        What the format cannot keep, in words.
    """

    form: str
    messages: int = 0
    lost: list[str] = field(default_factory=list)

    def figures(self) -> str:
        """Return frames, points and duration, for a line about the outcome."""
        if self.skipped:
            return f"{count(self.frames, 'frame')}; skipped, the output was complete"
        return f"{self._amounts()}, {self.seconds:.1f} s -> {printable(str(self.output))}"

    def _amounts(self) -> str:
        return f"{count(self.messages, 'message')}, {count(self.frames, 'frame')} of {count(self.points_in, 'point')}"

    def counts(self) -> dict[str, Any]:
        """Return further columns of the manifest of a run."""
        return {**super().counts(), "points_out": self.points_in}

    def as_dict(self) -> dict[str, Any]:
        """Return the outcome as JSON-compatible data."""
        return {
            "recording": self.recording,
            "status": self.status,
            "output": None if self.error else str(self.output),
            "format": self.form,
            "error": self.error,
            "damage": [str(item) for item in self.damage],
            "seconds": round(self.seconds, 3),
            "messages": self.messages,
            "topics": {
                topic: {"frames": tally.frames, "points": tally.points_in} for topic, tally in self.topics.items()
            },
            "lost": self.lost,
        }

    def as_text(self) -> str:
        """Return the outcome as human-readable text."""
        if self.skipped:
            return f"{printable(self.recording)}: {self.figures()}"
        lines = [printable(f"{self.recording} -> {self.output}")]
        lines += [
            f"  {printable(topic)}: {count(tally.frames, 'frame')}, {count(tally.points_in, 'point')}"
            for topic, tally in self.topics.items()
        ]
        return "\n".join([*lines, f"{count(self.messages, 'message')} in {self.seconds:.1f} s"])


@dataclass(frozen=True)
class ConvertSummary(RecordingsResult):
    """Outcomes of the conversion of several recordings.

    Parameters
    ----------
    outcomes : sequence of ConvertOutcome
        Outcome of each recording.
    seconds : float
        Duration of the run.
    """

    is_summary = True

    outcomes: Sequence[ConvertOutcome]
    seconds: float = 0.0

    def as_dict(self) -> list[dict[str, Any]]:
        """Return the outcomes as JSON-compatible data."""
        return [outcome.as_dict() for outcome in self.outcomes]

    def as_text(self) -> str:
        """Return the outcome of one recording, or the totals of several, as human-readable text."""
        if len(self.outcomes) == 1:
            return self.details()
        read, written = (sum(getattr(one, name) for one in self.outcomes) for name in ("bytes_in", "bytes_out"))
        return f"{statuses(self.outcomes)}; {data_size(read)} in, {data_size(written)} out"

    def details(self) -> str:
        """Return the outcomes without an error as human-readable text."""
        return "\n\n".join(outcome.as_text() for outcome in self.outcomes if not outcome.error)
