"""Logs whose scene is known: how the command line names them, and how their frames are read."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from seaclutter_cli.commands.console import Progress, report_damage, warn
from seaclutter_cli.commands.options import decoding_options, force_option
from seaclutter_cli.errors import InputError, UsageError

if TYPE_CHECKING:
    from seaclutter_cli.frame import Frame
    from seaclutter_cli.records import Damage
    from seaclutter_cli.sources import Recording

F = TypeVar("F", bound=Callable[..., Any])


def labelled_logs(command: F) -> F:
    """Add the argument and the option that name logs by their scene."""
    for option in reversed(_LABELLED):
        command = option(command)
    return command


_LABELLED = (
    click.argument("folders", metavar="[FOLDERS]...", nargs=-1, type=click.Path(path_type=Path)),
    click.option(
        "--scene",
        "scenes",
        multiple=True,
        metavar="CLASS=LOGS",
        help="A class and the file, folder or glob of logs that show it; repeatable.",
    ),
)


def judge_options(command: F) -> F:
    """Add the options of a trained classifier at work."""
    for option in reversed(_JUDGE):
        command = option(command)
    return command


_JUDGE = (
    click.option(
        "--model",
        metavar="FILE",
        default="open_confined",
        show_default=True,
        help="ONNX file of a classifier, or the name of a built-in one.",
    ),
    click.option(
        "--every",
        type=click.IntRange(min=1),
        default=1,
        metavar="N",
        show_default=True,
        help="Look at one frame in N; the others keep its scene.",
    ),
    click.option(
        "--hold",
        type=click.IntRange(min=1),
        default=1,
        metavar="M",
        show_default=True,
        help="Change the scene only after M looks in a row agree on another one.",
    ),
    click.option(
        "--csv", "csv_file", type=click.Path(path_type=Path), metavar="FILE", help="Write a line for each frame."
    ),
    force_option,
)


@dataclass(frozen=True)
class LabelledLog:
    """A recording and the class of its scene."""

    recording: "Recording"
    scene: str


def find_labelled(folders: Sequence[Path], scenes: Sequence[str]) -> list[LabelledLog]:
    """Return the recordings that the command line names, with their classes.

    Parameters
    ----------
    folders : sequence of Path
        Each holds a folder of recordings for each class, of its name.
    scenes : sequence of str
        ``CLASS=LOGS``.

    Raises
    ------
    UsageError
        If there are no recordings, or one is of two classes.
    """
    named = [_parse(text) for text in scenes]
    named += [(folder.name, str(folder)) for parent in folders for folder in _class_folders(parent)]
    if not named:
        raise UsageError("no logs: name a folder that holds a folder for each class, or --scene CLASS=LOGS")
    from seaclutter_cli.sources import find_recordings

    found: dict[Path, LabelledLog] = {}
    for scene, pattern in named:
        for recording in find_recordings([pattern]):
            first = found.setdefault(recording.paths[0].resolve(), LabelledLog(recording, scene))
            if first.scene != scene:
                raise UsageError(f"{recording.paths[0]}: is said to be {first.scene} and {scene}")
    return list(found.values())


def _parse(text: str) -> tuple[str, str]:
    scene, equals, pattern = text.partition("=")
    if not (equals and scene and pattern):
        raise UsageError(f"--scene {text}: write it as CLASS=LOGS, as in open=trials/offshore")
    return scene, pattern


def _class_folders(parent: Path) -> list[Path]:
    from seaclutter_cli.sources.frame_files.folder import is_frame_folder
    from seaclutter_cli.sources.rosbag2.folder import is_rosbag2_folder

    if not parent.is_dir():
        raise UsageError(f"{parent}: there is no such folder")
    folders = [child for child in sorted(parent.iterdir()) if child.is_dir() and not child.name.startswith(".")]
    recording = next(
        (child for child in (parent, *folders) if is_rosbag2_folder(child) or is_frame_folder(child)), None
    )
    if recording or not folders:
        found = f"{recording} is a recording" if recording else "it holds no folders"
        raise UsageError(f"{parent}: has to hold a folder of recordings for each class, but {found}")
    return folders


def read_frames(
    recording: "Recording", options: Mapping[str, Any], progress: Progress, damage: "list[Damage]"
) -> Iterator["Frame"]:
    """Yield the selected frames of a recording; tell what is damaged and add it to a list.

    Raises
    ------
    InputError
        If there is no frame that can be read.
    """
    from seaclutter_cli.pipeline import Selection, frames

    selection = Selection(**{name: options[name] for name in ("topics", "start_s", "end_s", "frames")})
    with closing(recording.open(rate_hz=options["rate_hz"], decoding=decoding_options(options))) as source:
        found = 0
        for frame in frames(source, selection):
            found += 1
            progress.step()
            yield frame
        for text in source.warnings:
            warn(text, quiet=options["quiet"])
        damage += source.damage
        report_damage(source.damage, verbose=options["verbose"])
        if not found:
            raise InputError(f"{source.name}: no frame can be read" + (f"; {source.damage[0]}" if damage else ""))
