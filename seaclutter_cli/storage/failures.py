"""Errors of object storage as errors of the program: one line with the URL and the cause, without secrets."""

import re
from collections.abc import Iterator
from contextlib import contextmanager

from seaclutter_cli.errors import InputError, MissingExtraError, SeaclutterError
from seaclutter_cli.storage.stores import NO_CREDENTIALS
from seaclutter_cli.urls import Url

_CODE = re.compile(r"<Code>(\w{1,60})</Code>")
_STATUS = re.compile(r"status code: (\d{3}(?: [A-Z][A-Za-z ]{1,40})?)")
_METADATA_SERVICE = re.compile(r"169\.254\.|metadata\.google\.internal|fd00:ec2")
_OTHER_REGION = ("PermanentRedirect", "AuthorizationHeaderMalformed", "IllegalLocationConstraintException")
_UNKNOWN_CREDENTIALS = ("InvalidAccessKeyId", "SignatureDoesNotMatch", "ExpiredToken", "InvalidToken")


@contextmanager
def explained(url: Url, kind: type[SeaclutterError] = InputError) -> Iterator[None]:
    """Turn errors of object storage into errors of a kind.

    The original errors are dropped, also from tracebacks: their texts may contain signed URLs.

    Raises
    ------
    SeaclutterError
        Of the given kind.
    MissingExtraError
        If the extra ``cloud`` is not installed.
    """
    try:
        from obstore.exceptions import BaseError
    except ImportError as error:
        raise MissingExtraError(f"{url.scheme}://", "cloud") from error
    try:
        yield
    except (BaseError, OSError, ValueError) as error:  # writers raise an OSError
        raise kind(f"{url}: {cause(error, url)}") from None


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
        (_METADATA_SERVICE.search(text), NO_CREDENTIALS[url.scheme]),
        (refused, f"the credentials are not accepted ({code or status or 'not authenticated'})"),
        (denied, "access denied"),
        (isinstance(error, FileNotFoundError), "no such object"),
        (isinstance(error, exceptions.PreconditionError), "the object changed while it was read"),
        (status, f"the server answered {status}{f', {code}' if code else ''}"),
        ("builder error" in text, "the address is not HTTPS; AWS_ALLOW_HTTP=true permits HTTP"),
        ("HTTP error" in text, "the server cannot be reached, or the connection broke off again and again"),
        (True, f"object storage failed ({type(error).__name__})"),
    )
    return next(problem for applies, problem in rules if applies)


def _found(pattern: re.Pattern[str], text: str) -> str:
    found = pattern.search(text)
    return found[1].strip() if found else ""
