"""Where the labels of recordings are: the options that name them, and which belong to which recording."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from seaclutter_cli.errors import UsageError

if TYPE_CHECKING:
    from seaclutter_cli.interfaces import Labels
    from seaclutter_cli.sources import Recording

F = TypeVar("F", bound=Callable[..., Any])

LABEL_SUFFIX = ".labels.csv"


def label_options(*, required: bool) -> Callable[[F], F]:
    """Return a decorator that adds the options of labels; ``--labels`` is required or not."""
    options = (
        click.option(
            "--labels",
            "label_paths",
            multiple=True,
            required=required,
            type=click.Path(path_type=Path),
            metavar="LABELS",
            help=f"Labels of LOGS in their order, or a folder with RECORDING{LABEL_SUFFIX} for each; repeatable.",
        ),
        click.option(
            "--clutter-ids",
            callback=_ids,
            metavar="IDS",
            help="Classes that are clutter where every point has a class, as in 110,111.  [default: 110]",
        ),
        click.option(
            "--ignore-ids",
            callback=_ids,
            metavar="IDS",
            help="Classes that are neither clutter nor targets.  [default: 0,99]",
        ),
    )

    def add(command: F) -> F:
        for option in reversed(options):
            command = option(command)
        return command

    return add


def _ids(_: click.Context, parameter: click.Parameter, text: str | None) -> tuple[int, ...] | None:
    try:
        return None if text is None else tuple(int(number) for number in text.split(",") if number.strip())
    except ValueError as error:
        raise click.BadParameter("write whole numbers with commas between, as in 0,99", param=parameter) from error


def labels_for(recordings: Sequence["Recording"], paths: Sequence[Path], options: Mapping[str, Any]) -> list["Labels"]:
    """Open the labels of recordings.

    Parameters
    ----------
    recordings : sequence of Recording
        What is labelled.
    paths : sequence of Path
        As many as recordings, in their order; or one folder that holds a file for each.
    options : mapping
        Command-line options, ``clutter_ids`` and ``ignore_ids`` among them.

    Raises
    ------
    UsageError
        If it cannot be told which labels belong to which recording.
    LabelError
        If labels cannot be read.
    """
    from seaclutter_cli.labels import LabelOptions, open_labels

    given = {name: options[name] for name in ("clutter_ids", "ignore_ids") if options[name] is not None}
    found = zip(recordings, find_labels(recordings, paths), strict=True)
    return [open_labels(path, LabelOptions(**given, by_sequence=_are_frames(recording))) for recording, path in found]


def _are_frames(recording: "Recording") -> bool:
    """Tell whether a recording is a folder of frames; there, a damaged file keeps its number."""
    from seaclutter_cli.sources.frame_files.folder import is_frame_folder
    from seaclutter_cli.sources.rosbag2.folder import is_rosbag2_folder

    path = recording.paths[0]
    return len(recording.paths) == 1 and path.is_dir() and not is_rosbag2_folder(path) and is_frame_folder(path)


def find_labels(recordings: Sequence["Recording"], paths: Sequence[Path]) -> list[Path]:
    """Return the path of each recording's labels; `UsageError` if it cannot be told, or one is not there."""
    if len(paths) == 1 and paths[0].is_dir() and (found := _in_folder(recordings, paths[0])):
        return found
    if len(paths) != len(recordings):
        raise UsageError(
            f"{len(paths)} --labels for {len(recordings)} recordings: give one for each, in their order, "
            f"or a folder that holds RECORDING{LABEL_SUFFIX} for each"
        )
    for path in paths:
        if not path.exists():
            raise UsageError(f"{path}: there are no such labels")
    return list(paths)


def _in_folder(recordings: Sequence["Recording"], folder: Path) -> list[Path]:
    """Return the labels in a folder; none if it is itself the labels of a single recording."""
    named = [folder / f"{recording.name}{LABEL_SUFFIX}" for recording in recordings]
    missing = [path for path in named if not path.is_file()]
    if missing and len(recordings) == 1:
        return []
    if missing:
        raise UsageError(f"{folder}: has no labels for all recordings; missing: {', '.join(p.name for p in missing)}")
    if len(set(named)) < len(named):
        raise UsageError(f"{folder}: two recordings have the same name, and so the same labels: give --labels for each")
    return named
