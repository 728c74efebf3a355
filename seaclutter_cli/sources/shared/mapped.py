"""Files mapped into memory, of which only a bounded part is resident at a time."""

import mmap
import os
import stat
from contextlib import suppress
from pathlib import Path

from seaclutter_cli.errors import InputError

_MOST_RESIDENT = 32 * 2**20
_FAULT = 64 * 2**10


class MappedFile:
    """A file as bytes. Pages that were read count as the program's memory until they are let go.

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
                    raise InputError(f"{path}: not a file on a disk; a log is read from several places at once")
                if not status.st_size:
                    raise InputError(f"{path}: the file is empty")
                self.data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except OSError as error:
            raise InputError(f"{path}: {error.strerror}") from error
        self.view = memoryview(self.data)
        self._resident = 0

    def touched(self, size: int = 0) -> None:
        """Note that a place was read, ``size`` bytes long; from time to time, let all pages go.

        Views stay valid: the system reads their pages again.
        """
        self._resident += size + _FAULT
        if self._resident > _MOST_RESIDENT and hasattr(mmap, "MADV_DONTNEED"):
            self.data.madvise(mmap.MADV_DONTNEED)
            self._resident = 0

    def close(self) -> None:
        """Unmap the file; what views still point to stays mapped until they are gone."""
        self.view.release()
        with suppress(BufferError):
            self.data.close()
