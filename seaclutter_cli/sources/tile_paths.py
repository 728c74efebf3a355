"""Tiles that names, folders and globs refer to."""

from collections.abc import Iterable
from glob import glob
from pathlib import Path
from shlex import quote

from seaclutter_cli.errors import InputError
from seaclutter_cli.sources.frame_files import FRAME_READERS
from seaclutter_cli.storage.locations import is_url

EPT = "ept.json"
"""File that describes a set of Entwine point tiles, in their folder."""


def find_tiles(patterns: Iterable[str]) -> list[Path]:
    """Return the tiles that names, folders and globs refer to; a folder refers to the tiles in it.

    Raises
    ------
    InputError
        If one of them refers to no tile.
    """
    found: dict[Path, None] = {}
    for pattern in patterns:
        paths = [Path(pattern)] if Path(pattern).exists() else [Path(name) for name in sorted(glob(pattern))]  # noqa: PTH207
        files = [file for path in paths for file in (sorted(path.iterdir()) if path.is_dir() else [path])]
        tiles = [file for file in files if file.suffix.lower() in FRAME_READERS]
        if not tiles:
            raise InputError(f"{pattern}: {_reason(pattern, files)}")
        found.update(dict.fromkeys(tiles))
    return list(found)


def _reason(pattern: str, files: Iterable[Path]) -> str:
    """Return why a pattern refers to no tile, and what to do."""
    ept = next((str(file) for file in files if file.name == EPT), pattern)
    if ept.startswith("ept://") or ept.endswith(EPT):
        return f"Entwine point tiles (EPT) are not read; {_advice('readers.ept', ept)}"
    if is_url(pattern):
        part = f", or {_advice('readers.copc', pattern)}" if pattern.endswith(".copc.laz") else ""
        return f"tiles are read from local files; download it{part}"
    return f"no tile found; supported suffixes: {', '.join(FRAME_READERS)}"


def _advice(reader: str, source: str) -> str:
    bounds = "'([WEST, EAST], [SOUTH, NORTH])'"
    command = f"pdal translate -r {reader} {quote(source)} part.laz --{reader}.bounds={bounds}"
    return f"write a part of it to a file with PDAL: {command}"
