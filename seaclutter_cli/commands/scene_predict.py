"""``seaclutter scene predict``: which scenes logs show."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import click

from seaclutter_cli.commands.console import Progress, share, table, told_errors
from seaclutter_cli.commands.options import logs_argument, output_options, selection_options
from seaclutter_cli.commands.scene_logs import judge_options, read_frames
from seaclutter_cli.commands.scene_table import SceneTable

if TYPE_CHECKING:
    from seaclutter_cli.frame import Frame
    from seaclutter_cli.records import Damage
    from seaclutter_cli.scenes.judge import SceneDecision, SceneJudge
    from seaclutter_cli.scenes.model import SceneModel
    from seaclutter_cli.sources import Recording


@click.command(short_help="Tell which scenes logs show.")
@logs_argument
@judge_options
@selection_options
@output_options
def predict(logs: tuple[str, ...], **options: Any) -> None:
    """Tell which scenes LOGS show: a line for each log and topic, with the shares of its frames.

    --csv writes the scene of each frame and the probabilities that the classifier gave.
    """
    from seaclutter_cli.commands.outputs import refuse_overwriting
    from seaclutter_cli.scenes.model import SceneModel
    from seaclutter_cli.sources import find_recordings

    recordings = find_recordings(logs)
    targets = [options["csv_file"]] if options["csv_file"] else []
    refuse_overwriting(targets, recordings, force=options["force"])
    model = SceneModel(options["model"])
    quiet = options["quiet"]
    with (
        SceneTable(options["csv_file"], model.classes, truth=False) as lines,
        Progress(None, "frames", quiet=quiet) as bar,
    ):
        told = [_look(recording, model, options, lines, bar) for recording in recordings]
    if options["as_json"]:
        click.echo(json.dumps([one.as_dict(model.classes) for one in told], indent=2))
    elif rows := [row for one in told for row in one.rows(model.classes)]:
        click.echo(table(("recording", "topic", "frames", "scene", "changes", *model.classes), rows))
    if any(one.error for one in told):
        raise click.exceptions.Exit(1)
    if any(one.damage for one in told):
        raise click.exceptions.Exit(3)


@dataclass
class _Topic:
    """The scenes of one topic."""

    judge: "SceneJudge"
    frames: Counter[str] = field(default_factory=Counter)
    changes: int = 0
    last: str = ""

    def add(self, frame: "Frame") -> "SceneDecision":
        """Judge a frame."""
        decision = self.judge.scene(frame)
        self.frames[decision.name] += 1
        self.changes += self.last not in ("", decision.name)
        self.last = decision.name
        return decision

    @property
    def scene(self) -> str:
        """Scene of most frames."""
        return self.frames.most_common(1)[0][0]


@dataclass
class _Told:
    """The scenes of one recording, by topic."""

    recording: str
    topics: dict[str, _Topic] = field(default_factory=dict)
    damage: "list[Damage]" = field(default_factory=list)
    error: str | None = None
    seconds: float = 0.0

    def as_dict(self, classes: Sequence[str]) -> dict[str, Any]:
        """Return it as JSON holds it."""
        topics = {
            name: {"scene": one.scene, "changes": one.changes, "frames": {name: one.frames[name] for name in classes}}
            for name, one in self.topics.items()
        }
        damage = [str(item) for item in self.damage]
        return {"recording": self.recording, "topics": topics, "damage": damage, "error": self.error}

    def rows(self, classes: Sequence[str]) -> list[tuple[object, ...]]:
        """Return the lines of the table."""
        rows = []
        for name, one in self.topics.items():
            frames = one.frames.total()
            shares = (share(one.frames[scene], frames) for scene in classes)
            rows.append((self.recording, name, frames, one.scene, one.changes, *shares))
        return rows


def _look(
    recording: "Recording", model: "SceneModel", options: Mapping[str, Any], lines: SceneTable, bar: Progress
) -> _Told:
    """Judge the frames of a recording; an error of its own is told, and the others go on."""
    from seaclutter_cli.scenes.judge import SceneJudge

    told = _Told(recording.name)
    with told_errors(told):
        for frame in read_frames(recording, options, bar, told.damage):
            if frame.topic not in told.topics:
                told.topics[frame.topic] = _Topic(SceneJudge(model, every=options["every"], hold=options["hold"]))
            lines.write(recording.name, frame, told.topics[frame.topic].add(frame))
    return told
