"""Objects in buckets: access with the credentials of the environment and of profiles; finding, reading and writing.

The functions raise `InputError`, or `OutputError` for what writes, if there is no such bucket, no access, or an object
has changed since it was found. An error of object storage becomes one line with the URL and the cause, without secrets.
"""

import io
import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TypeVar
from urllib.parse import urlsplit

from seaclutter_cli.errors import InputError, OutputError, SeaclutterError, UsageError, opening, requiring
from seaclutter_cli.threads import waited
from seaclutter_cli.urls import WEB, Url

if TYPE_CHECKING:
    from obstore import GetOptions, ObjectMeta, WritableFile
    from obstore.store import AzureStore, GCSStore, HTTPStore, RetryConfig, S3Store

    Store = S3Store | GCSStore | AzureStore | HTTPStore

R = TypeVar("R")

NO_CREDENTIALS = {
    "s3": "no credentials found; set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE (needs boto3)",
    "gs": "no credentials found; set GOOGLE_APPLICATION_CREDENTIALS, or run gcloud auth application-default login",
    "az": "no credentials found; set AZURE_STORAGE_ACCOUNT_KEY or AZURE_STORAGE_SAS_TOKEN",
}
"""What to do, by scheme."""

_CODE = re.compile(r"<Code>(\w{1,60})</Code>")
_STATUS = re.compile(r"status code: (\d{3}(?: [A-Z][A-Za-z ]{1,40})?)")
_METADATA_SERVICE = re.compile(r"169\.254\.|metadata\.google\.internal|fd00:ec2")
_OTHER_REGION = ("PermanentRedirect", "AuthorizationHeaderMalformed", "IllegalLocationConstraintException")
_UNKNOWN_CREDENTIALS = ("InvalidAccessKeyId", "SignatureDoesNotMatch", "ExpiredToken", "InvalidToken")
_PREFIXES = ("AWS_", "GOOGLE_", "AZURE_")
_SENT = re.compile(r"(AWS|AZURE)_.*(KEY|TOKEN|SECRET|ENDPOINT|REGION)")
"""Names of settings that go into requests."""

_TIMEOUTS = {"timeout": "10 minutes", "read_timeout": "30 seconds"}
"""Of a request as a whole, and of its silence. A slow link is no error."""

RETRIES: "RetryConfig" = {}
"""How obstore repeats requests; empty for its defaults: 10 times, for up to 3 minutes."""


def store_of(url: Url) -> "Store":
    """Return the client for the bucket of a URL; call it within `explained`.

    Raise `UsageError` if settings in the environment are not valid, or a profile needs boto3.
    """
    settings = tuple(sorted(item for item in os.environ.items() if item[0].startswith(_PREFIXES)))
    return open_store(url.scheme, url.bucket, settings)


@lru_cache
def open_store(scheme: str, bucket: str, given: tuple[tuple[str, str], ...]) -> "Store":
    """Return a client for the settings in the environment, the last argument; see `store_of`."""
    from obstore.exceptions import BaseError
    from obstore.store import AzureStore, GCSStore, HTTPStore, S3Store

    if wrong := next((name for name, value in given if _is_wrong(name, value)), None):
        raise UsageError(f"{scheme}://{bucket}: {wrong} in the environment is not valid")
    settings: Any = {**_TIMEOUTS, "retry_config": RETRIES}
    try:
        if scheme in WEB:
            options: Any = {**_TIMEOUTS, "allow_http": scheme == "http"}
            return HTTPStore(f"{scheme}://{bucket}", client_options=options, retry_config=RETRIES)
        if scheme == "gs":
            return GCSStore(bucket, **settings)
        if scheme == "az":
            return AzureStore(bucket, **settings)
        return S3Store(bucket, credential_provider=_profile(bucket), **settings)
    except (BaseError, ValueError) as error:
        # The text of the error may contain settings, the name of its class never does.
        problem = "no storage account; set AZURE_STORAGE_ACCOUNT_NAME" if "Account" in str(error) else "not valid"
        raise UsageError(f"{scheme}://{bucket}: settings in the environment: {problem}") from None


def _is_wrong(name: str, value: str) -> bool:
    """Return whether obstore would panic at a setting."""
    if not _SENT.match(name):
        return False
    if not value.isascii() or not value.isprintable():
        return True
    if "ENDPOINT" not in name:
        return False
    with suppress(ValueError):
        place = urlsplit(value)
        return not place.hostname or place.port == 0 or " " in value
    return True


def _profile(bucket: str) -> Any:
    """Return the credentials of ~/.aws as boto3 finds them; None if those in the environment apply."""
    name = os.environ.get("AWS_PROFILE")
    if "AWS_ACCESS_KEY_ID" in os.environ or "AWS_SKIP_SIGNATURE" in os.environ:
        return None
    if find_spec("boto3") is None:
        if name:
            raise UsageError(f"AWS_PROFILE={name}: profiles need boto3: pip install boto3")
        return None
    import boto3
    from botocore.exceptions import BotoCoreError
    from obstore.auth.boto3 import Boto3CredentialProvider

    try:
        session = boto3.Session()
        if session.get_credentials() is None:
            raise UsageError(f"s3://{bucket}: {NO_CREDENTIALS['s3']}")
        return Boto3CredentialProvider(session)
    except BotoCoreError as error:
        raise UsageError(f"AWS_PROFILE={name or 'default'}: cannot be used ({type(error).__name__})") from None


