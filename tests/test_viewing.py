"""``seaclutter view``: files that are valid for Rerun, and a viewer for this computer only."""

import json
import re
import subprocess
import sys
from functools import partial

import pytest

from seaclutter_cli import viewing
from seaclutter_cli.runs import report as runs_report
from tests.reporting.runs import make_labels, make_log
from tests.running import execute
from tests.sinks.runs import filter_log

view = partial(execute, "view", code=0)


def rerun(*words):
    """Run the command-line program of Rerun."""
    pytest.importorskip("rerun", reason="the extra view is not installed")
    command = [sys.executable, "-m", "rerun_cli", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def entities(path):
    """Return the entity paths in a file, after Rerun has verified it."""
    rerun("rrd", "verify", path)
    listed = rerun("rrd", "stats", path).partition("Num chunks per entity")[2].partition("\n\n")[0]
    return set(re.findall(r"^/(\S+):", listed, re.MULTILINE))


@pytest.fixture
def log(tmp_path):
    return make_log(tmp_path / "log.mcap")


CURVES = {f"{name}/ring_{ring}" for name in ("thresholds", "corrections") for ring in (1, 2, 3, 4)}
CLOUDS = {"world/raw", "world/kept", "world/removed/low_intensity", "world/removed/outlier", "world/removed/near"}


def test_a_file(log, tmp_path):
    pytest.importorskip("rerun", reason="the extra view is not installed")
    labels = make_labels(tmp_path / "boxes.csv")
    view(log, "--labels", labels, "--save", tmp_path / "a.rrd")
    assert entities(tmp_path / "a.rrd") >= CLOUDS | CURVES | {"world/labels", "world/clusters", "counts/kept"}
    assert {path.name for path in tmp_path.iterdir()} == {"log.mcap", "boxes.csv", "a.rrd"}


def test_a_filtered_log(log, tmp_path):
    pytest.importorskip("rerun", reason="the extra view is not installed")
    filter_log(log, tmp_path / "f.mcap", keep_raw=True, with_removed=True)
    view(tmp_path / "f.mcap", "--save", tmp_path / "a.rrd")
    assert entities(tmp_path / "a.rrd") >= CLOUDS | CURVES


def test_an_error_leaves_nothing(tmp_path):
    pytest.importorskip("rerun", reason="the extra view is not installed")
    (tmp_path / "log.mcap").write_bytes(b"no log")
    view(tmp_path / "log.mcap", "--save", tmp_path / "a.rrd", code=1)
    assert [path.name for path in tmp_path.iterdir()] == ["log.mcap"]


def test_an_existing_file_is_kept(log, tmp_path, monkeypatch):
    monkeypatch.setattr(runs_report, "require_rerun", lambda: None)
    (tmp_path / "a.rrd").write_text("mine")
    assert "--force" in view(log, "--save", tmp_path / "a.rrd", code=2).stderr
    assert ".rrd" in view(log, "--save", tmp_path / "a.txt", code=2).stderr


def test_the_error_names_the_extra(log, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert "seaclutter[view]" in view(log, code=1).stderr


def test_without_a_display_the_error_names_an_alternative(log, monkeypatch):
    monkeypatch.setattr(viewing, "require_rerun", lambda: None)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(viewing.UsageError, match="--save"), viewing.viewer(9876):
        pass


def test_the_viewer_listens_on_the_loopback_only(monkeypatch):
    started, connected = [], []

    class Process:
        def __init__(self, command, **_):
            started.append(command)

    monkeypatch.setattr(viewing, "require_rerun", lambda: None)
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(viewing.subprocess, "Popen", Process)
    with viewing.viewer(1234) as sink:
        sink(type("Recording", (), {"connect_grpc": lambda _, url: connected.append(url)})())
    words = started[0]
    assert words[words.index("--bind") + 1] == "127.0.0.1"
    assert words[words.index("--port") + 1] == "1234"
    assert connected == ["rerun+http://127.0.0.1:1234/proxy"]


def test_the_viewer_knows_these_options():
    words = [word for word in viewing.viewer_command(1234) if word.startswith("--")]
    text = rerun("--help")
    assert [word for word in words if word not in text] == []


def test_the_extra_is_not_part_of_all():
    import tomllib

    from tests.paths import ROOT

    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert "view" in extras
    assert "view" not in json.dumps(extras["all"])
