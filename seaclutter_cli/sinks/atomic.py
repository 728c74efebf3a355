"""Output files that exist under their name only when they are complete."""

import errno
import os
from contextlib import AbstractContextManager
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

from seaclutter_cli.errors import OutputError


class AtomicFile(AbstractContextManager["AtomicFile"]):
    """A file that is written beside its target and renamed on success, removed otherwise.

    Parameters
    ----------
    path : Path
        Target; its folder is made if need be.

    Raises
    ------
    OutputError
        If the file cannot be made or written; a full disk is such a case.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._part = path.with_name(f".{path.name}.{os.getpid()}.part")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self.stream: BinaryIO = self._part.open("wb")
        except OSError as error:
            raise OutputError(f"{path}: cannot be written ({error.strerror})") from error

    def __enter__(self) -> Self:
        """Return the file itself; write to its ``stream``."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Rename the file to its target, or remove it after an error."""
        try:
            self.stream.close()
            if kind is None:
                self._part.replace(self.path)
        except OSError as failure:
            self._discard()
            raise OutputError(_explain(self.path, failure)) from failure
        if kind is not None:
            self._discard()
        if isinstance(error, OSError):
            raise OutputError(_explain(self.path, error)) from error

    def _discard(self) -> None:
        self._part.unlink(missing_ok=True)


def _explain(path: Path, error: OSError) -> str:
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return f"{path}: the disk is full; nothing was left behind"
    return f"{path}: writing failed ({error.strerror or error}); nothing was left behind"
