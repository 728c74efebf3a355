"""Interrupts end a run whatever Python is doing, and get lost nowhere."""

import signal
import subprocess
import sys

import pytest

from seaclutter_cli.frame import Frame
from tests.paths import ROOT, SAMPLE
from tests.running import execute

NAMES = [name for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]

BEGIN = """
import signal, sys, time
from seaclutter_cli.interrupts import handle_interrupts, ignore_interrupts
if hasattr(signal, "SIGHUP"): signal.signal(signal.SIGHUP, signal.SIG_DFL)  # nohup ignores it
handle_interrupts()
try:
"""
END = """
    for _ in range(1000): time.sleep(0.01)
    print("ended")
except KeyboardInterrupt:
    print("interrupted")
ignore_interrupts()
"""


def run(body, folder, begin=BEGIN):
    lines = "".join(f"    {line}\n" for line in body.splitlines())
    command = [sys.executable, "-c", f"import sys; sys.path.append({str(folder)!r})\n{begin}{lines}{END}"]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)


@pytest.mark.parametrize("name", NAMES)
def test_an_interrupt(tmp_path, name):
    assert run(f"signal.raise_signal(signal.{name})", tmp_path).stdout == "interrupted\n"


@pytest.mark.parametrize("name", NAMES)
def test_an_interrupt_waits_for_the_end_of_an_import(tmp_path, name):
    module = (
        f"import signal\ntry:\n    signal.raise_signal(signal.{name})\nexcept BaseException:\n    print('dropped')\n"
    )
    (tmp_path / "slow.py").write_text(f"{module}print('imported')\n")
    assert run("import slow", tmp_path).stdout == "imported\ninterrupted\n"


def in_finalizer(statement):
    return f"class Thing:\n    def __del__(self): {statement}\nthing = Thing()\ndel thing\n"


def test_an_interrupt_within_a_finalizer(tmp_path):
    done = run(in_finalizer("signal.raise_signal(signal.SIGINT)"), tmp_path)
    assert (done.stdout, done.stderr) == ("interrupted\n", "")


def test_an_interrupt_that_compiled_code_drops(tmp_path):
    """Numpy asks the type of what it compares for an attribute, and clears any error of that."""
    body = """
import numpy as np
class Kind(type):
    def __getattr__(cls, name):
        if name == "__array_ufunc__":
            signal.raise_signal(signal.SIGTERM)
        raise AttributeError
class Member(int, metaclass=Kind): pass
np.arange(3) == Member(1)
"""
    done = run(body, tmp_path)
    assert (done.stdout, done.stderr) == ("interrupted\n", "")


def test_other_errors_of_finalizers_are_shown(tmp_path):
    done = run(in_finalizer("raise ValueError('some error')") + "raise KeyboardInterrupt", tmp_path)
    assert done.stdout == "interrupted\n"
    assert "ValueError: some error" in done.stderr


def test_an_ignored_interrupt_stays_ignored(tmp_path):
    begin = f"import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)\n{BEGIN}"
    done = run("signal.raise_signal(signal.SIGINT)\nprint('goes on')\nsys.exit()", tmp_path, begin)
    assert done.stdout == "goes on\n"


@pytest.mark.parametrize(
    ("words", "message"),
    [("info LOG", "Interrupted."), ("filter LOG -o out.mcap", "Interrupted; incomplete output was")],
)
def test_only_removed_output_is_mentioned(tmp_path, monkeypatch, words, message):
    def interrupt(self):
        raise KeyboardInterrupt

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Frame, "coordinates", property(interrupt))
    result = execute(*words.replace("LOG", str(SAMPLE)).split(" "), code=130)
    assert f"\n{message}" in result.stderr
    assert not list(tmp_path.iterdir())


def test_a_second_interrupt_during_the_cleaning_is_ignored(tmp_path):
    body = """
class Cleaning:
    def __enter__(self): pass
    def __exit__(self, *error):
        for name in ("SIGTERM", "SIGINT", "SIGHUP"):
            signal.raise_signal(getattr(signal, name, signal.SIGTERM))
        try:
            raise OSError
        except OSError:
            signal.raise_signal(signal.SIGTERM)
        print("cleaned")
with Cleaning():
    try:
        signal.raise_signal(signal.SIGTERM)
    finally:
        signal.raise_signal(signal.SIGTERM)
"""
    done = run(body, tmp_path)
    assert (done.stdout, done.stderr) == ("cleaned\ninterrupted\n", "")


def test_an_interrupt_after_one_that_was_dropped(tmp_path):
    body = """
try:
    signal.raise_signal(signal.SIGINT)
except BaseException:
    print("dropped")
signal.raise_signal(signal.SIGINT)
"""
    assert run(body, tmp_path).stdout == "dropped\ninterrupted\n"


def test_files_are_completed_before_an_interrupt(tmp_path):
    """All files of a run are renamed, or none, even if a signal comes in between."""
    body = f"""
from pathlib import Path
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup
publish = AtomicFile.publish
def interrupted(file, **options):
    signal.raise_signal(signal.SIGTERM)
    publish(file, **options)
AtomicFile.publish = interrupted
folder = Path({str(tmp_path)!r})
with OutputGroup() as group:
    for name in "abc":
        with AtomicFile(folder / name, group): pass
"""
    assert run(body, tmp_path).stdout == "interrupted\n"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b", "c"]


def test_no_interrupt_after_the_end(tmp_path):
    body = """
ignore_interrupts()
signal.raise_signal(signal.SIGTERM)
signal.raise_signal(signal.SIGINT)
print("goes on")
sys.exit()
"""
    done = run(body, tmp_path)
    assert (done.stdout, done.stderr) == ("goes on\n", "")
