"""Frames and recordings that are held out: not used to choose the best combination, only to judge it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from seaclutter_cli.evaluation.scores import FrameScore, Summary
from seaclutter_cli.evaluation.tuning import Parts
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.runs.comparison import Evaluated
from seaclutter_cli.text import count
from seaclutter_cli.truth import Truth

_MIN_RECORDINGS = 4
"""Minimum number of recordings of which whole ones are held out."""


class PartsOfRecordings:
    """Listener that stores the scores of each recording in consecutive parts.

    Parameters
    ----------
    methods : int
        Number of methods.
    """

    def __init__(self, methods: int) -> None:
        self._methods = methods
        self.recordings: list[Parts] = []

    def begin(self, recording: str) -> None:  # noqa: ARG002 - they are told apart by their order
        """Start a recording."""
        self.recordings.append(Parts(self._methods))

    def add_frame(
        self,
        frame: Frame,  # noqa: ARG002
        results: Sequence[FilterResult | None],  # noqa: ARG002 - only scores are needed
        truth: Truth | None,
        scores: Sequence[FrameScore | None],
    ) -> None:
        """Store the scores of a labelled frame."""
        if truth is not None:
            self.recordings[-1].add(scores)


@dataclass(frozen=True)
class Split:
    """Scores of the frames used for tuning, and of those held out.

    Parameters
    ----------
    tuned, held_out : mapping of str to Summary
        Sums for each combination; no sums are held out if that was not requested.
    title : str
        What is held out, for messages; empty if nothing is.
    """

    tuned: Mapping[str, Summary]
    held_out: Mapping[str, Summary] = field(default_factory=dict)
    title: str = ""


def split_scores(outcomes: Sequence[Evaluated], parts: Sequence[Parts], names: Sequence[str], share: float) -> Split:
    """Return the scores of recordings without an error, divided into those for tuning and those held out.

    Of four or more recordings, whole ones are held out, evenly spaced; of fewer, the last frames of each. Neighbouring
    frames are alike, so single frames would tell nothing new.

    Parameters
    ----------
    outcomes : sequence of Evaluated
        Outcome of each recording.
    parts : sequence of Parts
        Scores of each recording.
    names : sequence of str
        Names of the combinations.
    share : float
        Share of recordings or frames to hold out, from 0 to 1.
    """
    used = [(outcome, own) for outcome, own in zip(outcomes, parts, strict=True) if not outcome.error]
    held: list[Evaluated] = []
    if share and len(used) >= _MIN_RECORDINGS:
        number = min(max(round(share * len(used)), 1), len(used) - 1)
        held = [used[(k + 1) * len(used) // number - 1][0] for k in range(number)]
    tuned, held_out = ({name: Summary() for name in names} for _ in range(2))
    for outcome, own in used:
        before, end = own.split(float(any(outcome is one for one in held)) if held else share)
        for name, first, last in zip(names, before, end, strict=True):
            tuned[name].update(first)
            held_out[name].update(last)
    frames = max((summary.frames for summary in held_out.values()), default=0)
    if not frames:
        return Split(tuned)
    title = count(frames, "frame")
    if held:
        title += f" ({count(len(held), 'recording')}: {', '.join(outcome.recording for outcome in held)})"
    else:
        title += " at the end of the recording" if len(used) == 1 else " at the ends of the recordings"
    return Split(tuned, held_out, title)
