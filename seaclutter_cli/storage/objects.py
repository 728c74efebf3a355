"""Objects in buckets: finding, listing, reading and writing them, by obstore.

The functions raise `InputError`, or `OutputError` for what writes, if there is no such bucket, no access, or an object
has changed since it was found.
"""

import io
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from seaclutter_cli.errors import InputError, OutputError
from seaclutter_cli.storage.stores import explained, store_of
from seaclutter_cli.storage.uploads import send
from seaclutter_cli.urls import Url

if TYPE_CHECKING:
    from obstore import GetOptions, ObjectMeta, WritableFile

_PART = 8 * 2**20
_MAX_PARTS = 9_000
_BLOCK = 64 * 2**10
_AT_ONCE = 4
"""Parts sent at once; these are still on their way when an object is completed."""


@dataclass(frozen=True)
class StoredObject:
    """An object as it was found: its size in bytes, and what identifies its content, if the service says so."""

    url: Url
    size: int
    etag: str | None


def find_object(url: Url) -> StoredObject | None:
    """Return an object; None if there is none."""
    with explained(url):
        store = store_of(url)
        try:
            return _stored(url, store.head(url.key)) if url.key else None
        except FileNotFoundError:
            next(iter(store.list(url.key)), None)  # says if there is no bucket
            return None


def list_objects(folder: Url) -> Iterator[StoredObject]:
    """Yield the objects in a folder and its subfolders, in the order in which the service lists them."""
    with explained(folder):
        for batch in store_of(folder).list(folder.key):
            for meta in batch:
                yield _stored(Url(folder.scheme, folder.bucket, meta["path"]), meta)


def list_folder(folder: Url) -> tuple[list[StoredObject], list[Url]]:
    """Return the objects and the folders directly in a folder."""
    with explained(folder):
        found = store_of(folder).list_with_delimiter(folder.key or None)
    folders = [Url(folder.scheme, folder.bucket, name) for name in found["common_prefixes"]]
    return [_stored(Url(folder.scheme, folder.bucket, meta["path"]), meta) for meta in found["objects"]], folders


def _stored(url: Url, meta: "ObjectMeta") -> StoredObject:
    return StoredObject(url, meta["size"], meta["e_tag"])


def delete_object(url: Url) -> None:
    """Delete an object, if there is one."""
    with explained(url, OutputError), suppress(FileNotFoundError):
        store_of(url).delete(url.key)


def read_range(found: StoredObject, start: int, stop: int) -> bytes:
    """Return bytes of an object; fewer at its end."""
    stop = min(stop, found.size)
    if stop <= start:
        return b""
    with explained(found.url):
        result = store_of(found.url).get(found.url.key, options=range_options(found, start, stop))
        data = bytes(result.bytes())
    if len(data) != stop - start or result.meta["size"] != found.size:
        raise InputError(f"{found.url}: the object changed while it was read")
    return data


def open_object(found: StoredObject) -> BinaryIO:
    """Return an object as a file that fetches only what is read, 64 KiB or more at a time."""
    return io.BufferedReader(_Ranges(found), _BLOCK)


class _Ranges(io.RawIOBase):
    """An object as an unbuffered file."""

    def __init__(self, found: StoredObject) -> None:
        self._found, self._position = found, 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET, /) -> int:
        self._position = max(offset + {io.SEEK_CUR: self._position, io.SEEK_END: self._found.size}.get(whence, 0), 0)
        return self._position

    def readinto(self, buffer: Any, /) -> int:
        data = read_range(self._found, self._position, self._position + len(buffer))
        buffer[: len(data)] = data
        self._position += len(data)
        return len(data)


def range_options(found: StoredObject, start: int, stop: int) -> "GetOptions":
    """Return the options of a request for a range of the object as it was found."""
    options: GetOptions = {"range": (start, stop)}
    if found.etag:
        options["if_match"] = found.etag
    return options


class Upload:
    """A complete file, or folder of files, on its way to object storage; nobody sees it before `complete`.

    ``last`` is the file that shows that the folder is complete. `OutputError` if it cannot be sent; nothing is left of
    it then.
    """

    def __init__(self, part: Path, url: Url, last: str) -> None:
        self._url, self._is_folder = url, part.is_dir()
        self._writers: dict[Url, WritableFile] = {}
        files = sorted(part.iterdir(), key=lambda file: (file.name == last, file.name)) if self._is_folder else [part]
        try:
            for file in files:
                self._send(file, url / file.name if self._is_folder else url)
        except OSError as error:
            self.abort()
            raise OutputError(f"{url}: the copy in the scratch folder cannot be read ({error.strerror})") from error
        except BaseException:
            self.abort()
            raise

    def _send(self, file: Path, url: Url) -> None:
        part = max(_PART, -(-file.stat().st_size // _MAX_PARTS))
        with explained(url, OutputError):
            from obstore import open_writer

            self._writers[url] = open_writer(store_of(url), url.key, buffer_size=part, max_concurrency=_AT_ONCE)
        send(file, url, self._writers[url])

    def complete(self) -> None:
        """Let the files appear, and delete all others in their folder.

        The last file is deleted first and appears last, so a folder that has it is never a mixture of two.
        """
        *others, last = self._writers
        earlier = {found.url for found in list_objects(self._url)} - set(others) if self._is_folder else set()
        if last in earlier:
            delete_object(last)
        for url in others:
            self._complete(url)
        for url in sorted(earlier - {last}):
            delete_object(url)
        self._complete(last)

    def _complete(self, url: Url) -> None:
        with explained(url, OutputError):
            self._writers.pop(url).close()

    def abort(self) -> None:
        """Discard the data, also those that the service has received."""
        error = InterruptedError()
        while self._writers:
            with suppress(Exception):
                self._writers.popitem()[1].__exit__(type(error), error, None)
