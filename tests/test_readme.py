"""The README's examples print what it says, and the documented chain runs."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from seaclutter_cli.commands import cli
from tests.paths import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")


def example(beginning):
    """Return the arguments of an example that begins so, and what it is said to print."""
    found = re.search(rf"{re.escape(beginning)}(.*)\n```\n(?:.*\n)*?```\n((?:.+\n|\n)+?)```", README)
    assert found, beginning
    return found.group(1).split(), found.group(2).splitlines()


def test_the_first_example_prints_what_it_says(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    arguments, said = example(".venv/bin/seaclutter filter ")
    arguments[arguments.index("-o") + 1] = str(tmp_path / "filtered.mcap")
    printed = CliRunner().invoke(cli, ["filter", *arguments]).stdout.splitlines()
    assert printed[1:-1] == said[1:-1]  # the first line has the name, the last one the time


def test_the_second_example_prints_what_it_says(monkeypatch):
    monkeypatch.chdir(ROOT)
    arguments, said = example(".venv/bin/seaclutter evaluate ")
    printed = CliRunner().invoke(cli, ["evaluate", *arguments]).stdout.splitlines()
    assert printed[: len(said)] == said


@pytest.mark.slow
def test_the_chain_runs(tmp_path):
    path = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))
    script = ROOT / "examples" / "chain.sh"
    done = subprocess.run(
        [script, tmp_path / "chain"], env={**os.environ, "PATH": path}, capture_output=True, text=True, check=True
    )
    assert "joint" in done.stdout
    made = {file.name for file in (tmp_path / "chain").iterdir()}
    assert {"my.yaml", "departure.filtered.mcap", "frames.csv", "alarms.csv", "alarms.json"} <= made
