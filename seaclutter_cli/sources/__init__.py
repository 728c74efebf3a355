"""Logs in every supported format, each opened as a `Source`."""

import os
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from glob import glob
from pathlib import Path

from seaclutter_cli.errors import InputError, UsageError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.sensors.families import CALIBRATION_SUFFIXES
from seaclutter_cli.sensors.packets import DecoderOptions
from seaclutter_cli.sources.frame_files import FRAME_READERS
from seaclutter_cli.sources.frame_files.folder import FolderSource, is_frame_folder
from seaclutter_cli.sources.frame_files.stamps import times_beside
from seaclutter_cli.sources.pcap.magics import CAPTURE_MAGICS
from seaclutter_cli.sources.rosbag2.folder import SplitSource, is_rosbag2_folder, open_rosbag2, split_groups
from seaclutter_cli.sources.shared.packet_topics import wrap_packets
from seaclutter_cli.storage.locations import Location
from seaclutter_cli.storage.real_paths import RealPaths

_HEAD_BYTES = 16


@dataclass(frozen=True)
class Format:
    """A log format with single-file recordings.

    Parameters
    ----------
    title : str
        Name shown to the user.
    suffixes : tuple of str
        Usual file name suffixes.
    magics : tuple of bytes
        First bytes of a file; they take precedence over the suffix.
    open : callable
        Opens a file as a source, given the settings that packets do not contain.
    """

    title: str
    suffixes: tuple[str, ...]
    magics: tuple[bytes, ...]
    open: Callable[[Path, DecoderOptions], Source]


# Each source is imported on demand, which keeps the start of a run fast.


def _open_mcap(path: Path, _: DecoderOptions) -> Source:
    from seaclutter_cli.sources.mcap.source import McapSource

    return McapSource(path)


def _open_bag(path: Path, _: DecoderOptions) -> Source:
    from seaclutter_cli.sources.rosbag1.source import BagSource

    return BagSource(path)


def _open_db3(path: Path, _: DecoderOptions) -> Source:
    from seaclutter_cli.sources.rosbag2.db3 import Db3Source

    return Db3Source(path)


def _open_capture(path: Path, decoding: DecoderOptions) -> Source:
    from seaclutter_cli.sources.pcap.source import CaptureSource

    return CaptureSource(path, decoding)


SOURCES: Mapping[str, Format] = {
    "mcap": Format("MCAP", (".mcap",), (b"\x89MCAP0\r\n",), _open_mcap),
    "bag": Format("ROS 1 bag", (".bag", ".bag.active"), (b"#ROSBAG V2.0\n",), _open_bag),
    "db3": Format("ROS 2 sqlite3", (".db3", ".db3.zstd"), (b"SQLite format 3\0",), _open_db3),
    "capture": Format("PCAP", (".pcap", ".pcapng", ".cap"), CAPTURE_MAGICS, _open_capture),
}
"""Formats of log files. Add a new format here; formats of single frames are in `FRAME_READERS`."""

_LOG_SUFFIXES = tuple(suffix for form in SOURCES.values() for suffix in form.suffixes)


def open_source(path: Path, *, rate_hz: float = 10.0, decoding: DecoderOptions | None = None) -> Source:
    """Open a recording: a log file, a rosbag2 folder, a folder of frames, or a single frame.

    Parameters
    ----------
    path : Path
        File or folder.
    rate_hz : float, optional
        Frames per second if the frames have no times.
    decoding : DecoderOptions, optional
        Settings that packets do not contain.

    Raises
    ------
    InputError
        If the path is not a readable recording.
    """
    decoding = decoding or DecoderOptions()
    if path.is_dir():
        if is_rosbag2_folder(path):
            return wrap_packets(open_rosbag2(path, partial(_open_file, decoding=decoding)), decoding)
        if is_frame_folder(path):
            return FolderSource(path, rate_hz=rate_hz)
        raise InputError(f"{path}: no logs or frames in this folder; supported formats: {_formats()}")
    if path.suffix.lower() in FRAME_READERS and not _has_magic(path):
        return FolderSource(path, rate_hz=rate_hz)
    return wrap_packets(_open_file(path, decoding), decoding)


def _open_file(path: Path, decoding: DecoderOptions) -> Source:
    head = _head(path)
    for form in SOURCES.values():
        if head.startswith(form.magics):
            return form.open(path, decoding)
    for form in SOURCES.values():
        if path.name.lower().endswith(form.suffixes):
            return form.open(path, decoding)
    raise InputError(f"{path}: unknown format; supported formats: {_formats()}")


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(_HEAD_BYTES)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from error


