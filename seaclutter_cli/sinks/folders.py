"""Folders of earlier runs: what may be replaced."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from seaclutter_cli.buckets import copies_removed, fetch, look
from seaclutter_cli.documents import DocumentError, load_yaml, read_document
from seaclutter_cli.errors import InputError
from seaclutter_cli.messages.metadata import RUN, SIDECAR, from_custom_data, from_text
from seaclutter_cli.records import Metadata
from seaclutter_cli.sinks.options import ROSBAG2_METADATA, TIMES

_FRAME = re.compile(r"\d{6,}\.(pcd|las|laz|npz)")

_Content = tuple[Sequence[Metadata], Callable[[str], object]]


def why_kept(folder: Path, marker: str) -> str:
    """Return why a folder may not be replaced; nothing if it is the output of a run, and has no other files.

    ``marker`` is the file with the records of the run.
    """
    try:
        look(folder)
        with copies_removed():
            fetch(folder / marker, *([folder / TIMES] if marker == SIDECAR else []))
            metadata, is_own = _CONTENTS[marker](folder, read_document(folder / marker))
        names = sorted(file.name for file in folder.iterdir() if file.name != marker)
    except (InputError, DocumentError, OSError, LookupError, TypeError, ValueError):
        metadata, is_own, names = [], bool, []
    if not any(record.name == RUN for record in metadata):
        return f"is a folder of something else ({marker} has no record of a run)"
    foreign = next((name for name in names if not is_own(name)), "")
    return foreign and f"is a folder with a file that is not of the run that wrote it, {foreign}"


def _recording(_: Path, text: bytes) -> _Content:
    """Return the records of a ROS 2 recording, and which files it has."""
    found: Any = load_yaml(text.decode())["rosbag2_bagfile_information"]
    return from_custom_data(found["custom_data"]), set(found["relative_file_paths"]).__contains__


def _frames(folder: Path, text: bytes) -> _Content:
    """Return the records of a folder of frames, and which files it has: as many frames as there are times."""
    frames = sum(1 for file in folder.iterdir() if _FRAME.fullmatch(file.name))
    fits = frames == (folder / TIMES).read_bytes().count(b"\n")
    return from_text(text), lambda name: name == TIMES or (fits and _FRAME.fullmatch(name))


_CONTENTS: dict[str, Callable[[Path, bytes], _Content]] = {ROSBAG2_METADATA: _recording, SIDECAR: _frames}
