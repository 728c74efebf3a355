"""Recognition of one file under several paths."""

import os
from collections.abc import Iterator
from pathlib import Path

Identity = tuple[int | str, ...]
"""Numbers of device and file, followed by the names below if the file does not exist."""

_DEPTH = 3
"""Levels of subfolders in which recordings and labels have files."""


def identity(path: Path) -> Identity:
    """Return a value that only paths of the same file have in common, whether it exists or not.

    Parameters
    ----------
    path : Path
        Absolute path without links. Hard links to a file are the same file.
    """
    try:
        found = path.stat()
    except (OSError, ValueError):
        above = path.parent
        if above == path:
            return (str(path),)
        return (*identity(above), path.name.casefold() if _ignores_case(above) else path.name)
    return (found.st_dev, found.st_ino) if found.st_ino else (os.path.normcase(path),)


def _ignores_case(folder: Path) -> bool:
    """Return whether a folder is also found by its name in the other case."""
    other = folder.with_name(folder.name.swapcase()) if folder.name else folder
    try:
        return os.name == "nt" or (other != folder and other.samefile(folder))
    except (OSError, ValueError):
        return False


def files_in(folder: Path) -> Iterator[Identity]:
    """Yield the identities of the files in a folder and its subfolders; nothing for a file."""
    return _files_in(os.fspath(folder), _DEPTH)


def _files_in(folder: str, depth: int) -> Iterator[Identity]:
    try:
        entries = list(os.scandir(folder))
    except OSError:
        return
    for entry in entries:
        try:
            if not entry.is_dir():
                found = entry.stat()
                yield found.st_dev, found.st_ino
            elif depth > 1:
                yield from _files_in(entry.path, depth - 1)
        except OSError:  # a broken link
            continue
