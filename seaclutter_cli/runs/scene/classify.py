"""Trained classifiers of scenes on recordings: prediction, and evaluation where the scenes are known."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from seaclutter_cli.buckets import on_paths
from seaclutter_cli.errors import InputError, UsageError
from seaclutter_cli.frame import Frame
from seaclutter_cli.reading import frames
from seaclutter_cli.runs.observer import SILENT, Observer, Step
from seaclutter_cli.runs.options import Logs, ReadOptions, of_options
from seaclutter_cli.runs.options.classifiers import ClassifierOptions, LabelledLogs
from seaclutter_cli.runs.outputs import Paths, inputs_of, may_appear, prepare_outputs
from seaclutter_cli.runs.recordings import Outcome, RecordingsResult, WithData, expand, opened, storing_errors
from seaclutter_cli.scenes.model import SceneDecision, SceneModel, SceneTracker
from seaclutter_cli.scenes.training import SceneScores
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup
from seaclutter_cli.sinks.csv import csv_line
from seaclutter_cli.sources.recordings import Recording
from seaclutter_cli.text import count, share, table

_MISCLASSIFIED = ("recording", "scene", "wrong", "frames")


@on_paths
@of_options
def predict_scenes(
    logs: Logs,
    options: ClassifierOptions | None = None,
    reading: ReadOptions | None = None,
    observer: Observer = SILENT,
) -> "ScenePrediction":
    """Return the scene of each topic of recordings, with the number of frames of each class.

    Examples
    --------
    >>> import seaclutter
    >>> (scenes,) = seaclutter.predict_scenes("samples/sea.mcap").outcomes
    >>> scenes.topics["/points"].scene, dict(scenes.topics["/points"].frames)
    ('open', {'open': 60})
    """
    recordings = expand(logs, reading, observer)
    return ScenePrediction(*_classify([(one, "") for one in recordings], options, reading, observer))


@of_options
def evaluate_scenes(
    logs: LabelledLogs,
    options: ClassifierOptions | None = None,
    reading: ReadOptions | None = None,
    observer: Observer = SILENT,
) -> "SceneEvaluation":
    """Evaluate a scene classifier on recordings with known scenes.

    Examples
    --------
    >>> import seaclutter
    >>> logs = seaclutter.LabelledLogs(scenes=("open=samples/sea.mcap",))
    >>> seaclutter.evaluate_scenes(logs).confusion.counts
    array([[60,  0],
           [ 0,  0]])
    """
    labelled = [(one.recording, one.scene) for one in logs.find()]
    return SceneEvaluation(*_classify(labelled, options, reading, observer))


def _classify(
    logs: Sequence[tuple[Recording, str]],
    options: ClassifierOptions | None,
    reading: ReadOptions | None,
    observer: Observer,
) -> "tuple[list[ClassifiedLog], Sequence[str]]":
    """Classify the frames of recordings, and write the table of frames; an error is kept in its outcome.

    Each recording comes with its true class, if it is known. The classes of the model are returned, too.
    """
    options, reading = options or ClassifierOptions(), reading or ReadOptions()
    inputs: Paths = {**inputs_of((one for one, _ in logs), reading), "--model": Path(options.model)}
    prepare_outputs({"--csv": options.csv_file}, inputs, force=options.force, observer=observer)
    model = SceneModel(options.model)
    known = sorted({scene for _, scene in logs} - {""})
    if unknown := [scene for scene in known if scene not in model.classes]:
        raise UsageError(f"{model.name}: unknown class {', '.join(unknown)}; the model has {', '.join(model.classes)}")
    columns = ("recording", "topic", "frame", "stamp_ns", *(["truth"] if known else []), "scene", "decided")
    new_tracker = partial(SceneTracker, model, every=options.every, hold=options.hold)
    outcomes = [ClassifiedLog(recording=one.name, truth=scene, new_tracker=new_tracker) for one, scene in logs]
    with OutputGroup(replace=options.force) as files:
        with ExitStack() as stack:
            table = stack.enter_context(AtomicFile(options.csv_file, files)).stream if options.csv_file else None
            if table:
                table.write(csv_line((*columns, *(f"p_{name}" for name in model.classes))))
            step = stack.enter_context(observer.progress("frames", None))
            for (recording, _), found in zip(logs, outcomes, strict=True):
                with storing_errors(found, observer):
                    for frame in read_frames(recording, reading, observer, step, found):
                        row = found.add(frame)
                        if table:
                            table.write(csv_line(row))
        if not may_appear([options.csv_file], outcomes, observer):
            files.discard()
    return outcomes, model.classes


@dataclass
class TopicScenes(WithData):
    """Predicted scenes of one topic: the number of frames by scene, and of changes of the scene."""

    data = "scene changes frames=by_class"

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

    @property
    def by_class(self) -> dict[str, int]:
        """Number of frames of each class of the model."""
        return {name: self.frames[name] for name in self.tracker.classes}


@dataclass(kw_only=True)
class ClassifiedLog(Outcome):
    """Predicted scenes of one recording, by topic; with its true class, where it is known."""

    data = "recording topics damage error"

    truth: str = ""
    new_tracker: Callable[[], SceneTracker] = field(repr=False)
    topics: dict[str, TopicScenes] = field(default_factory=dict)

    def add(self, frame: Frame) -> list[object]:
        """Classify a frame among those of its topic; return its row, with the latest probability of each class."""
        if frame.topic not in self.topics:
            self.topics[frame.topic] = TopicScenes(self.new_tracker())
        found = self.topics[frame.topic].add(frame)
        probabilities = (f"{value:.4f}" for value in found.probabilities.values())
        position = (self.recording, frame.topic, frame.index, frame.stamp_ns)
        return [*position, *([self.truth] if self.truth else []), found.name, int(found.decided), *probabilities]

    @property
    def frames(self) -> Counter[str]:
        """Number of frames by predicted class."""
        return sum((one.frames for one in self.topics.values()), Counter())

    @property
    def wrong(self) -> int:
        """Number of misclassified frames."""
        return self.frames.total() - self.frames[self.truth]


@dataclass(frozen=True)
class ScenePrediction(RecordingsResult):
    """Predicted scenes of several recordings, among the classes of the model."""

    outcomes: Sequence[ClassifiedLog]
    classes: Sequence[str]

    def as_text(self) -> str:
        """Return the scenes as human-readable text."""
        rows = []
        for log in self.outcomes:
            for name, one in log.topics.items():
                frames = one.frames.total()
                shares = (share(one.frames[scene], frames) for scene in self.classes)
                rows.append((log.recording, name, frames, one.scene, one.changes, *shares))
        head = ("recording", "topic", "frames", "scene", "changes", *self.classes)
        return table(head, rows) if rows else ""


@dataclass(frozen=True)
class SceneEvaluation(RecordingsResult):
    """Evaluation of a classifier on several recordings, by the classes of the model."""

    outcomes: Sequence[ClassifiedLog]
    classes: Sequence[str]

    @property
    def read(self) -> list[ClassifiedLog]:
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
        return f"{title}\n{confusion.as_text()}"

    def as_detailed_text(self) -> str:
        """Return the result, and below it the recordings that have misclassified frames."""
        wrong = [table(_MISCLASSIFIED, self.misclassified)] if self.misclassified else []
        return "\n".join([self.as_text(), *wrong])


def read_frames(
    recording: Recording, reading: ReadOptions, observer: Observer, step: Step, outcome: Outcome
) -> Iterator[Frame]:
    """Yield the selected frames of a recording; pass on its warnings, and store its damage in the outcome.

    Raise `InputError` if no frame can be read.
    """
    found = 0
    with opened(recording, reading, observer, outcome) as source:
        for found, frame in enumerate(frames(source, reading.selection), 1):  # noqa: B007 - used below
            step()
            yield frame
    if not found:
        damage = "".join(f"; {item}" for item in outcome.damage[:1])
        raise InputError(f"{source.name}: no frame can be read{damage}")
