"""Training of a scene classifier on recordings with known scenes."""

from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from seaclutter_cli.errors import UsageError
from seaclutter_cli.plots.curves import draw_training
from seaclutter_cli.plots.figure import check_target, render
from seaclutter_cli.records import Damage
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.options import of_options
from seaclutter_cli.runs.options.classifiers import LabelledLogs, TrainSceneOptions
from seaclutter_cli.runs.outputs import inputs_of, prepare_outputs, write_files
from seaclutter_cli.runs.recordings import Outcome, Result
from seaclutter_cli.runs.scene.classify import read_frames
from seaclutter_cli.runs.scene.logs import LabelledLog
from seaclutter_cli.scenes import TrainingParams
from seaclutter_cli.scenes.network import to_onnx
from seaclutter_cli.scenes.training import Epoch, Examples, Trained, check_torch, train
from seaclutter_cli.text import count, printable


@of_options
def train_scenes(logs: LabelledLogs, options: TrainSceneOptions, observer: Observer = SILENT) -> "SceneTraining":
    """Train a scene classifier on recordings with known scenes, and write it as an ONNX file.

    Examples
    --------
    >>> import seaclutter
    >>> logs = seaclutter.LabelledLogs(scenes=("open=trials/offshore", "confined=trials/harbour"))
    >>> options = seaclutter.TrainSceneOptions(output=folder / "model.onnx", every=10)
    >>> seaclutter.train_scenes(logs, options).trained.test.mean_precision  # doctest: +SKIP
    0.98
    """
    check_torch()
    labelled = logs.find()
    prepare_outputs(
        {"-o": options.output, "--plot": options.plot_file},
        inputs_of((log.recording for log in labelled), options.reading),
        force=options.force,
        observer=observer,
    )
    if options.output.suffix.lower() != ".onnx":
        raise UsageError(f"{options.output}: the name of a model file must end in .onnx")
    if options.plot_file:
        check_target(options.plot_file)
    examples, damage = _read(labelled, options, observer)
    trained = _train(examples, options.training, observer)
    files = {options.output: to_onnx(trained.network, examples.classes, examples.extent_m)}
    if options.plot_file:
        curves = np.array([astuple(epoch) for epoch in trained.epochs]).T
        draw = partial(draw_training, loss=curves[:2], precision=curves[2:], best=trained.best)
        files[options.plot_file] = render(draw, options.plot_file.suffix, aspect=1.1)
    write_files(files, replace=options.force)
    return SceneTraining(trained, examples, options.output, damage)


def _read(logs: Sequence[LabelledLog], options: TrainSceneOptions, observer: Observer) -> tuple[Examples, list[Damage]]:
    classes = list(dict.fromkeys(log.scene for log in logs))
    if len(classes) < 2:
        raise UsageError(f"all logs are of class {classes[0]}; training needs at least two classes")
    examples, damage = Examples(classes, options.extent_m), list[Damage]()
    with observer.progress("reading", None) as step:
        for log in logs:
            examples.begin(log.recording.name, classes.index(log.scene))
            outcome = Outcome(recording=log.recording.name)
            for frame in islice(
                read_frames(log.recording, options.reading, observer, step, outcome), 0, None, options.every
            ):
                examples.add(frame.coordinates)
            damage += outcome.damage
    return examples, damage


def _train(examples: Examples, params: TrainingParams, observer: Observer) -> Trained:
    done: list[Epoch] = []

    def on_epoch(epoch: Epoch) -> None:
        done.append(epoch)
        loss = f"loss {epoch.train_loss:.4f}, on validation {epoch.validation_loss:.4f}"
        precision = f"precision {epoch.train_precision:.4f}, on validation {epoch.validation_precision:.4f}"
        observer.note(f"epoch {len(done)} of {params.epochs}: {loss}; {precision}")

    return train(examples, params, on_epoch)


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
        parts = ", ".join(
            f"{len(part)} {name}" for name, part in zip(trained.split._fields, trained.split, strict=True)
        )
        frames = f"{count(len(examples), 'frame')} of {count(len(examples.recordings), 'recording')} ({parts})"
        precision = f"{best.train_precision:.3f} in training, {best.validation_precision:.3f} on validation"
        epoch = f"best epoch {trained.best + 1} of {len(trained.epochs)}: precision {precision}; test:"
        title = printable(f"{self.output}: {' or '.join(examples.classes)}, from {frames}")
        return f"{title}\n{epoch}\n{confusion}"
