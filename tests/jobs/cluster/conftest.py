"""A scheduler and three workers with TLS, as processes of their own."""

import sys
from contextlib import contextmanager

import pytest

from tests.folders import in_folder
from tests.jobs.cluster.clusters import Certificates, Cluster, wait_for

NAMES = ("one", "two", "three")


@pytest.fixture(autouse=True)
def _often(monkeypatch):
    """Let the engine look for workers more often than once a second, and warn of none only where a test says so."""
    monkeypatch.setattr("seaclutter_cli.jobs.cluster.engine._LOOK_S", 0.1)
    monkeypatch.setattr("seaclutter_cli.jobs.cluster.engine._WARN_S", 600.0)


def _require_system():
    pytest.importorskip("distributed")
    if sys.platform == "win32":
        pytest.skip("no SIGKILL")


@contextmanager
def _started(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cluster")
    started = Cluster(folder / "run", Certificates(folder / "certificates"))
    try:
        for name in NAMES:
            started.add(name)
        with started.client() as client:
            wait_for(lambda: len(client.scheduler_info(n_workers=-1)["workers"]) == len(NAMES))
        yield started
    finally:
        started.end()


@pytest.fixture
def cluster(request, tmp_path_factory):
    """Return the cluster of the tests of this folder in this process."""
    _require_system()
    return in_folder(request, __file__, _started, tmp_path_factory)


@pytest.fixture
def certified(cluster, monkeypatch):
    """Set the environment of a user who has a certificate, and return the cluster."""
    for name, path in cluster.certificates.environment().items():
        monkeypatch.setenv(name, path)
    with cluster.client() as client:
        wait_for(lambda: len(client.scheduler_info(n_workers=-1)["workers"]) == len(NAMES))
    return cluster


@pytest.fixture
def own_cluster(tmp_path, monkeypatch):
    """Return a cluster without workers for one test."""
    _require_system()
    certificates = Certificates(tmp_path / "certificates")
    for name, path in certificates.environment().items():
        monkeypatch.setenv(name, path)
    started = Cluster(tmp_path / "cluster", certificates)
    yield started
    started.end()


@pytest.fixture
def other_version(tmp_path):
    """Return a function that makes a folder with packages, where one seems to have another version."""

    def make(name, version):
        info = tmp_path / "packages" / f"{name}-{version}.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
        return str(info.parent)

    return make
