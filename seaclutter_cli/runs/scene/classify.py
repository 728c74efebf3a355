"""Trained classifiers of scenes on recordings: prediction, and evaluation where the scenes are known."""

from abc import abstractmethod
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from seaclutter_cli.buckets import on_paths
from seaclutter_cli.errors import UsageError
from seaclutter_cli.frame import Frame
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.options import Logs, ReadOptions
from seaclutter_cli.runs.options.scenes import ClassifierOptions, LabelledLogs
from seaclutter_cli.runs.outputs import Paths, inputs_of, may_appear, prepare_outputs
from seaclutter_cli.runs.recordings import Outcome, RecordingsResult, expand, storing_errors
from seaclutter_cli.runs.scene.logs import confusion_table, read_frames
from seaclutter_cli.scenes.model import SceneDecision, SceneModel, SceneTracker
from seaclutter_cli.scenes.training import SceneScores
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup
from seaclutter_cli.sinks.csv import csv_line
from seaclutter_cli.sources import Recording
from seaclutter_cli.text import count, share, table

_MISCLASSIFIED = ("recording", "scene", "wrong", "frames")


@on_paths
def predict_scenes(
    logs: Logs,
    options: ClassifierOptions | None = None,
    reading: ReadOptions | None = None,
    observer: Observer = SILENT,
) -> "ScenePrediction":
    """Return the scene of each topic of recordings, with the number of frames of each class.

    Parameters
    ----------
    logs : path, or sequence of paths
        Files, folders or globs.
    options : ClassifierOptions, optional
        Classifier, and additional output.
    reading : ReadOptions, optional
        Part of each recording to read.
    observer : Observer, optional
        Receives progress and warnings.

    Raises
    ------
    MissingExtraError
        If onnxruntime is not installed.
    SeaclutterError
        If the whole run fails; an error in one recording is kept in its outcome.

    Examples
    --------
    >>> import seaclutter
    >>> (scenes,) = seaclutter.predict_scenes("samples/sea.mcap").outcomes
    >>> scenes.topics["/points"].scene, dict(scenes.topics["/points"].frames)
    ('open', {'open': 60})
    """
    options, reading = options or ClassifierOptions(), reading or ReadOptions()
    recordings = expand(logs, reading, observer)
    model = _model(recordings, options, reading, observer)
    new_tracker = partial(SceneTracker, model, every=options.every, hold=options.hold)
    outcomes = [
        RecordingScenes(recording=one.name, new_tracker=new_tracker, classes=model.classes) for one in recordings
    ]
    _classify(recordings, outcomes, model.classes, options, reading, observer)
    return ScenePrediction(outcomes, model.classes)


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
    recordings = [log.recording for log in labelled]
    model = _model(recordings, options, reading, observer)
    unknown = sorted({log.scene for log in labelled} - set(model.classes))
    if unknown:
        raise UsageError(f"{model.name}: unknown class {', '.join(unknown)}; the model has {', '.join(model.classes)}")
    new_tracker = partial(SceneTracker, model, every=options.every, hold=options.hold)
    outcomes = [EvaluatedLog(recording=it.recording.name, truth=it.scene, tracker=new_tracker()) for it in labelled]
    _classify(recordings, outcomes, model.classes, options, reading, observer)
    return SceneEvaluation(outcomes, model.classes)


def _model(
    recordings: Sequence[Recording], options: ClassifierOptions, reading: ReadOptions, observer: Observer
) -> SceneModel:
    """Return the classifier of a run, after a check of its output."""
    inputs: Paths = {**inputs_of(recordings, reading), "--model": Path(options.model)}
    prepare_outputs({"--csv": options.csv_file}, inputs, force=options.force, observer=observer)
    return SceneModel(options.model)


@dataclass(kw_only=True)
class _Classified(Outcome):
    """Outcome of a classifier on one recording; with its true class, where it is known."""

    truth: str = ""

    @abstractmethod
    def add(self, frame: Frame) -> SceneDecision:
        """Classify a frame, in order; return its scene."""


def _classify(
    recordings: Sequence[Recording],
    outcomes: Sequence[_Classified],
    classes: Sequence[str],
    options: ClassifierOptions,
    reading: ReadOptions,
    observer: Observer,
) -> None:
    """Classify the frames of all recordings, and write the table of frames; an error is kept in its outcome."""
    truth_known = any(found.truth for found in outcomes)
    columns = ("recording", "topic", "frame", "stamp_ns", *(["truth"] if truth_known else []), "scene", "decided")
    with OutputGroup(replace=options.force) as files:
        with ExitStack() as stack:
            step = stack.enter_context(observer.progress("frames", None))
            table = stack.enter_context(AtomicFile(options.csv_file, files)).stream if options.csv_file else None
            if table:
                table.write(csv_line((*columns, *(f"p_{name}" for name in classes))))
            for recording, found in zip(recordings, outcomes, strict=True):
                with storing_errors(found, observer):
                    for frame in read_frames(recording, reading, observer, step, found.damage):
                        decision = found.add(frame)
                        if table:
                            table.write(csv_line(_cells(frame, decision, found, classes)))
        if not may_appear([options.csv_file], outcomes, observer):
            files.discard()


