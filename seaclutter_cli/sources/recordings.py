"""Recordings: which files, folders and globs refer to, and which files form one."""

import os
import re
from collections.abc import Callable, Iterable
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from glob import glob
from pathlib import Path

from seaclutter_cli.errors import InputError, UsageError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.paths import Identities
from seaclutter_cli.sensors.packets import CALIBRATION_SUFFIXES, DecoderOptions
from seaclutter_cli.sources.formats import SOURCES, format_names, is_log_name, open_file, open_source, wrap_packets
from seaclutter_cli.sources.frame_files.folder import is_frame_folder
from seaclutter_cli.sources.frame_files.sidecars import times_beside
from seaclutter_cli.sources.pcap import metadata_of
from seaclutter_cli.sources.rosbag2 import is_rosbag2_folder
from seaclutter_cli.sources.shared.merged import MergedSource
from seaclutter_cli.sources.shared.split import SplitSource, joined, joined_name, numbered, split_groups
from seaclutter_cli.text import count


@dataclass(frozen=True)
class Recording:
    """A file or folder, or the files of a split recording in order; ``inside`` are folders below the searched one.

    ``parts`` are the recordings that are merged into this one.
    """

    paths: tuple[Path, ...]
    inside: tuple[str, ...] = field(default=(), kw_only=True)
    parts: "tuple[Recording, ...]" = field(default=(), kw_only=True)

    @property
    def key(self) -> Path:
        """A value that only names of the same recording have in common."""
        return self.paths[0].resolve()

    @property
    def name(self) -> str:
        """Name of the recording."""
        first = self.paths[0]
        if self.parts:
            return f"{self.parts[0].name}_and_{len(self.parts) - 1}_more"
        if len(self.paths) > 1 and numbered(first)[1] == 0:
            return joined_name(self.paths)
        return first.resolve().name if first.is_dir() else Path(first.name.removesuffix(".zstd")).stem

    @property
    def is_frame_folder(self) -> bool:
        """Whether the recording is a folder of frames, where a damaged file keeps its frame number."""
        path = self.paths[0]
        return len(self.paths) == 1 and path.is_dir() and not is_rosbag2_folder(path) and is_frame_folder(path)

    def open(
        self, *, rate_hz: float = 10.0, columns: str | None = None, decoding: DecoderOptions | None = None
    ) -> Source:
        """Open the recording."""
        if self.parts:
            with ExitStack() as stack:
                parts = (part.open(rate_hz=rate_hz, columns=columns, decoding=decoding) for part in self.parts)
                merged = MergedSource([stack.enter_context(closing(part)) for part in parts], self.name)
                stack.pop_all()
            return merged
        if len(self.paths) > 1:
            return wrap_packets(SplitSource(self.paths, partial(open_file, decoding=decoding)), decoding)
        return open_source(self.paths[0], rate_hz=rate_hz, columns=columns, decoding=decoding)

    def require_one(self) -> None:
        """Raise `InputError` if the files, which are joined by their names, are not one recording."""
        lines: list[str] = []
        if len(self.paths) > 1 and len(joined(self.paths, open_file, lines.append)) > 1:
            raise InputError(f"{lines[-1]}; --no-join reads them one by one")


def has_metadata_beside(name: str) -> bool:
    """Return whether a file of this name may have metadata of its sensor beside it."""
    return name.lower().endswith(SOURCES["capture"].suffixes)


def metadata_beside(log: Path) -> list[Path]:
    """Return the times of frames, or the metadata of a sensor, beside a log, which belong to it."""
    if not is_log_name(log.name) and (times := times_beside(log if log.is_dir() else log.parent)):
        return [times]
    if not has_metadata_beside(log.name):
        return []
    return [file for suffix in CALIBRATION_SUFFIXES.values() for file in metadata_of(log, suffix)]


@dataclass(frozen=True, kw_only=True)
class Search:
    """How folders are searched; numbered files are one recording if ``join``, by default if times and topics fit.

    All recordings become one if ``merge``.
    """

    join: bool | None = None
    merge: bool = False
    recursive: bool = False


