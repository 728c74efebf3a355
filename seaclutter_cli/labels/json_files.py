"""Helpers for JSON files with labelled boxes."""

import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from seaclutter_cli.documents import MAX_JSON_BYTES, DocumentError, load_json
from seaclutter_cli.errors import LabelError
from seaclutter_cli.labels.boxes import Labelled, checked, truth_of
from seaclutter_cli.labels.files import files_in, label_folder
from seaclutter_cli.truth import Truth

_HEAD_BYTES = 1024
_BOM = b"\xef\xbb\xbf"

Point = tuple[float, float, float]


def json_folder(path: Path, name: str, mark: bytes, key: bytes) -> Path | None:
    """Return the folder of JSON label files: the subfolder of this name or the path itself; None if neither fits.

    At least one JSON file must start with ``mark`` and contain ``key`` near its start. A folder of the right name needs
    no such file, because all files may be empty or broken, but no file may start with the mark of the other format.
    """
    folder = label_folder(path, name, ".json")
    if folder is None:
        return None
    files = files_in(folder, (".json",))
    other = b"[" if mark == b"{" else b"{"
    typical = any(head.startswith(mark) and key in head for head in map(_head, files))
    named = folder.resolve().name == name
    return folder if typical or (named and not any(head.startswith(other) for head in map(_head, files))) else None


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(_HEAD_BYTES).removeprefix(_BOM).lstrip()


def read_json(path: Path) -> Any:
    """Return the content of a JSON file; None if the file is empty.

    Raises
    ------
    LabelError
        If the file is not valid JSON.
    """
    with path.open("rb") as file:
        content = file.read(MAX_JSON_BYTES + 1).removeprefix(_BOM)
    if not content.strip():
        return None
    try:
        return load_json(content)
    except DocumentError as error:
        raise LabelError(str(error)) from error


def truth_from(items: Iterable[Any], parse: Callable[[Any], Labelled]) -> Truth:
    """Return the truth of a frame from the JSON of its objects.

    Raises
    ------
    LabelError
        If an object is invalid; the message names its number.
    """
    objects = []
    for number, item in enumerate(items):
        try:
            objects.append(checked(parse(item)))
        except LabelError as error:
            raise LabelError(f"object {number}: {error}") from error
    return truth_of(objects)


def part(item: Any, key: str) -> Any:
    """Return the value of a key.

    Raises
    ------
    LabelError
        If the key is missing or the item is not a JSON object.
    """
    if not isinstance(item, Mapping) or key not in item:
        raise LabelError(f"missing key {key!r}")
    return item[key]


def number(item: Any, key: str) -> float:
    """Return the finite number at a key.

    Raises
    ------
    LabelError
        If the key is missing or its value is not a finite number.
    """
    value = part(item, key)
    try:
        result = math.nan if isinstance(value, str | bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        result = math.nan
    if not math.isfinite(result):
        raise LabelError(f"{key!r} is not a finite number")
    return result


def numbers(item: Any, keys: tuple[str, str, str]) -> Point:
    """Return the finite numbers at three keys."""
    first, second, third = (number(item, key) for key in keys)
    return first, second, third


def text(item: Any, key: str) -> str:
    """Return the text or whole number at a key as text; empty if there is neither."""
    value = item.get(key) if isinstance(item, Mapping) else None
    return str(value) if isinstance(value, str | int) and not isinstance(value, bool) else ""
