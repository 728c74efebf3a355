"""``seaclutter scene train``: a classifier from logs whose scenes are known."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from seaclutter_cli.commands.console import Progress, count
from seaclutter_cli.commands.options import force_option, output_options, selection_options
from seaclutter_cli.commands.scene_logs import find_labelled, labelled_logs, read_frames
from seaclutter_cli.errors import UsageError

if TYPE_CHECKING:
    from seaclutter_cli.commands.scene_logs import LabelledLog
    from seaclutter_cli.records import Damage
    from seaclutter_cli.scenes.examples import Examples
    from seaclutter_cli.scenes.training import Epoch, Trained


@click.command(short_help="Train a classifier on logs whose scenes are known.")
@labelled_logs
@click.option(
    "-o", "--output", required=True, type=click.Path(path_type=Path), metavar="MODEL.onnx", help="Where it goes."
)
@force_option
@click.option(
    "--plot",
    "plot_file",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Draw loss and precision over the epochs, as PNG or SVG.",
)
@click.option(
    "--extent",
    "extent_m",
    type=click.FloatRange(min=0, min_open=True),
    default=60.0,
    metavar="METRES",
    show_default=True,
    help="Half the side of the square that is seen from above.",
)
@click.option(
    "--every",
    type=click.IntRange(min=1),
    default=1,
    metavar="N",
    show_default=True,
    help="Take one frame in N; those next to each other show the same.",
)
@click.option(
    "--epochs",
    type=click.IntRange(min=1),
    default=30,
    metavar="N",
    show_default=True,
    help="Rounds through all frames.",
)
@click.option(
    "--batch", type=click.IntRange(min=2), default=32, metavar="N", show_default=True, help="Frames in a step."
)
@click.option(
    "--learning-rate",
    type=click.FloatRange(min=0, min_open=True),
    default=0.005,
    metavar="RATE",
    show_default=True,
    help="Of Adam in the beginning; it falls to 0 along half a cosine.",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=1,
    metavar="N",
    show_default=True,
    help="Of split, first weights, order and turns.",
)
@selection_options
@output_options
def train(folders: tuple[Path, ...], scenes: tuple[str, ...], output: Path, **options: Any) -> None:
    """Train a classifier on logs whose scenes are known, and write it as an ONNX file.

    FOLDERS hold a folder of logs for each class, named like it (open/, confined/); --scene names classes and logs one
    by one. The first class is what a frame with nothing in view is taken for. Logs, never frames, are split into three
    parts: 60 % to train on, 20 % to choose the best epoch by, 20 % to test on; the confusion matrix is of the latter.
    """
    from seaclutter_cli.commands.outputs import refuse_overwriting
    from seaclutter_cli.scenes.export import to_onnx
    from seaclutter_cli.scenes.training import check_torch
    from seaclutter_cli.sinks.atomic import AtomicFile

    check_torch()
    logs = find_labelled(folders, scenes)
    plot_file: Path | None = options["plot_file"]
    refuse_overwriting(
        [output, *([plot_file] if plot_file else [])], [log.recording for log in logs], force=options["force"]
    )
    _check(output, plot_file)
    damage: list[Damage] = []
    examples = _read(logs, options, damage)
    trained = _train(examples, options)
    files = {output: to_onnx(trained.network, examples.classes, examples.extent_m)}
    if plot_file:
        files[plot_file] = _picture(trained, plot_file.suffix)
    for path, data in files.items():
        with AtomicFile(path) as file:
            file.stream.write(data)
    click.echo(_as_json(trained, examples, output) if options["as_json"] else _as_text(trained, examples, output))
    if damage:
        raise click.exceptions.Exit(3)


def _check(output: Path, plot_file: Path | None) -> None:
    from seaclutter_cli.plots.figure import check_target

    if output.suffix.lower() != ".onnx":
        raise UsageError(f"{output}: the name of a classifier ends in .onnx")
    if plot_file:
        check_target(plot_file)


def _read(logs: "Sequence[LabelledLog]", options: Mapping[str, Any], damage: "list[Damage]") -> "Examples":
    from seaclutter_cli.scenes.examples import Examples

    classes = list(dict.fromkeys(log.scene for log in logs))
    if len(classes) < 2:
        raise UsageError(f"all logs are of class {classes[0]}: there is nothing to tell apart")
    examples = Examples(classes, options["extent_m"])
    with Progress(None, "reading", quiet=options["quiet"]) as progress:
        for log in logs:
            examples.begin(log.recording.name, classes.index(log.scene))
            for number, frame in enumerate(read_frames(log.recording, options, progress, damage)):
                if number % options["every"] == 0:
                    examples.add(frame.xyz)
    return examples


def _train(examples: "Examples", options: Mapping[str, Any]) -> "Trained":
    from seaclutter_cli.scenes.training import TrainingParams, train

    params = TrainingParams(**{name: options[name] for name in ("epochs", "batch", "learning_rate", "seed")})
    done = 0

    def on_epoch(epoch: "Epoch") -> None:
        nonlocal done
        done += 1
        if not options["quiet"]:
            click.echo(
                f"epoch {done} of {params.epochs}: loss {epoch.train_loss:.4f}, on validation "
                f"{epoch.validation_loss:.4f}; precision {epoch.train_precision:.4f}, {epoch.validation_precision:.4f}",
                err=True,
            )

    return train(examples, params, on_epoch)


def _picture(trained: "Trained", suffix: str) -> bytes:
    from dataclasses import astuple

    import numpy as np

    from seaclutter_cli.plots.figure import render
    from seaclutter_cli.plots.training import draw_training

    curves = np.array([astuple(epoch) for epoch in trained.epochs]).T
    return render(lambda figure: draw_training(figure, curves[:2], curves[2:], trained.best), suffix, aspect=1.1)


def _as_json(trained: "Trained", examples: "Examples", output: Path) -> str:
    from dataclasses import asdict

    return json.dumps(
        {
            "output": str(output),
            "classes": list(examples.classes),
            "recordings": len(examples.recordings),
            "frames": dict(zip(trained.split._fields, map(len, trained.split), strict=True)),
            "best_epoch": trained.best + 1,
            "epochs": [asdict(epoch) for epoch in trained.epochs],
            "test": trained.test.as_dict(),
        },
        indent=2,
    )


def _as_text(trained: "Trained", examples: "Examples", output: Path) -> str:
    from seaclutter_cli.commands.scene_table import confusion_table

    best, confusion = trained.epochs[trained.best], confusion_table(trained.test)
    parts = ", ".join(f"{len(part)} {name}" for name, part in zip(trained.split._fields, trained.split, strict=True))
    frames = f"{count(len(examples))} of {len(examples.recordings)} recordings ({parts})"
    precision = f"{best.train_precision:.3f} in training, {best.validation_precision:.3f} on validation"
    epoch = f"best epoch {trained.best + 1} of {len(trained.epochs)}: precision {precision}; on test:"
    return f"{output}: {' or '.join(examples.classes)}, from {frames}\n{epoch}\n{confusion}"
