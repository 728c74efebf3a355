"""Tables of scenes told: the confusion matrix, and a line for each frame."""

import csv
import io
from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from types import TracebackType

from seaclutter_cli.frame import Frame
from seaclutter_cli.scenes.scores import SceneScores
from seaclutter_cli.scenes.tracker import SceneDecision
from seaclutter_cli.sinks.atomic import AtomicFile
from seaclutter_cli.text import share, table


def confusion_table(confusion: SceneScores) -> str:
    """Return a table: what frames show in rows, what they were taken for in columns."""
    classes = list(confusion.classes)
    rows = []
    for name, counts, right in zip(classes, confusion.counts.tolist(), range(len(classes)), strict=True):
        rows.append((name, *(f"{frames:,}" for frames in counts), share(counts[right], sum(counts))))
    told = confusion.counts.sum(axis=0).tolist()
    right_ones = confusion.counts.diagonal().tolist()
    rows.append(("precision", *(share(part, whole) for part, whole in zip(right_ones, told, strict=True)), ""))
    return table(("is \\ told", *classes, "recall"), rows)


class SceneTable(AbstractContextManager["SceneTable"]):
    """Writes a line for each frame; does nothing without a file.

    Parameters
    ----------
    path : Path or None
        The file; it appears when the context is left without an error.
    classes : sequence of str
        Scenes that the classifier knows; a column each, with their probability at the last look.
    truth : bool
        Whether there is a column for the true scene.
    """

    def __init__(self, path: Path | None, classes: Sequence[str], *, truth: bool) -> None:
        self._classes, self._truth = classes, truth
        self._file: AtomicFile | None = AtomicFile(path) if path else None
        columns = ("recording", "topic", "frame", "stamp_ns", *(["truth"] if truth else []), "scene", "decided")
        self._line((*columns, *(f"p_{name}" for name in classes)))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Complete the file under its name, or remove it after an error."""
        if self._file:
            self._file.__exit__(kind, error, trace)

    def write(self, recording: str, frame: Frame, decision: SceneDecision, truth: str = "") -> None:
        """Write the line of a frame."""
        place = (recording, frame.topic, frame.index, frame.stamp_ns, *([truth] if self._truth else []))
        chances = (f"{decision.probabilities[name]:.4f}" for name in self._classes)
        self._line((*place, decision.name, int(decision.decided), *chances))

    def _line(self, values: Sequence[object]) -> None:
        if self._file:
            text = io.StringIO()
            csv.writer(text, lineterminator="\n").writerow(values)
            self._file.stream.write(text.getvalue().encode(errors="surrogateescape"))  # names need not be UTF-8
