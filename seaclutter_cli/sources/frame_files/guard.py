"""Handling of damaged files, shared by all frame readers."""

from collections.abc import Iterator
from contextlib import contextmanager

from seaclutter_cli.errors import CloudError, MissingExtraError
from seaclutter_cli.text import count


@contextmanager
def reading(kind: str) -> Iterator[None]:
    """Convert the errors that a format's library raises on damaged bytes to a one-line `CloudError`."""
    try:
        yield
    except (CloudError, MissingExtraError, MemoryError, FileNotFoundError, PermissionError, IsADirectoryError):
        raise
    except Exception as error:
        text = str(error) if " " in str(error) else repr(error)
        raise CloudError(f"not a valid {kind} file: {' '.join(text.split())}") from error


def check_size(needed: int, found: int) -> None:
    """Raise `CloudError` if a file declares more bytes than it contains; call it before allocating memory."""
    if needed > found:
        declared = count(needed, "byte")
        raise CloudError(f"the header declares {declared} of data, but the file contains {found:,}; it is truncated")