def _has_magic(path: Path) -> bool:
    return _head(path).startswith(tuple(magic for form in SOURCES.values() for magic in form.magics))


def _formats() -> str:
    frames = (suffix.removeprefix(".").upper() for suffix in FRAME_READERS)
    return ", ".join((*(form.title for form in SOURCES.values()), *frames))


@dataclass(frozen=True)
class Recording:
    """A recording named on the command line: one path, or the files of a split recording.

    Parameters
    ----------
    paths : tuple of Path
        File or folder, or several files in order; in object storage, URLs.
    """

    paths: tuple[Location, ...]

    @property
    def _files(self) -> list[Path]:
        return [path for path in self.paths if isinstance(path, Path)]

    @property
    def key(self) -> Location:
        """A value that only names of the same recording have in common."""
        first = self.paths[0]
        return first.resolve() if isinstance(first, Path) else first

    @property
    def name(self) -> str:
        """Name of the recording."""
        first = self._files[0]
        if len(self.paths) > 1:
            return first.stem.rpartition("_")[0]
        return first.resolve().name if first.is_dir() else first.stem

    @property
    def size(self) -> int:
        """Size in bytes if it is known without a look at the files, as in object storage; otherwise 0."""
        return 0

    @property
    def is_frame_folder(self) -> bool:
        """Whether the recording is a folder of frames, where a damaged file keeps its frame number."""
        path = self._files[0]
        return len(self.paths) == 1 and path.is_dir() and not is_rosbag2_folder(path) and is_frame_folder(path)

    def open(self, *, rate_hz: float = 10.0, decoding: DecoderOptions | None = None) -> Source:
        """Open the recording."""
        decoding = decoding or DecoderOptions()
        if len(self.paths) > 1:
            return wrap_packets(SplitSource(self._files, partial(_open_file, decoding=decoding)), decoding)
        return open_source(self._files[0], rate_hz=rate_hz, decoding=decoding)


def has_metadata_beside(name: str) -> bool:
    """Return whether a file of this name may have metadata of its sensor beside it."""
    return name.lower().endswith(SOURCES["capture"].suffixes)


def metadata_beside(log: Path) -> list[Path]:
    """Return the times of frames, or the metadata of a sensor, beside a log, which belong to it."""
    if times := times_beside(log if log.is_dir() else log.parent):
        return [times]
    if not has_metadata_beside(log.name):
        return []
    files = (file for suffix in CALIBRATION_SUFFIXES.values() for file in log.parent.glob(f"*{suffix}"))
    return [file for file in files if log.stem.startswith(file.stem) or file.stem.startswith(log.stem)]


def find_recordings(patterns: Iterable[str]) -> list[Recording]:
    """Return the recordings that names, folders and globs on the command line refer to.

    A folder that is not a recording itself refers to the recordings in it. Globs are expanded here because not every
    shell expands them; an existing name is never treated as a glob.

    Raises
    ------
    UsageError
        If a glob or a folder contains no recording, or a path does not exist.
    """
    found: dict[Location, Recording] = {}
    real = RealPaths()
    for pattern in patterns:
        named = Path(pattern)
        is_glob = re.search(r"[*?\[]", pattern) and not named.exists()
        paths = sorted(map(Path, glob(pattern, recursive=True))) if is_glob else [named]  # noqa: PTH207 - any root
        if not paths:
            raise UsageError(f"{pattern}: no file matches this pattern")
        if not paths[0].exists():
            raise UsageError(f"{pattern}: no such file or folder")
        for recording in (recording for path in paths for recording in _expand(path)):
            first = recording.paths[0]
            found.setdefault(real(first) if isinstance(first, Path) else first, recording)
    return list(found.values())


def _expand(path: Path) -> list[Recording]:
    if not path.is_dir() or is_rosbag2_folder(path):
        return [Recording((path,))]
    with os.scandir(path) as entries:  # knows the kinds without a look at each file
        kinds = {path / entry.name: (entry.is_file(), entry.is_dir()) for entry in entries}
    children = sorted(kinds)
    files = [child for child in children if kinds[child][0] and child.name.lower().endswith(_LOG_SUFFIXES)]
    if not files and is_frame_folder(path):
        return [Recording((path,))]
    recordings = [Recording(tuple(group)) for group in split_groups(files)]
    recordings += [Recording((child,)) for child in children if kinds[child][1] and _is_recording(child)]
    if not recordings:
        raise UsageError(f"{path}: no logs or frames in this folder; supported formats: {_formats()}")
    return recordings


def _is_recording(folder: Path) -> bool:
    return is_rosbag2_folder(folder) or is_frame_folder(folder)
