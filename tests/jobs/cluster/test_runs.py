"""Whole runs on a cluster: the same bytes as here, and one line for what goes wrong."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
from contextlib import contextmanager

import pytest

from seaclutter_cli.jobs.cluster import connection
from tests.jobs.cluster.clusters import ROOT, Certificates, wait_for
from tests.logs import cloud_log
from tests.running import execute

SECRET = "wJalrXUtnFEMI-K7MDENG-secret"


@pytest.fixture(scope="module")
def trial(tmp_path_factory):
    """Return a folder with 40 recordings and one that cannot be read, and the results of a run here."""
    folder = tmp_path_factory.mktemp("trial")
    (folder / "logs").mkdir()
    for number in range(40):
        cloud_log(folder / "logs" / f"r{number:02}.mcap", frames=12 + number % 5, points=800)
    (folder / "logs" / "x.mcap").write_bytes(b"no log")
    result = run(folder / "logs", folder, "-j", "1")
    assert result.exit_code == 1
    return folder


def run(logs, folder, *options):
    line = ["filter", str(logs), "-o", f"{folder / 'out'}/", "--csv", str(folder / "frames.csv")]
    line += ["--manifest", str(folder / "runs.json"), "--log-file", str(folder / "run.log")]
    return execute(*line, *options)


def files(folder):
    found = {path.name: path.read_bytes() for path in (folder / "out").iterdir()}
    return found, (folder / "frames.csv").read_bytes()


@contextmanager
def killing(cluster, name, output, times):
    """Kill a worker each time that it writes; the others pause until it writes again. Yield the list of the killed."""
    killed, stop = [], threading.Event()
    thread = threading.Thread(target=_kill, args=(cluster, name, output, times, killed, stop))
    thread.start()
    try:
        yield killed
    finally:
        stop.set()
        thread.join()


def _kill(cluster, name, output, times, killed, stop):
    others = [process for other in cluster.workers - {name} for process in cluster.processes_of(other)]
    try:
        while len(killed) < times and not stop.wait(0.01):
            for process in cluster.processes_of(name):
                if process.pid not in killed and any(output.glob(f".r*-{process.pid}-*.part")):
                    process.kill()
                    killed.append(process.pid)
                    for other in others:
                        other.suspend()
    finally:
        for other in others:
            other.resume()


def test_a_worker_that_is_killed_again_and_again_changes_nothing(certified, trial, tmp_path, monkeypatch):
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", SECRET)
    with killing(certified, "two", tmp_path / "out", 3) as killed:
        result = run(trial / "logs", tmp_path, "--cluster", certified.address)
    assert result.exit_code == 1, "one recording cannot be read"
    assert result.stdout.startswith("40 done, 1 failed; ")
    assert len(set(killed)) == 3
    assert files(tmp_path) == files(trial), "and nothing incomplete"
    written = [path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()]
    key = (certified.certificates.folder / "key.pem").read_text().splitlines()[1]
    for secret in (SECRET, key):
        assert secret not in result.output
        assert secret not in certified.logs()
        assert not any(secret.encode() in data for data in written)


LABELLED = ["LOGS", "--labels", "LOGS"]
COMMANDS = {
    "evaluate": (["evaluate", *LABELLED, "-o", "OUT/frames.csv"], "OUT/frames.csv"),
    "calibrate": (["calibrate", *LABELLED, "-o", "OUT/config.yaml"], "OUT/config.yaml"),
    "tune": (["tune", *LABELLED, "--sweep", "filter.update_weight=0.2,0.8", "-o", "OUT/best.yaml"], "OUT/best.yaml"),
    "info": (["info", "LOGS", "--json"], None),
    "simulate": (["simulate", "calm", "--seeds", "1,2", "-n", "2", "-o", "OUT/"], "OUT/calm_2.mcap"),
}


@pytest.fixture(scope="module")
def labelled(tmp_path_factory):
    folder = tmp_path_factory.mktemp("labelled")
    for seed in ("1", "2"):
        line = ["simulate", "passing_speedboat", "-o", str(folder / f"s{seed}.mcap"), "--seed", seed, "-n", "4", "-q"]
        execute(*line, code=0)
    return folder


@pytest.mark.parametrize("command", COMMANDS)
def test_other_commands_give_the_same(certified, labelled, tmp_path, command):
    words, file = COMMANDS[command]
    found = []
    for options in (["-j", "1"], ["--cluster", certified.address]):
        folder = tmp_path / str(len(found))
        folder.mkdir()
        named = {"LOGS": str(labelled), "OUT": str(folder)}
        line = [word.replace(key, path) for word in words for key, path in [_named(word, named)]]
        result = execute(*line, *options, code=0)
        found.append((folder / file.removeprefix("OUT/")).read_bytes() if file else result.stdout)
    assert found[0] == found[1]


def _named(word, named):
    return next((pair for pair in named.items() if word.startswith(pair[0])), ("", ""))


def test_a_single_recording_also_runs_there(certified, trial, tmp_path):
    target = tmp_path / "one.mcap"
    line = ["filter", str(trial / "logs" / "r03.mcap"), "-o", str(target), "--cluster", certified.address]
    execute(*line, code=0)
    assert target.read_bytes() == (trial / "out" / "r03.mcap").read_bytes()


@pytest.mark.parametrize("kind", ["no certificate", "foreign certificate", "no encryption"])
def test_nobody_is_let_in_without_a_certificate(cluster, trial, tmp_path, monkeypatch, kind):
    address, options, status = cluster.address, [], 2
    if kind == "foreign certificate":
        foreign = Certificates(tmp_path / "foreign").environment()
        own = cluster.certificates.environment()
        for name, path in {**foreign, "SEACLUTTER_TLS_CA": own["SEACLUTTER_TLS_CA"]}.items():
            monkeypatch.setenv(name, path)
        status = 1
    elif kind == "no encryption":
        address, options, status = address.replace("tls", "tcp"), ["--cluster-insecure"], 1
    result = run(trial / "logs", tmp_path, "--cluster", address, *options)
    assert result.exit_code == status
    assert len(result.stderr.splitlines()) == 1
    assert ("certificates are missing" if status == 2 else "no connection to a scheduler") in result.stderr
    assert not (tmp_path / "out").exists()


def test_a_worker_with_a_foreign_certificate_is_not_let_in(certified, tmp_path):
    certified.add("foreign", "--death-timeout=3", certificates=Certificates(tmp_path / "foreign"))
    wait_for(lambda: certified.processes["foreign"].poll() is not None)
    certified.end("foreign")
    with certified.client() as client:
        names = {worker["name"] for worker in client.scheduler_info(n_workers=-1)["workers"].values()}
    assert names == {"one", "two", "three"}


@pytest.mark.parametrize(
    ("address", "text"),
    [
        ("tcp://127.0.0.1:8786", "--cluster-insecure"),
        ("127.0.0.1:8786", "expected tls://HOST:PORT or slurm, got '127.0.0.1:8786'"),
        ("slurm", "requires the number of workers"),
        ("", "expected tls://HOST:PORT or slurm"),
        (f"tls://me:{SECRET}@host:8786", "expected tls://HOST:PORT or slurm"),
    ],
)
def test_addresses_that_are_refused(trial, tmp_path, address, text):
    result = run(trial / "logs", tmp_path, "--cluster", address)
    assert result.exit_code == 2
    assert text in result.stderr
    assert SECRET not in result.output
    assert not (tmp_path / "out").exists()


def test_encryption_is_not_needed_where_it_is_not_asked_for(trial, tmp_path, monkeypatch):
    """The scheduler is not reached, but the address is accepted."""
    monkeypatch.setattr(connection, "_CONNECT_S", 0.5)
    result = run(trial / "logs", tmp_path, "--cluster", "tcp://127.0.0.1:1", "--cluster-insecure")
    assert result.exit_code == 1
    assert "tcp://127.0.0.1:1: no connection to a scheduler" in result.stderr


def test_without_the_extra(trial, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    result = run(trial / "logs", tmp_path, "--cluster", "tls://127.0.0.1:8786")
    assert result.exit_code == 1
    assert "pip install 'seaclutter[cluster]'" in result.stderr


def test_certificates_that_cannot_be_read(trial, tmp_path, monkeypatch):
    for name in Certificates(tmp_path / "own").environment():
        monkeypatch.setenv(name, str(tmp_path / "missing.pem"))
    result = run(trial / "logs", tmp_path, "--cluster", "tls://127.0.0.1:8786")
    assert result.exit_code == 2
    assert "missing.pem: cannot be used as certificates (No such file or directory)" in result.stderr


def test_a_worker_with_other_versions_is_refused(own_cluster, other_version, trial, tmp_path):
    own_cluster.add("old", "--no-nanny", PYTHONPATH=other_version("seaclutter", "0.0.1"))
    result = run(trial / "logs", tmp_path, "--cluster", own_cluster.address)
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    assert re.fullmatch(rf"Error: {own_cluster.address}: worker tls://\S+ has seaclutter 0\.0\.1, here \S+", line)
    assert not (tmp_path / "out").exists()


def start(cluster, trial, folder, *options):
    """Start a run in a process of its own."""
    line = [sys.executable, "-m", "seaclutter_cli", "filter", str(trial / "logs"), "-o", f"{folder / 'out'}/"]
    line += ["--csv", str(folder / "frames.csv"), "--cluster", cluster.address, *options]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)


def test_a_scheduler_that_disappears(own_cluster, trial, tmp_path):
    own_cluster.add("one")
    process = start(own_cluster, trial, tmp_path)
    wait_for(lambda: len(list((tmp_path / "out").glob("*.mcap"))) >= 2)
    own_cluster.processes["scheduler"].kill()
    _, errors = process.communicate()
    assert process.returncode == 1
    failures = [line for line in errors.splitlines() if line.startswith("Error: ")]
    assert failures[-1].endswith("the connection to the scheduler is lost; outputs that are complete stay")
    assert len(failures) == 1
    assert "Traceback" not in errors
    wait_for(lambda: not list((tmp_path / "out").glob(".*.part")))
    expected, _ = files(trial)
    found = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    assert len(found) >= 2
    assert all(expected[name] == data for name, data in found.items())


def test_an_interrupt_leaves_nothing_incomplete(certified, trial, tmp_path):
    process = start(certified, trial, tmp_path)
    wait_for(lambda: list((tmp_path / "out").glob("*.mcap")))
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate()
    assert process.returncode == 130
    assert errors.splitlines()[-1].startswith("Interrupted")
    assert not list((tmp_path / "out").glob(".*.part"))
    assert not (tmp_path / "frames.csv").exists()
    expected, _ = files(trial)
    assert all(expected[path.name] == path.read_bytes() for path in (tmp_path / "out").iterdir())


def test_a_manifest_of_a_run_on_a_cluster(certified, trial, tmp_path):
    run(trial / "logs", tmp_path, "--cluster", certified.address)
    same = ("recording", "input", "status", "frames", "points_in", "points_out", "error")
    rows, expected = (json.loads((folder / "runs.json").read_text()) for folder in (tmp_path, trial))
    assert [[row[key] for key in same] for row in rows] == [[row[key] for key in same] for row in expected]
