"""Scenes of recordings, predicted by a trained classifier."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from seaclutter_cli.frame import Frame
from seaclutter_cli.runs.observer import SILENT, Observer, Step
from seaclutter_cli.runs.outputs import Paths, inputs_of, may_appear, prepare_outputs
from seaclutter_cli.runs.recordings import Logs, Outcome, ReadOptions, RecordingsResult, expand, storing_errors
from seaclutter_cli.runs.scene.logs import ClassifierOptions, read_frames
from seaclutter_cli.runs.scene.table import SceneTable
from seaclutter_cli.scenes.model import SceneModel
from seaclutter_cli.scenes.tracker import SceneDecision, SceneTracker
from seaclutter_cli.sinks.atomic import OutputGroup
from seaclutter_cli.sources import Recording
from seaclutter_cli.storage.scratch import copies_removed
from seaclutter_cli.text import share, table


@copies_removed()
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
    inputs: Paths = {**inputs_of(recordings, reading), "--model": Path(options.model)}
    prepare_outputs({"--csv": options.csv_file}, inputs, force=options.force, observer=observer)
    model = SceneModel(options.model)
    with OutputGroup(replace=options.force) as files:
        with (
            SceneTable(options.csv_file, model.classes, truth=False, group=files) as lines,
            observer.progress("frames", None) as step,
        ):
            predictor = _Predictor(model, options, reading, observer, lines)
            result = ScenePrediction([predictor.run(recording, step) for recording in recordings], model.classes)
        if not may_appear([options.csv_file], result.outcomes, observer):
            files.discard()
    return result


@dataclass(frozen=True)
class _Predictor:
    """Prediction for recordings, one by one, with the same options."""

    model: SceneModel
    options: ClassifierOptions
    reading: ReadOptions
    observer: Observer
    lines: SceneTable

    def run(self, recording: Recording, step: Step) -> "RecordingScenes":
        """Return the scenes of the frames of a recording; an error is kept in the outcome."""
        found = RecordingScenes(recording=recording.name)
        with storing_errors(found, self.observer):
            for frame in read_frames(recording, self.reading, self.observer, step, found.damage):
                topic = found.topics.get(frame.topic)
                if topic is None:
                    tracker = SceneTracker(self.model, every=self.options.every, hold=self.options.hold)
                    topic = found.topics[frame.topic] = TopicScenes(tracker)
                self.lines.write(recording.name, frame, topic.add(frame))
        return found


@dataclass
class TopicScenes:
    """Predicted scenes of one topic.

    Parameters
    ----------
    tracker : SceneTracker
        Scene tracker of the topic.
    frames : counter of str
        Number of frames by scene.
    changes : int
        Number of scene changes.
    """

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
class RecordingScenes(Outcome):
    """Predicted scenes of one recording.

    Parameters
    ----------
    topics : dict of str to TopicScenes
        Scenes by topic.
    """

    topics: dict[str, TopicScenes] = field(default_factory=dict)

    def as_dict(self, classes: Sequence[str]) -> dict[str, Any]:
        """Return the scenes as JSON-compatible data."""
        topics = {
            name: {"scene": one.scene, "changes": one.changes, "frames": {name: one.frames[name] for name in classes}}
            for name, one in self.topics.items()
        }
        damage = [str(item) for item in self.damage]
        return {"recording": self.recording, "topics": topics, "damage": damage, "error": self.error}

    def rows(self, classes: Sequence[str]) -> list[tuple[object, ...]]:
        """Return the rows of the table."""
        rows = []
        for name, one in self.topics.items():
            frames = one.frames.total()
            shares = (share(one.frames[scene], frames) for scene in classes)
            rows.append((self.recording, name, frames, one.scene, one.changes, *shares))
        return rows


@dataclass(frozen=True)
class ScenePrediction(RecordingsResult):
    """Predicted scenes of several recordings.

    Parameters
    ----------
    outcomes : sequence of RecordingScenes
        Scenes of each recording.
    classes : sequence of str
        Classes of the model.
    """

    outcomes: Sequence[RecordingScenes]
    classes: Sequence[str]

    def as_dict(self) -> list[dict[str, Any]]:
        """Return the scenes as JSON-compatible data."""
        return [one.as_dict(self.classes) for one in self.outcomes]

    def as_text(self) -> str:
        """Return the scenes as human-readable text."""
        rows = [row for one in self.outcomes for row in one.rows(self.classes)]
        head = ("recording", "topic", "frames", "scene", "changes", *self.classes)
        return table(head, rows) if rows else ""
