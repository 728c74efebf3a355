"""Access to buckets, with the credentials of the environment and of profiles.

An error of object storage becomes one line with the URL and the cause, without secrets.
"""

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from seaclutter_cli.errors import InputError, MissingExtraError, SeaclutterError, UsageError
from seaclutter_cli.urls import Url

if TYPE_CHECKING:
    from obstore.store import AzureStore, GCSStore, RetryConfig, S3Store

    Store = S3Store | GCSStore | AzureStore

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
def open_store(scheme: str, bucket: str, _: object) -> "Store":
    """Return a client for the settings in the environment, the last argument; see `store_of`."""
    from obstore.exceptions import BaseError
    from obstore.store import AzureStore, GCSStore, S3Store

    settings: Any = {**_TIMEOUTS, "retry_config": RETRIES}
    try:
        if scheme == "gs":
            return GCSStore(bucket, **settings)
        if scheme == "az":
            return AzureStore(bucket, **settings)
        return S3Store(bucket, credential_provider=_profile(bucket), **settings)
    except (BaseError, ValueError) as error:
        # The text of the error may contain settings, the name of its class never does.
        problem = "no storage account; set AZURE_STORAGE_ACCOUNT_NAME" if "Account" in str(error) else "not valid"
        raise UsageError(f"{scheme}://{bucket}: settings in the environment: {problem}") from None


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
