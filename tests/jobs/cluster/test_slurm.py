"""Workers in jobs of a real SLURM on this machine; skipped where it cannot be started."""

import os
import signal
import subprocess
import sys
from importlib.util import find_spec

import pytest

from tests.jobs.cluster.clusters import ROOT, wait_for
from tests.logs import cloud_log
from tests.running import execute


def _require_jobqueue():
    """Skip without dask-jobqueue; its import would replace the handler of Ctrl-C for the tests after this one."""
    if find_spec("dask_jobqueue") is None:
        pytest.skip("dask-jobqueue is not installed")


@pytest.fixture(scope="module")
def slurm(tmp_path_factory):
    _require_jobqueue()
    pytest.importorskip("psutil")
    from tests.jobs.cluster import slurm as module

    if reason := module.obstacle():
        pytest.skip(reason)
    started = module.Slurm(tmp_path_factory.mktemp("slurm"))
    yield started
    started.end()


@pytest.fixture
def user(slurm, tmp_path, monkeypatch):
    """Set the environment of a user of SLURM, and return the folder for their keys."""
    home = tmp_path / "home"
    home.mkdir()
    monkeypatch.setenv("SLURM_CONF", str(slurm.configuration))
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.chdir(tmp_path)
    for name in ("CA", "CERT", "KEY"):
        monkeypatch.delenv(f"SEACLUTTER_TLS_{name}", raising=False)
    return home


@pytest.fixture(scope="module")
def trial(tmp_path_factory):
    folder = tmp_path_factory.mktemp("trial")
    (folder / "logs").mkdir()
    for number in range(12):
        cloud_log(folder / "logs" / f"r{number:02}.mcap", frames=40, points=3000)
    line = ["filter", str(folder / "logs"), "-o", f"{folder / 'out'}/", "-j", "1"]
    execute(*line, code=0)
    return folder


def start(trial, folder):
    line = [sys.executable, "-m", "seaclutter_cli", "filter", str(trial / "logs"), "-o", f"{folder / 'out'}/"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(
        [*line, "--cluster", "slurm", "-j", "2"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    )


def outputs(folder):
    return {path.name: path.read_bytes() for path in (folder / "out").iterdir()}


def test_the_same_results_although_a_job_is_cancelled(slurm, user, trial, tmp_path):
    process = start(trial, tmp_path)
    wait_for(lambda: list((tmp_path / "out").glob("*.mcap")))
    keys = list(user.glob(".dask-jobqueue*"))
    assert {path.stat().st_mode & 0o777 for path in keys} == {0o600}
    slurm.ask("scancel", slurm.jobs()[0])
    output, errors = process.communicate()
    assert output.startswith("12 done; "), errors
    assert "Warning: To route" not in errors
    assert outputs(tmp_path) == outputs(trial)
    wait_for(lambda: not slurm.jobs())
    assert not list(user.glob(".dask-jobqueue*")), "keys of the run"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["home", "out"]


def test_an_interrupt_cancels_the_jobs(slurm, user, trial, tmp_path):
    process = start(trial, tmp_path)
    wait_for(lambda: list((tmp_path / "out").glob("*.mcap")))
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate()
    assert process.returncode == 130
    assert errors.splitlines()[-1].startswith("Interrupted")
    wait_for(lambda: not slurm.jobs())
    assert all(outputs(trial)[name] == data for name, data in outputs(tmp_path).items())
    assert not list(user.glob(".dask-jobqueue*")), "keys of the run"


def test_jobs_that_slurm_refuses(user, trial, tmp_path, monkeypatch):
    dask = pytest.importorskip("dask")
    line = ["filter", str(trial / "logs"), "-o", f"{tmp_path / 'out'}/", "--cluster", "slurm", "-j", "2"]
    with dask.config.set({"jobqueue.slurm.queue": "no-such-partition"}):
        result = execute(*line)
    assert result.exit_code == 1
    (error,) = result.stderr.splitlines()
    assert error.startswith("Error: slurm: ")
    assert "artition" in error


def test_without_slurm(tmp_path, monkeypatch):
    _require_jobqueue()
    (tmp_path / "logs").mkdir()
    for name in "ab":
        cloud_log(tmp_path / "logs" / f"{name}.mcap", frames=1, points=1)
    monkeypatch.setenv("PATH", str(tmp_path))
    line = ["filter", str(tmp_path / "logs"), "-o", f"{tmp_path / 'out'}/", "--cluster", "slurm", "-j", "2"]
    result = execute(*line, code=1)
    assert result.stderr == (
        "Error: slurm: there is no command sbatch here; run seaclutter on a login node of the cluster\n"
    )