def _cells(frame: Frame, decision: SceneDecision, found: _Classified, classes: Sequence[str]) -> list[object]:
    """Return the row of a frame, with the probability of each class in the latest classification."""
    truth = [found.truth] if found.truth else []
    probabilities = (f"{decision.probabilities[name]:.4f}" for name in classes)
    position = (found.recording, frame.topic, frame.index, frame.stamp_ns)
    return [*position, *truth, decision.name, int(decision.decided), *probabilities]


@dataclass
class TopicScenes:
    """Predicted scenes of one topic: the number of frames by scene, and of changes of the scene."""

    tracker: SceneTracker
    frames: Counter[str] = field(default_factory=Counter)
    changes: int = 0
    _last: str = ""

    def add(self, frame: Frame) -> SceneDecision:
        """Classify a frame and return its scene."""
        decision = self.tracker.scene(frame)
        self.frames[decision.name] += 1
        self.changes += self._last not in ("", decision.name)
        self._last = decision.name
        return decision

    @property
    def scene(self) -> str:
        """Most frequent scene."""
        return self.frames.most_common(1)[0][0]


@dataclass(kw_only=True)
class RecordingScenes(_Classified):
    """Predicted scenes of one recording, by topic."""

    new_tracker: Callable[[], SceneTracker] = field(repr=False)
    classes: Sequence[str]
    topics: dict[str, TopicScenes] = field(default_factory=dict)

    def add(self, frame: Frame) -> SceneDecision:
        """Classify a frame among those of its topic; return its scene."""
        if frame.topic not in self.topics:
            self.topics[frame.topic] = TopicScenes(self.new_tracker())
        return self.topics[frame.topic].add(frame)

    def as_dict(self) -> dict[str, Any]:
        """Return the scenes as JSON-compatible data."""
        topics = {
            topic: {"scene": one.scene, "changes": one.changes, "frames": {it: one.frames[it] for it in self.classes}}
            for topic, one in self.topics.items()
        }
        damage = [str(item) for item in self.damage]
        return {"recording": self.recording, "topics": topics, "damage": damage, "error": self.error}

    def rows(self) -> list[tuple[object, ...]]:
        """Return the rows of the table."""
        rows = []
        for name, one in self.topics.items():
            frames = one.frames.total()
            shares = (share(one.frames[scene], frames) for scene in self.classes)
            rows.append((self.recording, name, frames, one.scene, one.changes, *shares))
        return rows


@dataclass(frozen=True)
class ScenePrediction(RecordingsResult):
    """Predicted scenes of several recordings, among the classes of the model."""

    outcomes: Sequence[RecordingScenes]
    classes: Sequence[str]

    def as_text(self) -> str:
        """Return the scenes as human-readable text."""
        rows = [row for one in self.outcomes for row in one.rows()]
        head = ("recording", "topic", "frames", "scene", "changes", *self.classes)
        return table(head, rows) if rows else ""


@dataclass(kw_only=True)
class EvaluatedLog(_Classified):
    """Evaluation of a classifier on one recording: the number of frames by predicted class."""

    tracker: SceneTracker = field(repr=False)
    frames: Counter[str] = field(default_factory=Counter)

    def add(self, frame: Frame) -> SceneDecision:
        """Classify a frame and return its scene."""
        decision = self.tracker.scene(frame)
        self.frames[decision.name] += 1
        return decision

    @property
    def wrong(self) -> int:
        """Number of misclassified frames."""
        return self.frames.total() - self.frames[self.truth]


@dataclass(frozen=True)
class SceneEvaluation(RecordingsResult):
    """Evaluation of a classifier on several recordings, by the classes of the model."""

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
            counts[self.classes.index(log.truth)] += [log.frames[name] for name in self.classes]
        return SceneScores(counts, self.classes)

    @property
    def misclassified(self) -> list[tuple[str, str, int, int]]:
        """Name, true class, misclassified frames and all frames of each recording with a misclassified frame."""
        return [(log.recording, log.truth, log.wrong, log.frames.total()) for log in self.read if log.wrong]

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

    def as_text(self) -> str:
        """Return the result as human-readable text."""
        confusion = self.confusion
        frames, correct = count(int(confusion.counts.sum()), "frame"), len(self.read) - len(self.misclassified)
        title = f"{frames} of {count(len(self.read), 'recording')}, {correct} of them without a misclassified frame"
        return f"{title}\n{confusion_table(confusion)}"

    def details(self) -> str:
        """Return the recordings that have misclassified frames."""
        return table(_MISCLASSIFIED, self.misclassified) if self.misclassified else ""

    def as_detailed_text(self) -> str:
        """Return the result with its details below it."""
        return "\n".join(filter(None, (self.as_text(), self.details())))
