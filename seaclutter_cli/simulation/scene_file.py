"""Text of scene files: all keys with their values and a comment each."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, fields
from pathlib import Path
from types import MappingProxyType
from typing import Any

from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup
from seaclutter_cli.validation import descriptions, name_choices, plain, summary, yaml_value

KEYS = "docs/scene-keys.md has all keys; so has a file that simulate --scene-file saves"
"""Advice in errors of scenes."""

_COLUMN = 40
_ENTRIES = {"objects": "an object", "land": "a piece of land"}


def write_scene(
    path: Path,
    group: OutputGroup | None,
    sections: Mapping[str, Any],
    lists: Mapping[str, tuple[type[Any], Sequence[Any]]],
    absent: Mapping[str, Any] = MappingProxyType({}),
) -> None:
    """Write a scene file of the parameters of its sections, and the dataclass and items of its lists.

    Sections that are absent from the scene become comments. A comment describes the keys of a list; its items are one
    per line, without default values. Raises `OutputError` on failure.
    """
    lines: list[str] = []
    for name, params in sections.items():
        lines += [*_commented(f"{name}:", summary(type(params))), *_keys(plain(params), type(params)), ""]
    for name, params in absent.items():
        meaning = summary(type(params)) + ("; without this section, those of the lidar" if name == "noise" else "")
        lines += [f"# {line}" for line in (*_commented(f"{name}:", meaning), *_keys(plain(params), type(params)))]
        lines.append("")
    for name, (kind, items) in lists.items():
        lines.append(f"# {summary(kind)}. Keys that {_ENTRIES[name]} leaves out have these values:")
        defaults = {key.name: key.default if key.default is MISSING else plain(key.default) for key in fields(kind)}
        lines += [f"# {line}" for line in _keys(defaults, kind)]
        lines.append(f"{name}:" if items else f"{name}: []")
        for values in map(vars, items):
            changed = {key: plain(value) for key, value in values.items() if plain(value) != defaults[key]}
            lines.append(f"  - {yaml_value(changed)}")
    with AtomicFile(path, group) as file:
        file.stream.write(("\n".join(lines) + "\n").encode())


def _keys(values: Mapping[str, Any], kind: type[Any]) -> Iterator[str]:
    described, choices = descriptions(kind), name_choices(kind)
    for key, value in values.items():
        if key in choices:
            yield f"  # {key} is one of {', '.join(choices[key].names)}"
        if value is MISSING:
            yield from _commented(f"  {key}:", f"{described[key]} Required.")
        else:
            yield from _commented(f"  {key}: {yaml_value(value)}", described[key])


def _commented(line: str, comment: str) -> tuple[str, ...]:
    """Return a line with a comment at its end, or on a line of its own before it if the line is long."""
    if len(line) <= _COLUMN:
        return (f"{line:<{_COLUMN}} # {comment}",)
    return f"{line[: len(line) - len(line.lstrip())]}# {comment}", line
