"""What all frame readers share when a file is damaged."""

from collections.abc import Iterator
from contextlib import contextmanager

from seaclutter_cli.errors import CloudError, MissingExtraError


@contextmanager
def reading(kind: str) -> Iterator[None]:
    """Turn whatever a format's library raises on damaged bytes into a `CloudError` of one line."""
    try:
        yield
    except (CloudError, MissingExtraError, FileNotFoundError, PermissionError, IsADirectoryError):
        raise
    except Exception as error:
        text = str(error) if " " in str(error) else repr(error)
        raise CloudError(f"no valid {kind}: {' '.join(text.split())}") from error


def check_size(needed: int, found: int) -> None:
    """Raise `CloudError` if a file announces more bytes of points than it has, before memory is taken for them."""
    if needed > found:
        raise CloudError(f"its header announces {needed} bytes of points, the file has {found}: it was cut short")
