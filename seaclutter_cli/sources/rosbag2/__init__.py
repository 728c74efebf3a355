"""ROS 2 recordings: folders with a ``metadata.yaml``, or without it after a crash of the recorder."""

import io
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path, PureWindowsPath
from typing import Any

from seaclutter_cli.documents import MAX_YAML_CHARACTERS, DocumentError, load_yaml
from seaclutter_cli.errors import InputError, opening
from seaclutter_cli.interfaces import Source
from seaclutter_cli.paths import open_regular
from seaclutter_cli.records import Damage
from seaclutter_cli.sources.shared.split import SplitSource, numbered, without_time
from seaclutter_cli.text import count

METADATA = "metadata.yaml"

_KEY = "rosbag2_bagfile_information"
_STORAGE = re.compile(r".+\.(mcap|db3)(\.zstd)?", re.IGNORECASE)


def is_rosbag2_folder(path: Path) -> bool:
    """Return whether a folder has a ``metadata.yaml`` of rosbag2, or all of its storage files are named after it."""
    if not path.is_dir():
        return False
    files = _storage_files(path)
    if (path / METADATA).is_file():
        return bool(files) or _KEY in _read_text(path / METADATA)
    name = path.resolve().name
    names = (name, without_time(name))
    return bool(files) and all(prefix in names and number >= 0 for prefix, number in map(numbered, files))


def open_rosbag2(folder: Path, open_file: Callable[[Path], Source]) -> Source:
    """Open a rosbag2 folder as one source; `InputError` if no file can be read, or the compression is not supported.

    The files that ``metadata.yaml`` lists are read, then those that continue their numbers. Topics come from the files.
    """
    info, damage = _read_info(folder)
    mode, compression = (str(info.get(key) or "").lower() for key in ("compression_mode", "compression_format"))
    if mode in {"file", "message"} and compression not in {"", "zstd"}:
        raise InputError(f"{folder}: unsupported compression {compression!r}; only zstd can be read")
    listed = [file for file in _list(info, "files", dict) if isinstance(file.get("path"), str)]
    counts = {PureWindowsPath(file["path"]).name: _count(file) or 0 for file in listed}
    files = []
    for path in _list(info, "relative_file_paths", str):
        name = PureWindowsPath(path).name  # in early versions, the folder precedes it
        # The file of a name, or its packed or unpacked version.
        versions = (folder / name, folder / f"{name}.zstd", folder / name.removesuffix(".zstd"))
        if (file := next((file for file in versions if file.is_file()), None)) is None:
            problem = f"{METADATA} lists this file, but it does not exist"
            damage.append(Damage(folder / name, None, problem, lost_messages=counts.get(name)))
        else:
            files.append(file)
    files += _unnamed(folder, files)
    if not files:
        raise InputError(f"{folder}: a ROS 2 recording without .mcap or .db3 files")
    messages = _count(info)
    expected = None if messages is None else (folder / METADATA, messages)
    source = SplitSource(files, open_file, name=folder.resolve().name, damage=damage, expected=expected)
    used = {file.name.removesuffix(".zstd") for file in files}
    left = [file.name for file in _storage_files(folder) if file.name.removesuffix(".zstd") not in used]
    if left:
        more = f" and {count(len(left) - 1, 'other file')}" if len(left) > 1 else ""
        source.warn(f"{left[0]}{more} left out: {METADATA} does not list them, nor do they continue its files")
    return source


def _storage_files(folder: Path) -> list[Path]:
    """Return the storage files of a folder in natural order; of packed and unpacked versions, only the latter."""
    with opening(folder):
        files = [file for file in folder.iterdir() if _STORAGE.fullmatch(file.name) and file.is_file()]
    unpacked = {file for file in files if file.suffix.lower() != ".zstd"}
    chosen = (file for file in files if file in unpacked or file.with_suffix("") not in unpacked)
    return sorted(chosen, key=lambda file: (*numbered(file), file.name))


def _unnamed(folder: Path, named: list[Path]) -> list[Path]:
    """Return the files of the recording that ``metadata.yaml`` does not list, as after a crash."""
    files = _storage_files(folder)
    if not named:
        return files
    prefix, last = numbered(named[-1])
    left = [file for file in files if file not in named and last >= 0]
    return [file for file in left if numbered(file)[0] == prefix and numbered(file)[1] > last]


def _read_text(path: Path) -> str:
    with suppress(OSError), io.TextIOWrapper(open_regular(path), encoding="utf-8", errors="replace") as file:
        return file.read(MAX_YAML_CHARACTERS + 1)
    return ""


def _read_info(folder: Path) -> tuple[dict[str, Any], list[Damage]]:
    """Return the content of ``metadata.yaml``, empty if it lists no files, and its damage."""
    path = folder / METADATA
    if not path.is_file():
        return {}, []
    problem = "not readable"
    try:
        document = load_yaml(_read_text(path))
        info = document.get(_KEY) if isinstance(document, dict) else None
        if isinstance(info, dict) and _list(info, "relative_file_paths", str):
            return info, []
    except DocumentError as error:
        problem = str(error)
    return {}, [Damage(path, None, f"{problem}; the files are read in the order of their numbers")]


def _list(mapping: Mapping[str, Any], key: str, kind: type) -> list[Any]:
    items = mapping.get(key)
    return [item for item in items if isinstance(item, kind)] if isinstance(items, list) else []


def _count(mapping: Mapping[str, Any]) -> int | None:
    count = mapping.get("message_count")
    return count if type(count) is int and count >= 0 else None
