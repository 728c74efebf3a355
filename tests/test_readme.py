"""The examples in the README print the documented output, and the example script runs."""

import json
import os
import re
import subprocess
import sys
from contextlib import chdir
from pathlib import Path

import pytest

from tests.paths import ROOT
from tests.running import execute

README = (ROOT / "README.md").read_text(encoding="utf-8")


def example(beginning):
    """Return the arguments and the documented output of the example that begins with a text."""
    found = re.search(rf"{re.escape(beginning)}(.*)\n```\n(?:.*\n)*?```\n((?:.+\n|\n)+?)```", README)
    assert found, beginning
    return found.group(1).split(), found.group(2).splitlines()


def test_output_of_the_first_example(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    arguments, expected = example(".venv/bin/seaclutter filter ")
    arguments[arguments.index("-o") + 1] = str(tmp_path / "filtered.mcap")
    printed = execute("filter", *arguments).stdout.splitlines()
    assert printed[1:-1] == expected[1:-1]  # the first line has the file name, the last line the time


@pytest.fixture(scope="module")
def second(tmp_path_factory):
    """Return the documented output of the second example, what it prints, and its summary."""
    arguments, expected = example(".venv/bin/seaclutter evaluate ")
    summary = tmp_path_factory.mktemp("second") / "summary.json"
    with chdir(ROOT):
        printed = execute("evaluate", *arguments, "--summary", summary).stdout
    return expected, printed.splitlines(), json.loads(summary.read_text(encoding="utf-8"))


def test_output_of_the_second_example(second):
    expected, printed, _ = second
    assert printed[: len(expected)] == expected


def test_shares_of_points_in_the_second_example(second):
    found = second[2]["methods"]
    text = " ".join(README.split())
    for method, sentence in (
        ("joint", "removes {} of the clutter points and {} of the target points"),
        ("confirmed", "{} and {}"),
    ):
        shares = (f"{100 * found[method][key]:.2f} %" for key in ("clutter_removal", "target_loss"))
        assert f"`{method}` {sentence.format(*shares)}" in text


def test_the_python_example_runs(monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    (code,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    exec(code, {})
    printed = capsys.readouterr().out
    assert re.search(r"^joint +60 +14 +8 ", printed, re.MULTILINE)
    assert re.search(r"^confirmed +60 +\*0 +\*0 ", printed, re.MULTILINE)


def test_links_of_the_readme():
    targets = re.findall(r"\]\(([^)#]+)[^)]*\)|src=\"([^\"]+)\"", README)
    assert len(targets) > 20
    assert not [path for path in map("".join, targets) if not (ROOT / path).exists()]


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
