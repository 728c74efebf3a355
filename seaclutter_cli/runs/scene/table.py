"""Tables of predicted scenes: the confusion matrix, and a line for each frame."""

import csv
import io
from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from types import TracebackType

from seaclutter_cli.frame import Frame
from seaclutter_cli.scenes.tracker import SceneDecision
from seaclutter_cli.scenes.training import SceneScores
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup
from seaclutter_cli.text import share, table


def confusion_table(confusion: SceneScores) -> str:
    """Return a table of frames by true class (row) and predicted class (column)."""
    classes = list(confusion.classes)
    rows = []
    for name, counts, index in zip(classes, confusion.counts.tolist(), range(len(classes)), strict=True):
        rows.append((name, *(f"{frames:,}" for frames in counts), share(counts[index], sum(counts))))
    predicted = confusion.counts.sum(axis=0).tolist()
    correct = confusion.counts.diagonal().tolist()
    rows.append(("precision", *(share(part, whole) for part, whole in zip(correct, predicted, strict=True)), ""))
    return table(("true \\ predicted", *classes, "recall"), rows)


class SceneTable(AbstractContextManager["SceneTable"]):
    """Writer of a CSV table with a line for each frame; does nothing without a file.

    Parameters
    ----------
    path : Path or None
        File to write; it appears when the context ends without an error.
    classes : sequence of str
        Classes of the model; each has a column with its probability in the latest classification.
    truth : bool
        Whether there is a column for the true scene.
    group : OutputGroup, optional
        Files that appear together with this one.
    """

    def __init__(
        self, path: Path | None, classes: Sequence[str], *, truth: bool, group: OutputGroup | None = None
    ) -> None:
        self._classes, self._truth = classes, truth
        self._file: AtomicFile | None = AtomicFile(path, group) if path else None
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
        position = (recording, frame.topic, frame.index, frame.stamp_ns, *([truth] if self._truth else []))
        probabilities = (f"{decision.probabilities[name]:.4f}" for name in self._classes)
        self._line((*position, decision.name, int(decision.decided), *probabilities))

    def _line(self, values: Sequence[object]) -> None:
        if self._file:
            text = io.StringIO()
            csv.writer(text, lineterminator="\n").writerow(values)
            self._file.stream.write(text.getvalue().encode(errors="surrogateescape"))  # names need not be UTF-8
