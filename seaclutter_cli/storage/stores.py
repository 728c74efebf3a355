"""Access to buckets, with the credentials of the environment and of profiles."""

import os
from functools import lru_cache
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from seaclutter_cli.errors import MissingExtraError, UsageError
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

_PREFIXES = ("AWS_", "GOOGLE_", "AZURE_")
_TIMEOUTS = {"timeout": "10 minutes", "read_timeout": "30 seconds"}
"""Of a request as a whole, and of its silence. A slow link is no error."""

RETRIES: "RetryConfig" = {}
"""How obstore repeats requests; empty for its defaults: 10 times, for up to 3 minutes."""


def store_of(url: Url) -> "Store":
    """Return the client for the bucket of a URL.

    Raises
    ------
    MissingExtraError
        If the extra ``cloud`` is not installed.
    UsageError
        If settings in the environment are not valid, or a profile needs boto3.
    """
    settings = tuple(sorted(item for item in os.environ.items() if item[0].startswith(_PREFIXES)))
    return open_store(url.scheme, url.bucket, settings)


@lru_cache
def open_store(scheme: str, bucket: str, _: object) -> "Store":
    """Return a client for the settings in the environment, the last argument; see `store_of`."""
    try:
        from obstore.exceptions import BaseError
        from obstore.store import AzureStore, GCSStore, S3Store
    except ImportError as error:
        raise MissingExtraError(f"{scheme}://", "cloud") from error
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
