"""The way out to the terminal: printable text of bounded length, one line for each error, whatever names contain."""

import io
import json
import logging
import os
import shutil
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.printer import LogHandler
from seaclutter_cli.errors import InputError
from seaclutter_cli.simulation.marine.scene import builtin_scenes
from tests.logs import cloud_log
from tests.pairs import covering
from tests.paths import ROOT, SAMPLE
from tests.running import execute

HOSTILE = "a\nLINE\x1b]0;x\x07\u202e\x9b"
"""A line break, a terminal sequence that sets the title, a bell, an override of the text direction, a C1 control."""
TOPIC = f"/t{HOSTILE}"
LABELS = "frame,track_id,class,x,y,z,length,width,height,yaw\n0,1,\x1b[1m,15,0,0,4,4,4,0\n"

pytestmark = pytest.mark.skipif(os.name != "posix", reason="other systems allow no such names")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder of files with hostile names: a log, a damaged log, labels, configurations, a scene, an unknown file."""
    path = tmp_path_factory.mktemp("hostile")
    data = bytearray(cloud_log(path / f"{HOSTILE}.mcap", topics=(TOPIC,)).read_bytes())
    cloud_log(path / f"{HOSTILE}.two.mcap", topics=(TOPIC, f"{TOPIC}2"), frames=1)
    data[len(data) // 2] ^= 255
    (path / f"{HOSTILE}.damaged.mcap").write_bytes(data)
    (path / f"{HOSTILE}.csv").write_text(LABELS)
    (path / f"{HOSTILE}.yaml").write_text('filter: {"far\\nLINE\\e[3m": drop, start_m: "\\nLINE\\e"}\n"x\\nLINE": 1')
    (path / f"{HOSTILE}.junk").write_text("hello")
    (path / f"{HOSTILE}.bag").write_text("#ROSBAG V1\x1b\nLINE\n")
    shutil.copy(builtin_scenes()["apple"], path / f"{HOSTILE}.scene.yaml")
    return path


COMMAND_LINES = [
    "info @.mcap",
    "info @.two.mcap",
    "info @.damaged.mcap",
    "info @.junk",
    "info @.bag",
    "info @.none",
    "info @.mcap -t @",
    "info @.mcap --sensor @",
    "info @.mcap --@",
    "info @.mcap -n @",
    "@",
    "filter @.mcap -o >.mcap -v",
    "filter @.mcap -o @.mcap",
    "filter @.two.mcap -o >.mcap",
    "filter @.damaged.mcap -o >.mcap",
    "filter @.mcap -o >.mcap -c @.yaml",
    "filter @.mcap -o >.mcap --with-scene --labels @.junk",
    "calibrate @.mcap -o >.yaml --keep-end",
    "evaluate @.mcap --labels @.csv -v -o >.csv",
    "evaluate @.mcap --labels @.junk",
    "tune @.mcap --labels @.csv --sweep @=1",
    "labels check @.mcap --labels @.csv",
    "labels check @.mcap --labels @.junk",
    "report @.mcap -o >.html",
    "simulate @.scene.yaml -o >.mcap -n 1",
    "simulate @ -o >.mcap",
    "simulate apple -o >.mcap --lidar @",
    "classify separate @.junk -o >.las",
    "classify predict @.junk -o >.las --model @.junk",
    "scene predict @.mcap --model @.junk",
    "scene @",
    "config check @.yaml",
    "config show -s filter.start_m=@",
    "config show -m @",
]


@pytest.mark.parametrize("line", COMMAND_LINES)
def test_names_from_outside_are_escaped(folder, tmp_path, line):
    words = [
        word.replace("@", str(folder / HOSTILE) if word.startswith("@.") else HOSTILE).replace(
            ">", str(tmp_path / HOSTILE)
        )
        for word in line.split(" ")
    ]
    result = execute(*words)
    assert isinstance(result.exception, SystemExit | None), result.exception
    lines = (result.stdout + result.stderr).split("\n")
    assert all(text.isprintable() for text in lines)
    assert not any(text.lstrip().startswith("LINE") for text in lines)
    assert any("LINE" in text for text in lines)


def test_json_is_exact(folder):
    result = execute("info", folder / f"{HOSTILE}.mcap", "--json")
    (content,) = json.loads(result.stdout)
    assert content["path"] == str(folder / f"{HOSTILE}.mcap")
    assert TOPIC in content["clouds"]


def test_long_names_are_cut(tmp_path):
    topic = "/" + "x" * 1_000_000
    log = cloud_log(tmp_path / "log.mcap", topics=(topic,), frames=1)
    result = execute("info", log)
    assert "/xxx" in result.stdout
    assert "x…x" in result.stdout
    assert len(result.stdout) < 5000
    result = execute("filter", log, "-o", tmp_path / "out.mcap", "-t", "y" * 1000, code=2)
    assert len(result.output) < 1000
    result = execute("info", "word " * 10_000)
    assert len(result.output) < 5000


def test_a_shown_configuration_is_not_cut():
    boxes = ", ".join(["[1, 2, 3, 4, 5, 6]"] * 1000)
    result = execute("config", "show", "-s", f"filter.exclude_boxes=[{boxes}]")
    assert "…" not in result.stdout
    assert len(result.stdout) > len(boxes)


def test_a_list_of_problems_keeps_its_lines(tmp_path):
    file = tmp_path / "config.yaml"
    file.write_text("filter: {a: 1, b: 2}")
    result = execute("config", "check", file)
    assert len(result.stderr.splitlines()) == 3


def test_warnings_of_libraries_are_one_line_each(monkeypatch, tmp_path):
    def warn_and_fail(*_):
        for _ in range(3):
            warnings.warn("text\nLINE\x1b", stacklevel=1)
        raise InputError("failed")

    monkeypatch.setattr(Console, "finish", warn_and_fail)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        result = execute("config", "sensors")
    assert result.exit_code == 1
    warning, error = result.stderr.splitlines()
    assert warning.startswith("Warning: text\\nLINE\\x1b (UserWarning, ")
    assert error == "Error: failed"


@pytest.mark.parametrize(
    ("line", "length"),
    covering(
        (
            "info @",
            "config check @",
            "config show -c @",
            "simulate @ -o out.mcap",
            "simulate apple -n 1 -o @",
            "simulate apple -n 1 -o out.mcap --scene-file @",
            "filter LOG -o @",
            "filter LOG -o @/out.mcap",
            "filter LOG -o out.mcap --csv @",
            "filter LOG -o out.mcap -c @",
            "evaluate LOG --labels @",
            "calibrate LOG -n 1 -q -o @.yaml",
            "report LOG -n 1 -o @.html",
            "report LOG -n 1 -o out.html --figures @",
            "tune LOG --sweep update_weight=0,1 --labels @",
            "classify separate @ -o out.las",
            "classify predict @ -o out.las --model @",
            "scene predict LOG --model @",
            "scene evaluate @",
        ),
        (300, 5000),
    ),
)
def test_names_that_are_too_long_are_one_line(tmp_path, monkeypatch, line, length):
    monkeypatch.chdir(tmp_path)
    words = [word.replace("@", "n" * length).replace("LOG", str(SAMPLE)) for word in line.split(" ")]
    result = execute(*words)
    assert isinstance(result.exception, SystemExit), result.exception
    assert result.exit_code in (1, 2)
    assert "nnn…nnn" in result.stderr
    assert result.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


FULL = Path("/dev/full")


def run_to_full_device(arguments):
    command = [sys.executable, "-m", "seaclutter_cli", *arguments]
    with FULL.open("w") as output:
        return subprocess.run(command, stdout=output, stderr=subprocess.PIPE, text=True, cwd=ROOT, check=False)


@pytest.mark.skipif(not FULL.exists(), reason="needs /dev/full")
@pytest.mark.parametrize(
    "arguments",
    [
        ["filter", "--help"],
        ["--version"],
        ["config", "show"],
        ["config", "sensors", "--json"],
        ["config", "check", "configs/snow.yaml"],
        ["info", str(SAMPLE), "-n", "1"],
    ],
    ids=" ".join,
)
def test_a_full_device(arguments):
    done = run_to_full_device(arguments)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith("Error: ")
    assert "No space left on device" in done.stderr


@pytest.mark.parametrize(
    ("closed", "words", "code"),
    [(">&-", "config show", 0), ("2>&-", "info none.mcap", 2), (">&- 2>&-", "info none.mcap", 2)],
)
def test_closed_streams(closed, words, code):
    done = subprocess.run(
        f"{sys.executable} -m seaclutter_cli {words} {closed}", shell=True, capture_output=True, text=True, check=False
    )
    assert done.returncode == code
    assert "Traceback" not in done.stderr


def test_debug_shows_a_printable_traceback(folder):
    command = [sys.executable, "-m", "seaclutter_cli", "info", str(folder / f"{HOSTILE}.junk"), "--debug"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("Traceback")
    assert all(line.isprintable() for line in done.stderr.split("\n"))


def test_records_that_libraries_log_are_one_line(capsys):
    LogHandler().handle(logging.LogRecord("library", logging.WARNING, "", 0, "text %s", ("\nLINE\x1b",), None))
    assert capsys.readouterr().err == "Warning: text \\nLINE\\x1b (library)\n"


def test_lines_appear_above_a_progress_bar(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    console = Console()
    with console.progress("4 tiles", 4, unit="tile") as step:
        console.note("the first")
        step()
        console.warn("the second")
    console.note("the last")
    *above, last = terminal.getvalue().split("\n")
    assert [line.rpartition("\r")[2] for line in above] == ["the first", "Warning: the second", "the last"]
    assert "4 tiles" in above[0]
    assert not last
