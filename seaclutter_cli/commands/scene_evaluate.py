"""``seaclutter scene evaluate``: how well a classifier tells the scenes of logs where they are known."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from seaclutter_cli.commands.console import Progress, count, table, told_errors
from seaclutter_cli.commands.options import output_options, selection_options
from seaclutter_cli.commands.scene_logs import find_labelled, judge_options, labelled_logs, read_frames
from seaclutter_cli.commands.scene_table import SceneTable, confusion_table
from seaclutter_cli.errors import UsageError

if TYPE_CHECKING:
    from seaclutter_cli.commands.scene_logs import LabelledLog
    from seaclutter_cli.records import Damage
    from seaclutter_cli.scenes.model import SceneModel
    from seaclutter_cli.scenes.scores import SceneScores


@click.command(short_help="Test a classifier on logs whose scenes are known.")
@labelled_logs
@judge_options
@selection_options
@output_options
def evaluate(folders: tuple[Path, ...], scenes: tuple[str, ...], **options: Any) -> None:
    """Test a classifier on logs whose scenes are known: confusion matrix, precision and recall of each class.

    FOLDERS hold a folder of logs for each class, named like it (open/, confined/); --scene names classes and logs one
    by one. With --every and --hold, what counts is the scene that a filter would go by.
    """
    from seaclutter_cli.commands.outputs import refuse_overwriting
    from seaclutter_cli.scenes.model import SceneModel

    logs = find_labelled(folders, scenes)
    targets = [options["csv_file"]] if options["csv_file"] else []
    refuse_overwriting(targets, [log.recording for log in logs], force=options["force"])
    model = SceneModel(options["model"])
    unknown = sorted({log.scene for log in logs} - set(model.classes))
    if unknown:
        raise UsageError(f"{model.name} tells {' and '.join(model.classes)}, not {', '.join(unknown)}")
    found = _Found(model.classes)
    quiet = options["quiet"]
    with (
        SceneTable(options["csv_file"], model.classes, truth=True) as lines,
        Progress(None, "frames", quiet=quiet) as bar,
    ):
        for log in logs:
            found.take(log, model, options, lines, bar)
    click.echo(json.dumps(found.as_dict(), indent=2) if options["as_json"] else found.as_text(options["verbose"]))
    if found.errors:
        raise click.exceptions.Exit(1)
    if found.damage:
        raise click.exceptions.Exit(3)


@dataclass
class _Log:
    """What a classifier made of one log: its name and true class, frames by told class."""

    name: str
    scene: str
    told: Counter[str] = field(default_factory=Counter)
    error: str | None = None
    seconds: float = 0.0

    @property
    def wrong(self) -> int:
        """Frames told to be of another class."""
        return self.told.total() - self.told[self.scene]


@dataclass
class _Found:
    """What a classifier made of all logs."""

    classes: Sequence[str]
    logs: list[_Log] = field(default_factory=list)
    """Those that could be read."""
    errors: dict[str, str] = field(default_factory=dict)
    damage: "list[Damage]" = field(default_factory=list)

    def take(
        self, log: "LabelledLog", model: "SceneModel", options: Mapping[str, Any], lines: SceneTable, bar: Progress
    ) -> None:
        """Judge the frames of a log; an error of its own is told, and the others go on."""
        from seaclutter_cli.scenes.judge import SceneJudge

        judge = SceneJudge(model, every=options["every"], hold=options["hold"])
        found = _Log(log.recording.name, log.scene)
        with told_errors(found):
            for frame in read_frames(log.recording, options, bar, self.damage):
                decision = judge.scene(frame)
                found.told[decision.name] += 1
                lines.write(found.name, frame, decision, log.scene)
        if found.error is None:
            self.logs.append(found)
        else:
            self.errors[found.name] = found.error

    @property
    def confusion(self) -> "SceneScores":
        """Frames by what they show and what they were taken for."""
        import numpy as np

        from seaclutter_cli.scenes.scores import SceneScores

        counts = np.zeros((len(self.classes), len(self.classes)), np.int64)
        for log in self.logs:
            counts[self.classes.index(log.scene)] += [log.told[name] for name in self.classes]
        return SceneScores(counts, self.classes)

    @property
    def wrong(self) -> list[tuple[str, str, int, int]]:
        """Name, true class, wrong frames and all frames of the logs that are not right throughout."""
        return [(log.name, log.scene, log.wrong, log.told.total()) for log in self.logs if log.wrong]

    def as_dict(self) -> dict[str, Any]:
        """Return all of it as JSON holds it."""
        confusion = self.confusion
        return {
            "frames": int(confusion.counts.sum()),
            "recordings": len(self.logs),
            "classes": confusion.as_dict(),
            "wrong": [dict(zip(("recording", "is", "wrong", "frames"), row, strict=True)) for row in self.wrong],
            "errors": self.errors,
            "damage": [str(item) for item in self.damage],
        }

    def as_text(self, verbose: bool) -> str:
        """Return all of it as people read it; if verbose, with the logs that are not right throughout."""
        confusion, wrong = self.confusion, self.wrong
        right = len(self.logs) - len(wrong)
        frames = count(int(confusion.counts.sum()))
        lines = [
            f"{frames} of {len(self.logs)} recordings, {right} of them right throughout",
            confusion_table(confusion),
        ]
        if verbose and wrong:
            lines.append(table(("recording", "is", "wrong", "frames"), wrong))
        return "\n".join(lines)
