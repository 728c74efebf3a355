"""Files that are none: named pipes and devices are refused, and what is read at once has a limit."""

import os
import shlex
import signal
from pathlib import Path

import pytest
from click.testing import CliRunner

from seaclutter_cli.airborne.model import load_model
from seaclutter_cli.commands import cli
from seaclutter_cli.errors import InputError, ModelError
from seaclutter_cli.limits import variable
from seaclutter_cli.scenes.model import SceneModel
from tests.paths import ROOT

SEA, LABELS = (ROOT / "samples" / name for name in ("sea.mcap", "sea.labels.csv"))
PCAP = ROOT / "samples" / "rs-lidar-32.pcap"

READ = {
    "log": "info {}",
    "log by name": "info {}.mcap",
    "frame": "info {}.pcd",
    "packed log": "info {}.mcap.zstd",
    "configuration": f"filter {SEA} -o out.mcap -c {{}}",
    "mask": f"filter {SEA} -o out.mcap -s filter.mask={{}} -n 1",
    "labels": f"evaluate {SEA} --labels {{}} -n 1",
    "calibration": f"info {PCAP} --calibration {{}}",
    "scene": "simulate {} -o out.mcap",
}

SUFFIXES = {"log by name": ".mcap", "frame": ".pcd", "packed log": ".mcap.zstd"}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Work in a folder; what waits without end is interrupted."""
    monkeypatch.chdir(tmp_path)
    if hasattr(signal, "alarm"):
        signal.signal(signal.SIGALRM, signal.default_int_handler)
        signal.alarm(20)
    yield tmp_path
    if hasattr(signal, "alarm"):
        signal.alarm(0)


def refused(line):
    result = CliRunner().invoke(cli, shlex.split(line))
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exc_info
    assert result.exit_code in (1, 2, 3), result.output
    return " ".join(result.stderr.split())


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="named pipes")
@pytest.mark.parametrize("kind", READ)
def test_a_named_pipe_is_refused(folder, kind):
    line = READ[kind].format("pipe")
    name = next(word for word in shlex.split(line) if "pipe" in word).partition("=")[2] or "pipe"
    os.mkfifo(f"{name}{SUFFIXES.get(kind, '')}")
    assert "not a regular file" in refused(line)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="named pipes")
@pytest.mark.parametrize("option", ["-o pipe.mcap", "-o x.mcap --csv pipe.csv", "-o x.mcap --manifest pipe.csv"])
def test_a_named_pipe_is_no_output(option):
    os.mkfifo(option.split()[-1])
    assert "not a regular file" in refused(f"filter {SEA} -n 1 --force {option}")


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="devices")
@pytest.mark.parametrize("kind", [kind for kind in READ if kind not in SUFFIXES])
def test_a_device_is_refused(kind):
    assert "not a regular file" in refused(READ[kind].format("/dev/zero"))


@pytest.mark.parametrize("name", ["big.csv", "big.pcd", "big.ply"])
def test_a_frame_that_is_read_at_once_has_a_limit(folder, monkeypatch, name):
    monkeypatch.setenv(variable("whole_mib"), "1")
    (folder / name).touch()
    os.truncate(folder / name, 2**20 + 1)
    limit = f"larger than 1 MiB, the limit of a file that is read at once ({variable('whole_mib')})"
    assert f"Damaged: {name}: cannot be read: {limit}" in refused(f"info {name}")


def test_models_that_are_no_files(folder, monkeypatch):
    monkeypatch.setenv(variable("whole_mib"), "1")
    large = folder / "large.skops"
    large.write_bytes(bytes(2**20 + 1))
    for load, path, problem in (
        (load_model, large, "larger than 1 MiB"),
        (load_model, Path("/dev/zero"), "not a regular file"),
        (SceneModel, "/dev/zero", "not a regular file"),
    ):
        if Path(path).exists():
            with pytest.raises(InputError if load is load_model else ModelError, match=problem):
                load(path)
