"""ROS 2 recordings: folders with a ``metadata.yaml``, or without it after a crash of the recorder."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PureWindowsPath
from typing import Any

from seaclutter_cli.documents import MAX_YAML_CHARACTERS, DocumentError, load_yaml
from seaclutter_cli.errors import InputError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.records import Damage
from seaclutter_cli.sources.shared.split import NUMBERED, SplitSource

METADATA = "metadata.yaml"

_KEY = "rosbag2_bagfile_information"
_STORAGE = re.compile(r".+\.(mcap|db3)(\.zstd)?", re.IGNORECASE)


@dataclass(frozen=True)
class _Metadata:
    """The used part of a ``metadata.yaml``; the storage files contain the rest."""

    names: list[str] = field(default_factory=list)
    counts: Mapping[str, int] = field(default_factory=dict)
    messages: int | None = None
    compression_mode: str = ""
    compression_format: str = ""


def is_rosbag2_folder(path: Path) -> bool:
    """Return whether a folder has a ``metadata.yaml`` of rosbag2, or all of its storage files are named after it."""
    if not path.is_dir():
        return False
    files = _storage_files(path)
    if (path / METADATA).is_file():
        return bool(files) or _KEY in _read_text(path / METADATA)
    name = path.resolve().name
    matches = [NUMBERED.fullmatch(file.name) for file in files]
    return bool(files) and all(match is not None and match[1] == name for match in matches)


def open_rosbag2(folder: Path, open_file: Callable[[Path], Source]) -> Source:
    """Open a rosbag2 folder as one source; `InputError` if no file can be read, or the compression is not supported.

    The files that ``metadata.yaml`` lists are read, then those that continue their numbers. Topics come from the files.
    """
    metadata, damage = _read_metadata(folder)
    if metadata.compression_mode in {"file", "message"} and metadata.compression_format not in {"", "zstd"}:
        raise InputError(f"{folder}: unsupported compression {metadata.compression_format!r}; only zstd can be read")
    files = []
    for name in metadata.names:
        # The file of a name, or its packed or unpacked version.
        versions = (folder / name, folder / f"{name}.zstd", folder / name.removesuffix(".zstd"))
        file = next((file for file in versions if file.is_file()), None)
        if file is None:
            problem = f"{METADATA} lists this file, but it does not exist"
            damage.append(Damage(folder / name, None, problem, lost_messages=metadata.counts.get(name)))
        else:
            files.append(file)
    files += _unnamed(folder, files)
    if not files:
        raise InputError(f"{folder}: a ROS 2 recording without .mcap or .db3 files")
    return SplitSource(
        files,
        open_file,
        name=folder.resolve().name,
        damage=damage,
        expected=None if metadata.messages is None else (folder / METADATA, metadata.messages),
        packed_messages=metadata.compression_mode == "message",
    )


def _storage_files(folder: Path) -> list[Path]:
    """Return the storage files of a folder in natural order; of packed and unpacked versions, only the latter."""
    try:
        files = [file for file in folder.iterdir() if _STORAGE.fullmatch(file.name) and file.is_file()]
    except OSError as error:
        raise InputError(f"{folder}: {error.strerror}") from error
    unpacked = {file for file in files if file.suffix.lower() != ".zstd"}
    return sorted((file for file in files if file in unpacked or file.with_suffix("") not in unpacked), key=_natural)


def _natural(file: Path) -> tuple[str, int, str]:
    match = NUMBERED.fullmatch(file.name)
    return (match[1], int(match[2]), file.name) if match else (file.name, -1, "")


def _unnamed(folder: Path, named: list[Path]) -> list[Path]:
    """Return the files of the recording that ``metadata.yaml`` does not list, as after a crash."""
    files = _storage_files(folder)
    if not named:
        return files
    last = NUMBERED.fullmatch(named[-1].name)
    if last is None:
        return []
    matches = [(file, NUMBERED.fullmatch(file.name)) for file in files if file not in named]
    return [file for file, match in matches if match and match[1] == last[1] and int(match[2]) > int(last[2])]


def _read_text(path: Path) -> str:
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            return file.read(MAX_YAML_CHARACTERS + 1)
    except OSError:
        return ""


def _read_metadata(folder: Path) -> tuple[_Metadata, list[Damage]]:
    """Return the valid content of ``metadata.yaml``, and its damage."""
    path = folder / METADATA
    if not path.is_file():
        return _Metadata(), []
    try:
        document = load_yaml(_read_text(path))
    except DocumentError as error:
        return _Metadata(), [Damage(path, None, f"{error}; the files are read in the order of their numbers")]
    info = document.get(_KEY) if isinstance(document, dict) else None
    info = info if isinstance(info, dict) else {}
    names = _list(info, "relative_file_paths", str)
    if not names:
        return _Metadata(), [Damage(path, None, "not readable; the files are read in the order of their numbers")]
    files = [file for file in _list(info, "files", dict) if isinstance(file.get("path"), str)]
    return _Metadata(
        # In early versions, the folder name precedes the file names.
        names=[PureWindowsPath(name).name for name in names],
        counts={PureWindowsPath(file["path"]).name: _count(file) or 0 for file in files},
        messages=_count(info),
        compression_mode=str(info.get("compression_mode") or "").lower(),
        compression_format=str(info.get("compression_format") or "").lower(),
    ), []


def _list(mapping: Mapping[str, Any], key: str, kind: type) -> list[Any]:
    items = mapping.get(key)
    return [item for item in items if isinstance(item, kind)] if isinstance(items, list) else []


def _count(mapping: Mapping[str, Any]) -> int | None:
    count = mapping.get("message_count")
    return count if type(count) is int and count >= 0 else None
