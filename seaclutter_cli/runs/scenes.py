"""Classifiers of scenes: prediction, evaluation where the scenes are known, and training on recordings."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, astuple, dataclass, field
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from seaclutter_cli.buckets import use_case_of
from seaclutter_cli.errors import InputError, UsageError
from seaclutter_cli.frame import Frame
from seaclutter_cli.plots.curves import draw_training
from seaclutter_cli.plots.figure import render
from seaclutter_cli.reading import frames
from seaclutter_cli.records import Damage
from seaclutter_cli.runs.observer import Observer, Step
from seaclutter_cli.runs.options import ReadOptions
from seaclutter_cli.runs.options.classifiers import EvaluateScenesOptions, PredictScenesOptions, TrainScenesOptions
from seaclutter_cli.runs.outputs import PackedRows, Paths, inputs_of, prepare_outputs, write_files
from seaclutter_cli.runs.recordings import Outcome, RecordingsResult, Result, WithData, expand, opened, storing_errors
from seaclutter_cli.scenes.model import SceneDecision, SceneModel, SceneTracker
from seaclutter_cli.scenes.network import to_onnx
from seaclutter_cli.scenes.training import Epoch, Examples, SceneScores, Trained, check_torch, train
from seaclutter_cli.sinks.atomic import AtomicFile
from seaclutter_cli.sinks.csv import csv_line
from seaclutter_cli.sources.recordings import Recording, find_recordings, is_recording
from seaclutter_cli.text import count, printable, share, table

_MISCLASSIFIED = ("recording", "scene", "wrong", "frames")


@use_case_of(PredictScenesOptions)
def predict_scenes(options: PredictScenesOptions) -> "ScenePrediction":
    """Return the scene of each topic of recordings, with the number of frames of each class.

    Examples
    --------
    >>> import seaclutter
    >>> (scenes,) = seaclutter.predict_scenes("samples/sea.mcap").outcomes
    >>> scenes.topics["/points"].scene, dict(scenes.topics["/points"].frames)
    ('open', {'open': 60})
    """
    recordings = expand(options, options.observer)
    return ScenePrediction(*_classify([(one, "") for one in recordings], options, options.watching))


@use_case_of(EvaluateScenesOptions)
def evaluate_scenes(options: EvaluateScenesOptions) -> "SceneEvaluation":
    """Evaluate a scene classifier on recordings with known scenes.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.evaluate_scenes(scenes="open=samples/sea.mcap").confusion.counts
    array([[60,  0],
           [ 0,  0]])
    """
    return SceneEvaluation(*_classify(_labelled(options), options, options.observer))


def _labelled(options: TrainScenesOptions | EvaluateScenesOptions) -> list[tuple[Recording, str]]:
    """Return recordings with their true classes; raise `UsageError` if there are none, or one has two."""
    named = []
    for text in options.scenes:
        scene, equals, pattern = text.partition("=")
        if not (equals and scene and pattern):
            raise UsageError(f"--scene {text}: write it as CLASS=LOGS, as in open=trials/offshore")
        named.append((scene, pattern))
    named += [(folder.name, str(folder)) for parent in options.folders for folder in _class_folders(parent)]
    if not named:
        raise UsageError("no logs: give a folder that contains a folder for each class, or --scene CLASS=LOGS")
    found: dict[Path, tuple[Recording, str]] = {}
    for scene, pattern in named:
        for recording in find_recordings([pattern]):
            _, first = found.setdefault(recording.key, (recording, scene))
            if first != scene:
                raise UsageError(f"{recording.paths[0]}: labelled as both {first} and {scene}")
    return list(found.values())


def _class_folders(parent: Path) -> Sequence[Path]:
    if not parent.is_dir():
        raise UsageError(f"{parent}: no such folder")
    folders = [child for child in sorted(parent.iterdir()) if child.is_dir() and not child.name.startswith(".")]
    recording = next(filter(is_recording, (parent, *folders)), None)
    if recording or not folders:
        found = f"{recording} is a recording" if recording else "it contains no folders"
        raise UsageError(f"{parent}: must contain a folder of recordings for each class, but {found}")
    return folders


def _classify(
    logs: Sequence[tuple[Recording, str]], options: PredictScenesOptions | EvaluateScenesOptions, observer: Observer
) -> "tuple[list[ClassifiedLog], Sequence[str]]":
    """Classify the frames of recordings, given their classes if known; return the classes of the model, too."""
    inputs: Paths = {**inputs_of((one for one, _ in logs), options), "--model": Path(options.model)}
    prepare_outputs(options.outputs, inputs, force=options.force, observer=observer)
    model = SceneModel(options.model)
    known = sorted({scene for _, scene in logs} - {""})
    if unknown := [scene for scene in known if scene not in model.classes]:
        raise UsageError(f"{model.name}: unknown class {', '.join(unknown)}; the model has {', '.join(model.classes)}")
    columns = ("recording", "topic", "frame", "stamp_ns", *(["truth"] if known else []), "scene", "decided")
    new_tracker = partial(SceneTracker, model, every=options.every, hold=options.hold)
    outcomes = [ClassifiedLog(recording=one.name, truth=scene, new_tracker=new_tracker) for one, scene in logs]
    with observer.progress("frames", None) as step:
        for (recording, _), found in zip(logs, outcomes, strict=True):
            with storing_errors(found, observer):
                for frame in read_frames(recording, options.reading, observer, step, found):
                    found.add(frame)

    def write(file: AtomicFile) -> None:
        file.stream.write(csv_line((*columns, *(f"p_{name}" for name in model.classes))))
        file.stream.writelines(line for one in outcomes for line in one.rows)

    write_files({options.csv_file: write}, replace=options.force, outcomes=outcomes, observer=observer)
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
    rows: PackedRows = field(default_factory=PackedRows, repr=False)

    def add(self, frame: Frame) -> None:
        """Classify a frame among those of its topic, and add its row, with the latest probability of each class."""
        if frame.topic not in self.topics:
            self.topics[frame.topic] = TopicScenes(self.new_tracker())
        found = self.topics[frame.topic].add(frame)
        probabilities = (f"{value:.4f}" for value in found.probabilities.values())
        position = (self.recording, frame.topic, frame.index, frame.stamp_ns)
        truth = [self.truth] if self.truth else []
        self.rows.write(csv_line((*position, *truth, found.name, int(found.decided), *probabilities)))

    @property
    def frames(self) -> Counter[str]:
        """Number of frames by predicted class."""
        return sum((one.frames for one in self.topics.values()), Counter())

    @property
    def wrong(self) -> int:
        """Number of misclassified frames."""
        return self.frames.total() - self.frames[self.truth]


@dataclass(frozen=True)
class ScenePrediction(RecordingsResult[ClassifiedLog]):
    """Predicted scenes of several recordings, among the classes of the model."""

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
class SceneEvaluation(RecordingsResult[ClassifiedLog]):
    """Evaluation of a classifier on several recordings, by the classes of the model."""

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


@use_case_of(TrainScenesOptions)
def train_scenes(options: TrainScenesOptions) -> "SceneTraining":
    """Train a scene classifier on recordings with known scenes, and write it as an ONNX file.

    Examples
    --------
    >>> import seaclutter
    >>> scenes = "open=trials/offshore", "confined=trials/harbour"
    >>> made = seaclutter.train_scenes(scenes=scenes, output=folder / "model.onnx")  # doctest: +SKIP
    >>> made.trained.test.mean_precision  # doctest: +SKIP
    0.98
    """
    check_torch()
    observer, labelled = options.observer, _labelled(options)
    inputs = inputs_of((recording for recording, _ in labelled), options)
    prepare_outputs(options.outputs, inputs, force=options.force, observer=observer)
    if options.output.suffix.lower() != ".onnx":
        raise UsageError(f"{options.output}: the name of a model file must end in .onnx")
    examples, damage = _read(labelled, options, observer)
    done: list[Epoch] = []

    def on_epoch(epoch: Epoch) -> None:
        done.append(epoch)
        loss = f"loss {epoch.train_loss:.4f}, on validation {epoch.validation_loss:.4f}"
        precision = f"precision {epoch.train_precision:.4f}, on validation {epoch.validation_precision:.4f}"
        observer.note(f"epoch {len(done)} of {options.training.epochs}: {loss}; {precision}")

    trained = train(examples, options.training, on_epoch)
    files = {options.output: to_onnx(trained.network, examples.classes, examples.extent_m)}
    if options.plot_file:
        curves = np.array([astuple(epoch) for epoch in trained.epochs]).T
        content = {"loss": curves[:2], "precision": curves[2:], "best": trained.best}
        files[options.plot_file] = render(draw_training, options.plot_file.suffix, aspect=1.1, **content)
    write_files(files, replace=options.force)
    return SceneTraining(trained, examples, options.output, damage)


def _read(
    logs: Sequence[tuple[Recording, str]], options: TrainScenesOptions, observer: Observer
) -> tuple[Examples, list[Damage]]:
    classes = list(dict.fromkeys(scene for _, scene in logs))
    if len(classes) < 2:
        raise UsageError(f"all logs are of class {classes[0]}; training needs at least two classes")
    examples, damage = Examples(classes, options.extent_m), list[Damage]()
    with observer.progress("reading", None) as step:
        for recording, scene in logs:
            examples.begin(recording.name, classes.index(scene))
            outcome = Outcome(recording=recording.name)
            every = read_frames(recording, options.reading, observer, step, outcome)
            for frame in islice(every, 0, None, options.every):
                examples.add(frame.coordinates)
            damage += outcome.damage
    return examples, damage


@dataclass(frozen=True)
class SceneTraining(Result):
    """A trained scene classifier and its file, with the course of its training, its frames, and their damage."""

    is_summary = True

    trained: Trained
    examples: Examples
    output: Path
    damage: Sequence[Damage]

    @property
    def damaged(self) -> bool:
        """Whether parts of the input were damaged and left out."""
        return bool(self.damage)

    def as_dict(self) -> dict[str, Any]:
        """Return the training as JSON-compatible data."""
        trained, examples = self.trained, self.examples
        return {
            "output": str(self.output),
            "classes": list(examples.classes),
            "recordings": len(examples.recordings),
            "frames": dict(zip(trained.split._fields, map(len, trained.split), strict=True)),
            "best_epoch": trained.best + 1,
            "epochs": [asdict(epoch) for epoch in trained.epochs],
            "test": trained.test.as_dict(),
        }

    def as_text(self) -> str:
        """Return the training as human-readable text."""
        trained, examples = self.trained, self.examples
        best, confusion = trained.epochs[trained.best], trained.test.as_text()
        sizes = dict(zip(trained.split._fields, map(len, trained.split), strict=True))
        parts = ", ".join(f"{size} {name}" for name, size in sizes.items())
        frames = f"{count(len(examples), 'frame')} of {count(len(examples.recordings), 'recording')} ({parts})"
        precision = f"{best.train_precision:.3f} in training, {best.validation_precision:.3f} on validation"
        epoch = f"best epoch {trained.best + 1} of {len(trained.epochs)}: precision {precision}; test:"
        title = printable(f"{self.output}: {' or '.join(examples.classes)}, from {frames}")
        return f"{title}\n{epoch}\n{confusion}"
