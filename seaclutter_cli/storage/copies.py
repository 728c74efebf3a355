"""Short-lived copies of small objects."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from seaclutter_cli.errors import InputError
from seaclutter_cli.storage.locations import Url
from seaclutter_cli.storage.mirrors import Mirror
from seaclutter_cli.storage.objects import find_object, read_range

_MAX_BYTES = 64 * 2**20


@contextmanager
def copy_of(url: Url) -> Iterator[Path]:
    """Yield the path of a copy, which is removed afterwards; errors name the object.

    Raises
    ------
    InputError
        If there is no such object, or it is too large to be a configuration.
    """
    found = find_object(url)
    if found is None:
        raise InputError(f"{url}: no such object")
    if found.size > _MAX_BYTES:
        raise InputError(f"{url}: {found.size:,} bytes are too many for this kind of file")
    mirror = Mirror(url.parent)
    try:
        path = mirror.local(url)
        path.write_bytes(read_range(found, 0, found.size))
        with mirror.naming():
            yield path
    finally:
        mirror.folder.remove()
