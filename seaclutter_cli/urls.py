"""URLs of objects in S3, Google Cloud Storage and Azure, and of files on web servers."""

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Self, cast
from urllib.parse import unquote

from seaclutter_cli.errors import UsageError

WEB = ("https", "http")
"""Schemes of files on web servers, which list no folders and take no outputs."""
SCHEMES: Mapping[str, str] = {
    "s3": "Amazon S3",
    "gs": "Google Cloud Storage",
    "az": "Azure Blob Storage",
    **dict.fromkeys(WEB, "web server"),
}
"""Schemes of URLs, and the services they stand for."""

_URL = re.compile(r"(?P<scheme>[A-Za-z][A-Za-z0-9+.-]+)://(?P<rest>.*)", re.DOTALL)
_COLLAPSED = re.compile(rf"({'|'.join(SCHEMES)}):[/\\](?![/\\])")  # Path("s3://bucket/key")
_QUERY = re.compile(
    r"(\?|#|%3F|%23)[^/?]*(=|%3D)|&(X-(Amz|Goog)-\w+|sig|signature|AWSAccessKeyId|token)=", re.IGNORECASE
)
_MAX_LEVELS = 250
_BUCKET, _HOST = re.compile(r"[A-Za-z0-9$][A-Za-z0-9._-]*"), re.compile(r"[A-Za-z0-9][A-Za-z0-9.-]*(:[0-9]{1,5})?")


@dataclass(frozen=True, order=True)
class Url:
    """URL of an object, or of a folder of objects.

    ``bucket`` may be a container of Azure, or a host; ``key`` has no slashes at its ends, and is empty
    for the bucket.
    """

    scheme: str
    bucket: str
    key: str = ""

    def __str__(self) -> str:
        return f"{self.scheme}://{self.bucket}/{self.key}"

    def __truediv__(self, name: str) -> Self:
        return type(self)(self.scheme, self.bucket, f"{self.key}/{name}".removeprefix("/"))

    @property
    def suffix(self) -> str:
        """Suffix of the name, with its dot."""
        return PurePosixPath(self.key).suffix

    @property
    def parent(self) -> Self:
        """Folder of the object; that of a bucket is the bucket."""
        return type(self)(self.scheme, self.bucket, self.key.rpartition("/")[0])


PathLike = str | os.PathLike[str]
"""Path or URL as it is given."""


def place(text: str | os.PathLike[str]) -> Path:
    """Return a path; a valid URL stays one until a run makes it the path of a copy; or raise `UsageError`.

    See `parse_url` for errors of URLs. The working folder has the name ".", not an empty one.
    """
    if not isinstance(text, str | os.PathLike | Url):
        raise UsageError(f"{text!r}: not a path")
    if is_url(text):
        return cast("Path", parse_url(text))
    path = Path(text)
    try:
        is_possible = bool(os.fspath(text)) and b"\0" not in os.fsencode(path)
    except UnicodeEncodeError:
        is_possible = False
    if not is_possible or len(path.absolute().parts) > _MAX_LEVELS:
        raise UsageError(f"{os.fspath(text)!r:.200}: not a possible name of a file or folder")
    return path


def parse_url(text: str | os.PathLike[str] | Url) -> Url:
    """Return a URL from text; slashes at the end have no meaning here.

    Raise `UsageError` if it has an unknown scheme, no bucket, a key that no file can have, or contains credentials,
    which are not repeated in the message.
    """
    if isinstance(text, Url):
        return text
    given = os.fspath(text)
    found = _URL.fullmatch(_COLLAPSED.sub(r"\1://", given.replace("\\", "/")) if _COLLAPSED.match(given) else given)
    if found is None:
        raise UsageError(f"{given}: not a URL")
    scheme, rest = found["scheme"].lower(), found["rest"]
    shown = without_secrets(given)
    if shown != given:
        advice = "set credentials in the environment, or choose a profile"
        raise UsageError(f"{shown}: a URL must not contain credentials or a query; {advice}")
    if scheme not in SCHEMES:
        known = ", ".join(f"{name}:// ({service})" for name, service in SCHEMES.items())
        raise UsageError(f"{shown}: unknown kind of URL; known are {known}")
    bucket, _, key = rest.partition("/")
    key = key.rstrip("/")
    if scheme in WEB:
        if "?" in key or "#" in key:
            shown = re.split("[?#]", shown)[0]
            raise UsageError(f"{shown}: a URL must not contain a query or a fragment")
        key = unquote(key)
    if not (_HOST if scheme in WEB else _BUCKET).fullmatch(bucket):
        raise UsageError(f"{shown}: write it as {scheme}://{'HOST' if scheme in WEB else 'BUCKET'}/NAME")
    if key and any(part in ("", ".", "..") for part in key.split("/")):
        raise UsageError(f"{shown}: empty parts, . and .. are not possible in the name of an object")
    return Url(scheme, bucket, key)


def without_secrets(text: str) -> str:
    """Return a URL without user information and without its query."""
    if (found := _URL.fullmatch(text)) is None:
        return text
    host, slash, rest = found["rest"].partition("/")
    if "@" in host:
        host = f"…@{host.rpartition('@')[2]}"
    elif ":" in host and "@" in rest and not (found["scheme"].lower() in WEB and _HOST.fullmatch(host)):
        # A secret may contain slashes.
        host, slash, rest = "…@", "", rest.rpartition("@")[2]
    rest = f"{host}{slash}{rest}"
    if query := _QUERY.search(rest):
        rest = f"{rest[: query.start()]}?…"
    return f"{found['scheme']}://{rest}"


def is_url(text: str | os.PathLike[str] | Url) -> bool:
    """Return whether a text or path is a URL, of whatever scheme."""
    return isinstance(text, Url) or bool(_URL.fullmatch(os.fspath(text)) or _COLLAPSED.match(os.fspath(text)))
