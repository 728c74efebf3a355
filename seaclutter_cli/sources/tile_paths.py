"""Tiles that names, folders and globs refer to."""

import os
from collections.abc import Iterable
from glob import glob, has_magic
from pathlib import Path
from shlex import quote

from seaclutter_cli.errors import InputError, UsageError
from seaclutter_cli.sources.frame_files import FRAME_READERS
from seaclutter_cli.storage.locations import is_url

PathLike = str | os.PathLike[str]
EPT = "ept.json"
"""File that describes a set of Entwine point tiles, in their folder."""

_MISSING, _NO_MATCH = "no such file or folder", "no file matches this pattern"


def find_tiles(tiles: PathLike | Iterable[PathLike]) -> list[Path]:
    """Return the tiles that names, folders and globs refer to; a folder refers to the tiles in it.

    A tile with several names, such as a relative and an absolute path, is found once.

    Parameters
    ----------
    tiles : path, or iterable of paths
        Files, folders or globs.

    Raises
    ------
    UsageError
        If there is no such file or folder.
    InputError
        If one of them refers to no tile.
    """
    found: dict[Path, Path] = {}
    for given in [tiles] if isinstance(tiles, str | os.PathLike) else tiles:
        pattern = os.fspath(given)
        paths = [Path(pattern)] if Path(pattern).exists() else [Path(name) for name in sorted(glob(pattern))]  # noqa: PTH207
        if not (paths or "://" in pattern or pattern.endswith(EPT)):
            raise UsageError(f"{pattern}: {_NO_MATCH if has_magic(pattern) else _MISSING}")
        files = [file for path in paths for file in (sorted(path.iterdir()) if path.is_dir() else [path])]
        own = [file for file in files if file.suffix.lower() in FRAME_READERS]
        if not own:
            raise InputError(f"{pattern}: {_reason(pattern, files)}")
        for file in own:
            found.setdefault(file.resolve(), file)
    return list(found.values())


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