@contextmanager
def explained(url: Url, kind: type[SeaclutterError] = InputError) -> Iterator[None]:
    """Turn errors of object storage into errors of a kind; `MissingExtraError` without the extra ``cloud``.

    The original errors are dropped, also from tracebacks: their texts may contain signed URLs.
    """
    with requiring(f"{url.scheme}://", "cloud"):
        from obstore.exceptions import BaseError
    try:
        yield
    except (BaseError, OSError, ValueError) as error:  # writers raise an OSError
        raise kind(f"{url}: {cause(error, url)}") from None
    except BaseException as error:
        if type(error).__name__ != "PanicException":  # it is no Exception, and has no place to import it from
            raise
        raise kind(f"{url}: object storage failed; check the settings in the environment") from None


def cause(error: Exception, url: Url) -> str:
    """Return the cause of an error of object storage, without anything secret."""
    from obstore import exceptions

    text = str(error)
    code, status = _found(_CODE, text), _found(_STATUS, text)
    refused = code in _UNKNOWN_CREDENTIALS or isinstance(error, exceptions.UnauthenticatedError)
    denied = isinstance(error, exceptions.PermissionDeniedError) or status.startswith("403")
    rules = (
        (code in ("NoSuchBucket", "ContainerNotFound"), f"there is no bucket {url.bucket}"),
        ("configured region" in text or code in _OTHER_REGION, "the bucket is in another region; set AWS_REGION"),
        (_METADATA_SERVICE.search(text), NO_CREDENTIALS.get(url.scheme, "")),
        (refused, f"the credentials are not accepted ({code or status or 'not authenticated'})"),
        (denied, "access denied"),
        (isinstance(error, FileNotFoundError), "no such object"),
        (isinstance(error, exceptions.PreconditionError), "the object changed while it was read"),
        (status, f"the server answered {status}{f', {code}' if code else ''}"),
        ("Range request not supported" in text, "the server sends no parts of files; download it first"),
        ("builder error" in text, "the address is not HTTPS; AWS_ALLOW_HTTP=true permits HTTP"),
        ("HTTP error" in text, "the server cannot be reached, or the connection broke off again and again"),
        (True, f"object storage failed ({type(error).__name__})"),
    )
    return next(problem for applies, problem in rules if applies)


def _found(pattern: re.Pattern[str], text: str) -> str:
    found = pattern.search(text)
    return found[1].strip() if found else ""


MAX_OBJECTS = 100_000
"""Objects in a listing."""
_MAX_BYTES = 2**48
_ANSWER_S = 240.0

_PART = 8 * 2**20
_PIECE = 4 * 2**20
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
            return _stored(url, _answer(url, lambda: store.head(url.key))) if url.key else None
        except FileNotFoundError:
            if url.scheme not in WEB:
                _answer(url, lambda: next(iter(store.list(url.key)), None))  # says if there is no bucket
            return None


def list_objects(folder: Url) -> Iterator[StoredObject]:
    """Yield the objects in a folder and its subfolders as the service lists them, which a web server does not."""
    number = 0
    if folder.scheme in WEB:
        return
    with explained(folder):
        batches = iter(store_of(folder).list(folder.key))
        while batch := _answer(folder, lambda: next(batches, None)):
            number += len(batch)
            _require_few(folder, number)
            for meta in batch:
                yield _stored(Url(folder.scheme, folder.bucket, meta["path"]), meta)


def list_folder(folder: Url) -> tuple[list[StoredObject], list[Url]]:
    """Return the objects and the folders directly in a folder; none of a web server."""
    if folder.scheme in WEB:
        return [], []
    with explained(folder):
        found = _answer(folder, lambda: store_of(folder).list_with_delimiter(folder.key or None))
    _require_few(folder, len(found["objects"]) + len(found["common_prefixes"]))
    folders = [Url(folder.scheme, folder.bucket, name) for name in found["common_prefixes"]]
    return [_stored(Url(folder.scheme, folder.bucket, meta["path"]), meta) for meta in found["objects"]], folders


def _stored(url: Url, meta: "ObjectMeta") -> StoredObject:
    if meta["size"] > _MAX_BYTES:
        raise InputError(f"{url}: the service says {meta['size']:,} bytes, which no object has")
    is_weak = (meta["e_tag"] or "").startswith("W/")  # no condition of a request for a range
    return StoredObject(url, meta["size"], None if is_weak else meta["e_tag"])


def _require_few(folder: Url, number: int) -> None:
    if number > MAX_OBJECTS:
        raise InputError(f"{folder}: more than {MAX_OBJECTS:,} objects; name a folder or pattern with fewer")


def _answer(url: Url, request: Callable[[], R]) -> R:
    """Return the answer to a request, from a thread, so that Ctrl-C ends the wait; `InputError` if it takes long."""
    try:
        return waited(request, _ANSWER_S)
    except TimeoutError:
        problem = f"the server gives no complete answer within {_ANSWER_S:.0f} seconds"
        raise InputError(f"{url}: {problem}") from None


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
        options: GetOptions = {"range": (start, stop), **({"if_match": found.etag} if found.etag else {})}
        result = store_of(found.url).get(found.url.key, options=options)
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
            with opening(url, OutputError, "the copy in the scratch folder cannot be read"):
                for file in files:
                    self._send(file, url / file.name if self._is_folder else url)
        except BaseException:
            self.abort()
            raise

    def _send(self, file: Path, url: Url) -> None:
        part = max(_PART, -(-file.stat().st_size // _MAX_PARTS))
        with explained(url, OutputError):
            from obstore import open_writer

            writer = open_writer(store_of(url), url.key, buffer_size=part, max_concurrency=_AT_ONCE)
        self._writers[url] = writer
        with file.open("rb") as stream:
            while piece := stream.read(_PIECE):  # unlike `complete`, this may be interrupted
                with explained(url, OutputError):
                    writer.write(piece)

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
