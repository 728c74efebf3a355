"""Output files that appear under their name only when they are complete."""

import errno
import io
import os
import weakref
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self, cast

from seaclutter_cli.errors import OutputError


class _PartFile(io.FileIO):
    """The incomplete file; its errors are `OutputError` and name the target."""

    def __init__(self, part: Path, target: Path) -> None:
        super().__init__(part, "wb")
        self._target = target

    def write(self, data: Any, /) -> int:
        try:
            return super().write(data)
        except OSError as error:
            raise OutputError(_explain(self._target, error)) from error


class AtomicFile(AbstractContextManager["AtomicFile"]):
    """A file that is written in the folder of its target, then renamed on success or removed after an error.

    Parameters
    ----------
    path : Path
        Target; its folder is created if necessary. If it is a symbolic link, the file it refers to is replaced.

    Raises
    ------
    OutputError
        If the file cannot be created or written, for example because the disk is full.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._target = Path(os.path.realpath(path))
        # Cut, since the target's name may already have the maximum length of the file system.
        self._part = self._target.with_name(f".{self._target.name[-60:]}.{os.getpid()}.part")
        # An interrupt may come before the context is entered; then the file is removed with this object, or at exit.
        opened: list[BinaryIO] = []
        self._discard = weakref.finalize(self, _remove, self._part, opened)
        try:
            self.stream = self._open()
            opened.append(self.stream)
        except BaseException:
            self._discard()
            raise

    def _open(self) -> BinaryIO:
        try:
            if self._target.exists() and not self._target.is_file():
                raise OutputError(f"{self.path}: not a regular file, cannot be replaced")
            self._target.parent.mkdir(parents=True, exist_ok=True)
            return cast("BinaryIO", io.BufferedWriter(_PartFile(self._part, self.path)))
        except OSError as error:
            raise OutputError(f"{self.path}: cannot be written ({error.strerror})") from error

    def __enter__(self) -> Self:
        """Return the file; write to its ``stream``."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Rename the file to its target, or remove it after an error."""
        if kind is not None:
            self._discard()
            if isinstance(error, KeyboardInterrupt):
                error.add_note(f"{self.path}: the incomplete file was removed")
            return
        try:
            self.stream.close()
            self._part.replace(self._target)
            self._discard.detach()
        except BaseException as failure:
            self._discard()
            if isinstance(failure, OSError):
                raise OutputError(_explain(self.path, failure)) from failure
            raise


def _remove(part: Path, opened: list[BinaryIO]) -> None:
    for stream in opened:
        with suppress(OSError, OutputError):
            stream.close()
    with suppress(OSError):
        part.unlink(missing_ok=True)


def _explain(path: Path, error: OSError) -> str:
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return f"{path}: the disk is full; the incomplete file was removed"
    return f"{path}: writing failed ({error.strerror or error}); the incomplete file was removed"
