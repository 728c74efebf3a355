"""Evaluation of a scene classifier on recordings with known scenes."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from seaclutter_cli.errors import UsageError
from seaclutter_cli.runs.observer import SILENT, Observer, Step
from seaclutter_cli.runs.outputs import Paths, inputs_of, may_appear, prepare_outputs
from seaclutter_cli.runs.recordings import Outcome, ReadOptions, RecordingsResult, storing_errors
from seaclutter_cli.runs.scene.logs import ClassifierOptions, LabelledLog, LabelledLogs, read_frames
from seaclutter_cli.runs.scene.table import SceneTable, confusion_table
from seaclutter_cli.scenes.model import SceneModel
from seaclutter_cli.scenes.tracker import SceneTracker
from seaclutter_cli.scenes.training import SceneScores
from seaclutter_cli.sinks.atomic import OutputGroup
from seaclutter_cli.text import count, table

_MISCLASSIFIED = ("recording", "scene", "wrong", "frames")


def evaluate_scenes(
    logs: LabelledLogs,
    options: ClassifierOptions | None = None,
    reading: ReadOptions | None = None,
    observer: Observer = SILENT,
) -> "SceneEvaluation":
    """Evaluate a scene classifier on recordings with known scenes.

    Parameters
    ----------
    logs : LabelledLogs
        Recordings by the class of their scene.
    options : ClassifierOptions, optional
        Classifier, and additional output.
    reading : ReadOptions, optional
        Part of each recording to read.
    observer : Observer, optional
        Receives progress and warnings.

    Raises
    ------
    UsageError
        If the classifier does not know a class.
    SeaclutterError
        If the whole run fails; an error in one recording is kept in its outcome.

    Examples
    --------
    >>> import seaclutter
    >>> logs = seaclutter.LabelledLogs(scenes=("open=samples/sea.mcap",))
    >>> seaclutter.evaluate_scenes(logs).confusion.counts
    array([[60,  0],
           [ 0,  0]])
    """
    options, reading = options or ClassifierOptions(), reading or ReadOptions()
    labelled = logs.find()
    inputs: Paths = {**inputs_of((log.recording for log in labelled), reading), "--model": Path(options.model)}
    prepare_outputs({"--csv": options.csv_file}, inputs, force=options.force, observer=observer)
    model = SceneModel(options.model)
    unknown = sorted({log.scene for log in labelled} - set(model.classes))
    if unknown:
        raise UsageError(f"{model.name}: unknown class {', '.join(unknown)}; the model has {', '.join(model.classes)}")
    with OutputGroup(replace=options.force) as files:
        with (
            SceneTable(options.csv_file, model.classes, truth=True, group=files) as lines,
            observer.progress("frames", None) as step,
        ):
            evaluator = _Evaluator(model, options, reading, observer, lines)
            result = SceneEvaluation([evaluator.run(log, step) for log in labelled], model.classes)
        if not may_appear([options.csv_file], result.outcomes, observer):
            files.discard()
    return result


@dataclass(frozen=True)
class _Evaluator:
    """Evaluation of recordings, one by one, with the same options."""

    model: SceneModel
    options: ClassifierOptions
    reading: ReadOptions
    observer: Observer
    lines: SceneTable

    def run(self, log: LabelledLog, step: Step) -> "EvaluatedLog":
        """Return the scenes of the frames of a recording; an error is kept in the outcome."""
        tracker = SceneTracker(self.model, every=self.options.every, hold=self.options.hold)
        found = EvaluatedLog(recording=log.recording.name, scene=log.scene)
        with storing_errors(found, self.observer):
            for frame in read_frames(log.recording, self.reading, self.observer, step, found.damage):
                decision = tracker.scene(frame)
                found.frames[decision.name] += 1
                self.lines.write(found.recording, frame, decision, log.scene)
        return found


@dataclass(kw_only=True)
class EvaluatedLog(Outcome):
    """Evaluation of a classifier on one recording.

    Parameters
    ----------
    scene : str
        True class.
    frames : counter of str
        Number of frames by predicted class.
    """

    scene: str
    frames: Counter[str] = field(default_factory=Counter)

    @property
    def wrong(self) -> int:
        """Number of misclassified frames."""
        return self.frames.total() - self.frames[self.scene]


@dataclass(frozen=True)
class SceneEvaluation(RecordingsResult):
    """Evaluation of a classifier on several recordings.

    Parameters
    ----------
    outcomes : sequence of EvaluatedLog
        Evaluation of each recording.
    classes : sequence of str
        Classes of the model.
    """

    outcomes: Sequence[EvaluatedLog]
    classes: Sequence[str]

    @property
    def read(self) -> list[EvaluatedLog]:
        """Recordings that could be read."""
        return [log for log in self.outcomes if log.error is None]

    @property
    def confusion(self) -> SceneScores:
        """Frames by true class and predicted class."""
        counts = np.zeros((len(self.classes), len(self.classes)), np.int64)
        for log in self.read:
            counts[self.classes.index(log.scene)] += [log.frames[name] for name in self.classes]
        return SceneScores(counts, self.classes)

    @property
    def misclassified(self) -> list[tuple[str, str, int, int]]:
        """Name, true class, misclassified frames and all frames of each recording with a misclassified frame."""
        return [(log.recording, log.scene, log.wrong, log.frames.total()) for log in self.read if log.wrong]

    def as_dict(self) -> dict[str, Any]:
        """Return the result as JSON-compatible data."""
        confusion = self.confusion
        return {
            "frames": int(confusion.counts.sum()),
            "recordings": len(self.read),
            "classes": confusion.as_dict(),
            "misclassified": [dict(zip(_MISCLASSIFIED, row, strict=True)) for row in self.misclassified],
            "errors": {log.recording: log.error for log in self.outcomes if log.error},
            "damage": [str(item) for log in self.outcomes for item in log.damage],
        }

    def as_text(self, *, verbose: bool = False) -> str:
        """Return the result as human-readable text; if verbose, with the recordings that have misclassified frames."""
        confusion, misclassified = self.confusion, self.misclassified
        correct = len(self.read) - len(misclassified)
        frames = count(int(confusion.counts.sum()), "frame")
        lines = [
            f"{frames} of {count(len(self.read), 'recording')}, {correct} of them without a misclassified frame",
            confusion_table(confusion),
        ]
        if verbose and misclassified:
            lines.append(table(_MISCLASSIFIED, misclassified))
        return "\n".join(lines)
