"""Connections to clusters: Dask's client, certificates, causes of failures."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from ssl import SSLError
from typing import TYPE_CHECKING, Any

from seaclutter_cli.errors import MissingExtraError, UsageError

if TYPE_CHECKING:
    from distributed.security import Security

FILES = {"ca_file": "SEACLUTTER_TLS_CA", "client_cert": "SEACLUTTER_TLS_CERT", "client_key": "SEACLUTTER_TLS_KEY"}
"""Environment variables with the paths of certificates, by their names in Dask."""

CONNECT_S = 10
"""Time in seconds to connect, and to close a connection."""


def client_class() -> Any:
    """Return the class of Dask's client; raise `MissingExtraError` if the extra ``cluster`` is not installed."""
    try:
        from distributed import Client
    except ImportError as error:
        raise MissingExtraError("--cluster", "cluster") from error
    return Client


@contextmanager
def closing(client: Any) -> Iterator[Any]:
    """Close a client at the end of the context, also if the cluster is gone."""
    try:
        yield client
    finally:
        client.close(timeout=CONNECT_S)


def certificates(*, required: bool) -> "Security | None":
    """Return the certificates of the environment, or else of Dask's configuration; None if there are none.

    Raises
    ------
    UsageError
        If they are required and missing, or cannot be read.
    """
    from distributed.security import Security

    given = {f"tls_{name}": os.environ[variable] for name, variable in FILES.items() if os.environ.get(variable)}
    for role in ("scheduler", "worker"):  # for a scheduler in this process and its workers
        given |= {
            f"tls_{role}_{kind}": given[f"tls_client_{kind}"]
            for kind in ("cert", "key")
            if f"tls_client_{kind}" in given
        }
    security = Security(require_encryption=True, **given)
    missing = [FILES[name] for name in ("ca_file", "client_cert") if getattr(security, f"tls_{name}") is None]
    if missing:
        if not required and not given:
            return None
        raise UsageError(f"tls://: certificates are missing; set {' and '.join(missing)}, or Dask's configuration")
    try:
        security.get_connection_args("client")
    except OSError as error:  # also SSLError
        files = ", ".join(str(getattr(security, f"tls_{name}")) for name in FILES if getattr(security, f"tls_{name}"))
        raise UsageError(
            f"{files}: cannot be used as certificates ({error.strerror or type(error).__name__})"
        ) from error
    return security


def cause(error: BaseException) -> str:
    """Return the text of the first error in a chain: those that follow only repeat addresses."""
    while error.__cause__ is not None:
        error = error.__cause__
    if isinstance(error, SSLError):
        return f"TLS: {error.reason or 'failed'}".replace("_", " ").lower()
    text = str(getattr(error, "strerror", None) or error).strip()
    return text.splitlines()[0] if text else "no answer"
