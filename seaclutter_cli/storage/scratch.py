"""The scratch folder: copies of objects while they are read, and outputs before they are uploaded."""

import os
import shutil
import tempfile
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from seaclutter_cli.errors import InputError, OutputError
from seaclutter_cli.storage.locations import Url
from seaclutter_cli.storage.parts import part_path, release, remove_stale

VARIABLE = "SEACLUTTER_SCRATCH"
"""Environment variable for the folder. It belongs to the machine, so workers elsewhere have their own."""


def scratch_root() -> Path:
    """Return the folder for temporary copies: that of the environment, or the system's for temporary files."""
    return Path(os.environ.get(VARIABLE) or tempfile.gettempdir()).absolute()


_AT_END: ContextVar[list[Callable[[], object]] | None] = ContextVar("_AT_END", default=None)


@contextmanager
def copies_removed() -> Iterator[None]:
    """Remove all copies that are made within the context; as a decorator, within the function.

    Copies are removed with the objects that hold them, too, but tracebacks that libraries keep may hold these for long.
    """
    removers: list[Callable[[], object]] = []
    before = _AT_END.set(removers)
    try:
        yield
    finally:
        _AT_END.reset(before)
        for remove in reversed(removers):
            remove()


def remove_at_end(remove: Callable[[], object]) -> None:
    """Call a function when the innermost `copies_removed` ends, before those that were passed earlier."""
    removers = _AT_END.get()
    if removers is not None:
        removers.append(remove)


class ScratchFolder:
    """A new folder, only for this user, that is removed with this object or when the program ends.

    Folders that killed runs left behind are removed too.

    Raises
    ------
    OutputError
        If it cannot be created.
    """

    def __init__(self) -> None:
        root = scratch_root()
        try:
            root.mkdir(exist_ok=True)
            root = root.resolve()  # errors of libraries name files by their resolved paths
            remove_stale(root)
            self.path = part_path(root / "seaclutter")
            self.path.mkdir(mode=0o700)
        except OSError as error:
            raise OutputError(f"{root}: the scratch folder cannot be used ({error.strerror})") from error
        self.remove = weakref.finalize(self, _remove, self.path)
        remove_at_end(self.remove)

    def free(self) -> int:
        """Return the number of free bytes."""
        return shutil.disk_usage(self.path).free

    def require(self, size: int, url: Url) -> None:
        """Raise `InputError` if there is no space for a copy of some bytes."""
        if self.free() < size:
            raise InputError(
                f"{url}: needs {gigabytes(size)} in the scratch folder {self.path.parent}, which has "
                f"{gigabytes(self.free())} free; choose another with --scratch"
            )


def _remove(path: Path) -> None:
    shutil.rmtree(path, ignore_errors=True)
    release(path)


def gigabytes(size: int) -> str:
    """Return a number of bytes as text.

    Examples
    --------
    >>> gigabytes(2_500_000_000)
    '2.50 GB'
    """
    return f"{size / 1e9:.2f} GB"