def find_recordings(
    patterns: Iterable[str], search: Search | None = None, note: Callable[[str], object] = lambda _: None
) -> list[Recording]:
    """Return the recordings that names, globs, and folders that are no recordings refer to; `UsageError` if none.

    Globs are expanded here because not every shell does. ``note`` receives lines about what is joined or left out.
    """
    search = search or Search()
    found: dict[Path, Recording] = {}
    real = Identities()
    paths = [path for pattern in patterns for path in _matching(pattern)]
    files = dict.fromkeys(path for path in paths if path.is_file()) if search.join else {}
    groups = {group[0]: group for group in split_groups([*files])}
    for path in paths:
        if path in groups:
            recordings = [Recording(tuple(groups[path]))]
        else:
            recordings = _expand(path, search, note) if path not in files else []
        for recording in recordings:
            found.setdefault(real(recording.paths[0]), recording)
    if search.merge and len(found) > 1:
        return [Recording(tuple(path for one in found.values() for path in one.paths), parts=tuple(found.values()))]
    return list(found.values())


def _matching(pattern: str) -> list[Path]:
    """Return the paths that a name or a glob refers to; `UsageError` if there are none."""
    if pattern == "-":
        raise UsageError("-: logs are read more than once, so not from standard input; save it to a file first")
    named = Path(pattern)
    is_glob = re.search(r"[*?\[]", pattern) and not named.exists()
    paths = sorted(map(Path, glob(pattern, recursive=True))) if is_glob else [named]  # noqa: PTH207 - any root
    if not paths:
        raise UsageError(f"{pattern}: no file matches this pattern")
    if not paths[0].exists():
        raise UsageError(f"{pattern}: no such file or folder")
    return paths


def _expand(
    path: Path, search: Search, note: Callable[[str], object], above: frozenset[Path] = frozenset()
) -> list[Recording]:
    """Return the recordings in a folder; ``above`` are the folders that contain it, to which links may lead back."""
    if not path.is_dir() or is_rosbag2_folder(path):
        return [Recording((path,))]
    with os.scandir(path) as entries:  # knows the kinds without a look at each file
        kinds = {path / entry.name: (entry.is_file(), entry.is_dir()) for entry in entries}
    children = sorted(kinds)
    files = [child for child in children if kinds[child][0] and is_log_name(child.name)]
    folders = [child for child in children if kinds[child][1]]
    if not files and is_frame_folder(path):
        return [Recording((path,))]
    recordings = [Recording(tuple(part)) for group in split_groups(files) for part in _joined(group, search, note)]
    recordings += [Recording((child,)) for child in folders if is_recording(child)]
    above |= {path.resolve()}
    inner = [child for child in folders if not is_recording(child) and _has_recordings(child, above)]
    if search.recursive:
        for child in inner:
            found = _expand(child, search, note, above)
            recordings += [replace(recording, inside=(child.name, *recording.inside)) for recording in found]
    elif inner:
        more = f" and {count(len(inner) - 1, 'other folder')}" if len(inner) > 1 else ""
        note(f"{path}: the recordings in {inner[0].name}{more} are left out; --recursive includes them")
    if is_frame_folder(path):
        note(f"{path}: the frames in this folder are left out, because it contains logs")
    if not recordings:
        hint = "; --recursive searches the folders in it" if inner else f"; supported formats: {format_names()}"
        raise UsageError(f"{path}: no logs or frames in this folder{hint}")
    return recordings


def _joined(group: list[Path], search: Search, note: Callable[[str], object]) -> list[list[Path]]:
    if len(group) == 1 or search.join:
        return [group]
    return [[file] for file in group] if search.join is False else joined(group, open_file, note)


def _has_recordings(path: Path, above: frozenset[Path]) -> bool:
    """Return whether a path is a recording, or has some below it, but not by way of a folder that contains it."""
    if is_log_name(path.name) and path.is_file():
        return True
    with suppress(OSError):
        if path.is_dir() and (real := path.resolve()) not in above:
            return is_recording(path) or any(_has_recordings(child, above | {real}) for child in path.iterdir())
    return False


def is_recording(folder: Path) -> bool:
    """Return whether a folder is a recording."""
    return is_rosbag2_folder(folder) or is_frame_folder(folder)
