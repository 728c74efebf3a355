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
    return Identities().of(path)


class Identities:
    """Identities of many files, with one look at each folder.

    **State**: the identities of folders so far, and whether they ignore case.
    """

    def __init__(self) -> None:
        self._folders: dict[Path, Identity] = {}
        self._ignoring: dict[Path, bool] = {}

    def of(self, path: Path) -> Identity:
        """Return the identity of a file, as `identity` does."""
        try:
            found = path.stat()
        except (OSError, ValueError):
            above = path.parent
            if above == path:
                return (str(path),)
            if above not in self._ignoring:
                self._ignoring[above] = _ignores_case(above)
            return (*self.of_folder(above), path.name.casefold() if self._ignoring[above] else path.name)
        return (found.st_dev, found.st_ino) if found.st_ino else (os.path.normcase(path),)

    def of_folder(self, folder: Path) -> Identity:
        """Return the identity of a folder, which is looked at only once."""
        if folder not in self._folders:
            self._folders[folder] = self.of(folder)
        return self._folders[folder]


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
