"""Recordings with known scenes."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from seaclutter_cli.errors import UsageError
from seaclutter_cli.sources.frame_files.folder import is_frame_folder
from seaclutter_cli.sources.recordings import Recording, find_recordings
from seaclutter_cli.sources.rosbag2 import is_rosbag2_folder


def find_labelled(folders: Sequence[Path], scenes: Sequence[str]) -> "list[LabelledLog]":
    """Return the recordings in folders of classes and in entries ``CLASS=LOGS``, with their true classes.

    Raise `UsageError` if there are no recordings, or one has two classes.
    """
    named = [_parse(text) for text in scenes]
    named += [(folder.name, str(folder)) for parent in folders for folder in _class_folders(parent)]
    if not named:
        raise UsageError("no logs: give a folder that contains a folder for each class, or --scene CLASS=LOGS")
    found: dict[Path, LabelledLog] = {}
    for scene, pattern in named:
        for recording in find_recordings([pattern]):
            first = found.setdefault(recording.key, LabelledLog(recording, scene))
            if first.scene != scene:
                raise UsageError(f"{recording.paths[0]}: labelled as both {first.scene} and {scene}")
    return list(found.values())


@dataclass(frozen=True)
class LabelledLog:
    """A recording and the true class of its scene."""

    recording: Recording
    scene: str


def _parse(text: str) -> tuple[str, str]:
    scene, equals, pattern = text.partition("=")
    if not (equals and scene and pattern):
        raise UsageError(f"--scene {text}: write it as CLASS=LOGS, as in open=trials/offshore")
    return scene, pattern


def _class_folders(parent: Path) -> Sequence[Path]:
    if not parent.is_dir():
        raise UsageError(f"{parent}: no such folder")
    folders = [child for child in sorted(parent.iterdir()) if child.is_dir() and not child.name.startswith(".")]
    recording = next(
        (child for child in (parent, *folders) if is_rosbag2_folder(child) or is_frame_folder(child)), None
    )
    if recording or not folders:
        found = f"{recording} is a recording" if recording else "it contains no folders"
        raise UsageError(f"{parent}: must contain a folder of recordings for each class, but {found}")
    return folders
