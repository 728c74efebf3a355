"""Order and real paths of files, recognition of one file under several paths, and files that are read at once."""

import errno
import os
import re
import stat
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import BinaryIO

from seaclutter_cli.limits import limits, variable

Identity = tuple[int | str, ...]
"""Numbers of device and file, followed by the names below if the file does not exist."""

_DEPTH = 3
"""Levels of subfolders in which recordings and labels have files."""


def natural_order(file: Path) -> tuple[list[str | int], str]:
    """Return a sort key that orders numbers in names by value: frame2 before frame10."""
    parts = re.split(r"([0-9]+)", file.name)
    return [int(part) if index % 2 else part for index, part in enumerate(parts)], file.name


class WrongFileError(OSError):
    """A path is not that of a regular file, or that of one that is too large."""


def open_regular(path: Path) -> BinaryIO:
    """Open a file for reading; `OSError` if it is something else: a pipe would wait, some devices have no end."""
    number = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    kind = os.fstat(number).st_mode
    if not stat.S_ISREG(kind):
        os.close(number)
        if stat.S_ISDIR(kind):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        raise WrongFileError(errno.EINVAL, "not a regular file", str(path))
    return open(number, "rb")  # noqa: PTH123 - not a path


def read_whole(path: Path) -> bytes:
    """Return the content of a regular file; `OSError` if there is none, or it is larger than the limit."""
    most = limits().whole_mib
    with open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        if size > most * 2**20:
            problem = f"larger than {most:,} MiB, the limit of a file that is read at once ({variable('whole_mib')})"
            raise WrongFileError(errno.EFBIG, problem, str(path))
        return file.read(size)


class Identities:
    """Real paths of files, and values that only paths of the same file have in common, whether it exists or not.

    **State**: real path and identity of each folder so far, and whether it ignores case; on a network, each look at a
    name takes a while. They are valid as long as no folder becomes a link.
    """

    def __init__(self) -> None:
        self._real_folder, self._ignores_case = cache(os.path.realpath), cache(_ignores_case)
        self.of_folder = cache(self.of)
        """Returns the identity of a folder, which is looked at only once."""

    def __call__(self, path: Path) -> Path:
        """Return the absolute path of a file without links, as `Path.resolve` does."""
        folder, name = os.path.split(path)
        if name in ("", ".", ".."):
            return Path(os.path.realpath(path))
        full = os.path.join(self._real_folder(folder), name)  # noqa: PTH118 - faster, for thousands of paths
        return Path(os.path.realpath(full) if os.path.islink(full) else full)  # noqa: PTH114

    def of(self, path: Path) -> Identity:
        """Return the identity of an absolute path without links; hard links to a file are the same file."""
        try:
            found = path.stat()
        except (OSError, ValueError):
            above = path.parent
            if above == path:
                return (str(path),)
            return (*self.of_folder(above), path.name.casefold() if self._ignores_case(above) else path.name)
        return (found.st_dev, found.st_ino) if found.st_ino else (os.path.normcase(path),)


def _ignores_case(folder: Path) -> bool:
    """Return whether a folder is also found by its name in the other case."""
    other = folder.with_name(folder.name.swapcase()) if folder.name else folder
    with suppress(OSError, ValueError):
        return os.name == "nt" or (other != folder and other.samefile(folder))
    return False


def files_in(folder: str | Path, depth: int = _DEPTH) -> Iterator[Identity]:
    """Yield the identities of the files in a folder and its subfolders; nothing for a file."""
    try:
        entries = list(os.scandir(folder))
    except OSError:
        return
    for entry in entries:
        with suppress(OSError):  # a broken link
            if not entry.is_dir():
                found = entry.stat()
                yield found.st_dev, found.st_ino
            elif depth > 1:
                yield from files_in(entry.path, depth - 1)
