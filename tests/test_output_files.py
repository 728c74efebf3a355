"""Failing output: full disks, interrupts and existing files; no partial files remain."""

import os
import signal
import subprocess
import sys
import time

import pytest

from tests.logs import (
    LAYOUTS,
    Layout,
    cloud_log,
    cloud_messages,
)
from tests.outcome import all_broken, log_of, read_whole
from tests.running import execute

FRAMES = 6


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Logs of six frames, each frame in its own chunk, as bytes."""
    path = tmp_path_factory.mktemp("logs") / "log.mcap"
    return {name: cloud_log(path, layout, frames=FRAMES).read_bytes() for name, layout in LAYOUTS.items()}


def names_in(folder):
    return sorted(path.name for path in folder.rglob("*"))


@pytest.fixture
def small_disk(tmp_path):
    """Return a mounted disk of 64 kB, or skip the test."""
    folder = tmp_path / "disk"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", folder]
    if sys.platform != "linux" or subprocess.run(command, capture_output=True, check=False).returncode:
        pytest.skip("no permission to mount a small disk")
    yield folder
    subprocess.run(["umount", folder], check=True)


def test_a_full_disk(tmp_path, small_disk):
    log = cloud_log(tmp_path / "log.mcap", LAYOUTS["none"], frames=30)
    result = execute("filter", log, "-o", small_disk / "out.mcap", code=1)
    assert (
        result.stderr.splitlines()[-1]
        == f"Error: {small_disk / 'out.mcap'}: the disk is full; the incomplete file was removed"
    )
    assert names_in(small_disk) == []


@pytest.mark.parametrize("frames", [3, 200])
def test_a_disk_too_full_for_the_table(tmp_path, small_disk, frames):
    log = cloud_log(tmp_path / "log.mcap", frames=frames)
    (small_disk / "filling").write_bytes(bytes(64 * 1024))
    result = execute("filter", log, "-o", tmp_path / "out.mcap", "--csv", small_disk / "frames.csv", code=1)
    message = f"Error: {small_disk / 'frames.csv'}: the disk is full; the incomplete file was removed"
    assert set(result.stderr.splitlines()) == {message}
    assert names_in(small_disk) == ["filling"]
    assert names_in(tmp_path) == ["disk", "filling", "log.mcap"]


@pytest.mark.usefixtures("full_disk")
def test_a_full_device(tmp_path, logs):
    log, folder = tmp_path / "log.mcap", tmp_path / "out"
    log.write_bytes(logs["zstd"])
    folder.mkdir()
    result = execute("filter", log, "-o", folder / "out.mcap", code=1)
    assert result.stderr == f"Error: {folder / 'out.mcap'}: the disk is full; the incomplete file was removed\n"
    assert names_in(folder) == []


_LIMITED = """
import resource, sys
from seaclutter_cli.commands import main

resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
main()
"""


def test_a_file_that_may_not_grow(tmp_path, logs):
    pytest.importorskip("resource")
    log, folder = tmp_path / "log.mcap", tmp_path / "out"
    log.write_bytes(logs["none"])
    command = [sys.executable, "-c", _LIMITED, "filter", log, "-o", folder / "out.mcap"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    run = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert run.returncode == 1
    assert (
        run.stderr
        == f"Error: {folder / 'out.mcap'}: writing failed (File too large); the incomplete file was removed\n"
    )
    assert names_in(folder) == []


@pytest.fixture(scope="module")
def long_log(tmp_path_factory):
    messages = cloud_messages("ros2", 10, 3000) * 100
    path = tmp_path_factory.mktemp("long") / "log.mcap"
    log_of(path, messages, layout=Layout("lz4", chunk_size=2**20))
    return path


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_an_interrupted_run(tmp_path, long_log, name):
    folder = tmp_path / "out"
    options = ("-o", folder / "out.mcap", "--csv", folder / "frames.csv")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-m", "seaclutter_cli", "filter", long_log, *options]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment) as process:
        deadline = time.monotonic() + 20
        while not any(path.stat().st_size > 100_000 for path in folder.glob(".out.mcap*")):
            assert process.poll() is None, "the run ended before it was interrupted"
            assert time.monotonic() < deadline
            time.sleep(0.01)
        process.send_signal(getattr(signal, name))
        _, stderr = process.communicate(timeout=20)
    assert process.returncode == 1
    assert "Interrupted; incomplete output was removed." in stderr
    assert "Traceback" not in stderr
    assert names_in(folder) == []


def test_output_that_already_exists(tmp_path, logs):
    log, out = tmp_path / "log.mcap", tmp_path / "out.mcap"
    log.write_bytes(logs["zstd"])
    out.write_bytes(b"precious")
    refused = execute("filter", log, "-o", out, code=2)
    assert "already exists; use --force to replace it" in refused.stderr
    assert out.read_bytes() == b"precious"
    execute("filter", log, "-o", out, "--force", code=0)
    assert len(read_whole(out)["/points"]) == FRAMES


def test_output_that_is_kept_when_its_replacement_fails(tmp_path, logs):
    log, out = tmp_path / "log.mcap", tmp_path / "out.mcap"
    log.write_bytes(all_broken(logs["zstd"]))
    out.write_bytes(b"precious")
    execute("filter", log, "-o", out, "--force", code=1)
    assert out.read_bytes() == b"precious"


@pytest.mark.parametrize("force", [(), ("--force",)])
def test_output_that_is_the_input(tmp_path, logs, force):
    log = tmp_path / "log.mcap"
    log.write_bytes(logs["zstd"])
    (tmp_path / "link.mcap").symlink_to(log)
    for out in (log, tmp_path / ".." / tmp_path.name / "log.mcap", tmp_path / "link.mcap"):
        result = execute("filter", log, "-o", out, *force, code=2)
        assert "is part of the input" in result.stderr
    assert log.read_bytes() == logs["zstd"]


def test_one_broken_log_among_others(tmp_path, logs):
    for name, data in (("a", logs["zstd"]), ("b", b"no log"), ("c", logs["zstd"][:20000])):
        (tmp_path / f"{name}.mcap").write_bytes(data)
    out = tmp_path / "out"
    result = execute("filter", *(str(tmp_path / f"{name}.mcap") for name in "abc"), "-o", out, code=1)
    assert f"Error: {tmp_path / 'b.mcap'}: no readable record in this MCAP file" in result.stderr
    assert f"damaged: {tmp_path / 'c.mcap'}: byte" in result.stderr
    assert names_in(out) == ["a.mcap", "c.mcap"]
    assert len(read_whole(out / "a.mcap")["/points"]) == FRAMES
