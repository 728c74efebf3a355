"""How well a classifier recognises the scenes of recordings where they are known."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from seaclutter_cli.errors import UsageError
from seaclutter_cli.runs.observer import SILENT, Observer, Step
from seaclutter_cli.runs.outputs import check_outputs, inputs_of
from seaclutter_cli.runs.recordings import Outcome, ReadOptions, RecordingsResult, keeping_errors
from seaclutter_cli.runs.scene.logs import ClassifierOptions, LabelledLog, LabelledLogs, read_frames
from seaclutter_cli.runs.scene.table import SceneTable, confusion_table
from seaclutter_cli.scenes.model import SceneModel
from seaclutter_cli.scenes.scores import SceneScores
from seaclutter_cli.scenes.tracker import SceneTracker
from seaclutter_cli.text import count, table


def evaluate_scenes(
    logs: LabelledLogs,
    options: ClassifierOptions | None = None,
    reading: ReadOptions | None = None,
    observer: Observer = SILENT,
) -> "SceneEvaluation":
    """Test a classifier on recordings whose scenes are known.

    Parameters
    ----------
    logs : LabelledLogs
        Recordings by the class of their scene.
    options : ClassifierOptions, optional
        The classifier.
    reading : ReadOptions, optional
        What is read.
    observer : Observer, optional
        Receives progress and warnings.

    Raises
    ------
    UsageError
        If the classifier does not know a class.
    SeaclutterError
        If nothing can be done at all; what goes wrong with one recording is kept in its outcome.

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
    check_outputs([options.csv_file], inputs_of(log.recording for log in labelled), force=options.force)
    model = SceneModel(options.model)
    unknown = sorted({log.scene for log in labelled} - set(model.classes))
    if unknown:
        raise UsageError(f"{model.name} tells {' and '.join(model.classes)}, not {', '.join(unknown)}")
    with SceneTable(options.csv_file, model.classes, truth=True) as lines, observer.progress("frames", None) as step:
        tester = _Tester(model, options, reading, observer, lines)
        return SceneEvaluation([tester.run(log, step) for log in labelled], model.classes)


@dataclass(frozen=True)
class _Tester:
    """Judges one recording after the other by the same options."""

    model: SceneModel
    options: ClassifierOptions
    reading: ReadOptions
    observer: Observer
    lines: SceneTable

    def run(self, log: LabelledLog, step: Step) -> "JudgedLog":
        """Judge the frames of a recording; an error of its own goes into the outcome."""
        judge = SceneTracker(self.model, every=self.options.every, hold=self.options.hold)
        found = JudgedLog(recording=log.recording.name, scene=log.scene)
        with keeping_errors(found, self.observer):
            for frame in read_frames(log.recording, self.reading, self.observer, step, found.damage):
                decision = judge.scene(frame)
                found.frames[decision.name] += 1
                self.lines.write(found.recording, frame, decision, log.scene)
        return found


@dataclass(kw_only=True)
class JudgedLog(Outcome):
    """What a classifier made of one recording.

    Parameters
    ----------
    scene : str
        Its true class.
    frames : counter of str
        Frames by the class that they were taken for.
    """

    scene: str
    frames: Counter[str] = field(default_factory=Counter)

    @property
    def wrong(self) -> int:
        """Frames taken for another class."""
        return self.frames.total() - self.frames[self.scene]


@dataclass(frozen=True)
class SceneEvaluation(RecordingsResult):
    """What a classifier made of several recordings.

    Parameters
    ----------
    outcomes : sequence of JudgedLog
        One for each recording.
    classes : sequence of str
        Scenes that the classifier knows.
    """

    outcomes: Sequence[JudgedLog]
    classes: Sequence[str]

    @property
    def read(self) -> list[JudgedLog]:
        """The recordings that could be read."""
        return [log for log in self.outcomes if log.error is None]

    @property
    def confusion(self) -> SceneScores:
        """Frames by what they show and what they were taken for."""
        counts = np.zeros((len(self.classes), len(self.classes)), np.int64)
        for log in self.read:
            counts[self.classes.index(log.scene)] += [log.frames[name] for name in self.classes]
        return SceneScores(counts, self.classes)

    @property
    def wrong(self) -> list[tuple[str, str, int, int]]:
        """Name, true class, wrong frames and all frames of the recordings that are not right throughout."""
        return [(log.recording, log.scene, log.wrong, log.frames.total()) for log in self.read if log.wrong]

    def as_dict(self) -> dict[str, Any]:
        """Return the result as JSON holds it."""
        confusion = self.confusion
        return {
            "frames": int(confusion.counts.sum()),
            "recordings": len(self.read),
            "classes": confusion.as_dict(),
            "wrong": [dict(zip(("recording", "is", "wrong", "frames"), row, strict=True)) for row in self.wrong],
            "errors": {log.recording: log.error for log in self.outcomes if log.error},
            "damage": [str(item) for log in self.outcomes for item in log.damage],
        }

    def as_text(self, *, verbose: bool = False) -> str:
        """Return the result as people read it; if verbose, with the recordings that are not right throughout."""
        confusion, wrong = self.confusion, self.wrong
        right = len(self.read) - len(wrong)
        frames = count(int(confusion.counts.sum()), "frame")
        lines = [
            f"{frames} of {len(self.read)} recordings, {right} of them right throughout",
            confusion_table(confusion),
        ]
        if verbose and wrong:
            lines.append(table(("recording", "is", "wrong", "frames"), wrong))
        return "\n".join(lines)
