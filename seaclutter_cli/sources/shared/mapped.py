"""Memory-mapped files with a bounded resident part."""

import mmap
import os
import stat
from contextlib import suppress
from pathlib import Path

from seaclutter_cli.errors import InputError

_MAX_RESIDENT = 32 * 2**20
_FAULT = 64 * 2**10


class MappedFile:
    """A memory-mapped file. Pages that were read count as memory of the process until they are released.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    InputError
        If it cannot be read, or is empty.
    """

    def __init__(self, path: Path) -> None:
        try:
            with path.open("rb") as file:
                status = os.fstat(file.fileno())
                if not stat.S_ISREG(status.st_mode):
                    raise InputError(f"{path}: not a regular file; logs need random access")
                if not status.st_size:
                    raise InputError(f"{path}: the file is empty")
                self.data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except OSError as error:
            raise InputError(f"{path}: {error.strerror}") from error
        self.view = memoryview(self.data)
        self._resident = 0

    def touched(self, size: int = 0) -> None:
        """Count ``size`` bytes as read; from time to time, release all pages.

        Views remain valid: the system reads their pages again.
        """
        self._resident += size + _FAULT
        if self._resident > _MAX_RESIDENT and hasattr(mmap, "MADV_DONTNEED"):
            self.data.madvise(mmap.MADV_DONTNEED)
            self._resident = 0

    def close(self) -> None:
        """Unmap the file; the data of existing views remains mapped until they are deleted."""
        self.view.release()
        with suppress(BufferError):
            self.data.close()
