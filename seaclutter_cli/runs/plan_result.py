"""Plans of runs, as text and as data."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from seaclutter_cli.runs.recordings import Outcome, RecordingsResult
from seaclutter_cli.text import count, data_size, printable, table

_STATUSES = ("do", "skip", "refuse")


@dataclass(kw_only=True)
class Planned(Outcome):
    """What a run would do with one recording.

    Parameters
    ----------
    input, output : Path
        First file of the recording, and its output.
    bytes_in : int
        Size of the recording; 0 if it is unknown.
    frames : int or None
        Number of frames that are expected; None if it is unknown before reading.
    reason : str
        Why it would be done again.
    """

    input: Path
    output: Path
    bytes_in: int
    frames: int | None = None
    reason: str = ""

    @property
    def status(self) -> str:
        """What would be done: ``do``, ``skip`` or ``refuse``."""
        return "refuse" if self.error else "skip" if self.skipped else "do"

    @property
    def explanation(self) -> str:
        """Why the recording would be refused, skipped or done again, and its output otherwise."""
        if self.error:
            return self.error
        if self.skipped:
            return "the output is complete"
        damaged = f"; {count(len(self.damage), 'damaged part')}" if self.damage else ""
        return f"{self.reason + '; ' if self.reason else ''}-> {self.output}{damaged}"

    def line(self) -> str:
        """Return nothing: the result lists all recordings."""
        return ""

    def as_dict(self) -> dict[str, Any]:
        """Return the plan as JSON-compatible data."""
        return {
            "recording": self.recording,
            "input": str(self.input),
            "output": str(self.output),
            "status": self.status,
            "reason": self.error or ("the output is complete" if self.skipped else self.reason or None),
            "frames": self.frames,
            "bytes_in": self.bytes_in,
            "damage": [str(item) for item in self.damage],
        }


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """Duration and outputs of a run, from a sample.

    Parameters
    ----------
    seconds : float
        Duration with ``jobs`` processes.
    bytes_out : int
        Size of all outputs.
    jobs : int
        Number of processes.
    sample : str
        Recording that the sample is from.
    frames : int
        Number of frames of the sample.
    """

    seconds: float
    bytes_out: int
    jobs: int
    sample: str
    frames: int

    def __str__(self) -> str:
        """Return the estimate with its basis."""
        processes = f"{self.jobs:,} process{'' if self.jobs == 1 else 'es'}"
        basis = f"the first {count(self.frames, 'frame')} of {printable(self.sample)}"
        return f"about {_duration(self.seconds)} with {processes}, {data_size(self.bytes_out)} out; from {basis}"


def _duration(seconds: float) -> str:
    """Return a duration in two digits.

    Examples
    --------
    >>> _duration(0.2), _duration(150), _duration(20_000)
    ('1 s', '2.5 min', '5.6 h')
    """
    if seconds < 99.5:
        return f"{max(seconds, 1):.0f} s"
    return f"{seconds / 60:.2g} min" if seconds < 5970 else f"{seconds / 3600:.2g} h"


@dataclass(frozen=True)
class RunPlan(RecordingsResult):
    """What a run would do.

    Parameters
    ----------
    outcomes : sequence of Planned
        What it would do with each recording.
    estimate : Estimate or None
        Duration and outputs, if there is something to do and a sample could be processed.
    free_bytes : int or None
        Free space for the outputs; None in object storage.
    """

    outcomes: Sequence[Planned]
    estimate: Estimate | None = None
    free_bytes: int | None = None

    @property
    def damaged(self) -> bool:
        """Whether the parts of any recording to be done are damaged, as far as opening it shows."""
        return any(one.damage and not one.skipped for one in self.outcomes)

    @property
    def is_too_large(self) -> bool:
        """Whether the outputs need more than the free space, by the estimate."""
        return bool(self.estimate and self.free_bytes is not None and self.estimate.bytes_out > self.free_bytes)

    def as_dict(self) -> dict[str, Any]:
        """Return the plan as JSON-compatible data."""
        return {
            "recordings": [one.as_dict() for one in self.outcomes],
            "estimate": asdict(self.estimate) if self.estimate else None,
            "free_bytes": self.free_bytes,
        }

    def as_text(self) -> str:
        """Return a line for each recording, and the totals."""
        rows = [
            (one.recording, data_size(one.bytes_in), "-" if one.frames is None else f"{one.frames:,}", one.status)
            for one in self.outcomes
        ]
        head, *lines = table(("recording", "size", "frames", "plan"), rows).splitlines()
        listed = [f"{line}  {printable(one.explanation)}" for line, one in zip(lines, self.outcomes, strict=True)]
        found = Counter(one.status for one in self.outcomes)
        todo = data_size(sum(one.bytes_in for one in self.outcomes if one.status == "do"))
        numbers = ", ".join(f"{found[status]:,} to {status}" for status in _STATUSES if found[status])
        free = f"; {data_size(self.free_bytes)} free" if self.free_bytes is not None else ""
        last = [f"{numbers}; {todo} in{free}", *([str(self.estimate)] if self.estimate else [])]
        return "\n".join((head, *listed, *last))
