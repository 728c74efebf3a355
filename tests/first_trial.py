"""Run the commands of ``docs/guide/first_trial.md``; ``python -m tests.first_trial`` puts what they print on the page.

A block of commands may be followed by a block of what they print; with "…" in its last line, by the beginning of it.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.paths import ROOT

PAGE = ROOT / "docs" / "guide" / "first_trial.md"
_BLOCK = re.compile(r"^```(.*)\n((?:(?!```).*\n)*)```\n(?:\n```\n((?:(?!```).*\n)*)```\n)?", re.MULTILINE)
_STATUS = re.compile(r"# exit status (\d+)$", re.MULTILINE)
_SETUP = "mkdir trial"
_TIMES = re.compile(r"\d+(\.\d+)?( s\b| frames/s| [kMG]B\b)|(?<=[%–m]) +\d+\.\d\d$", re.MULTILINE)


def play(folder):
    """Run the page in a folder; return it with what its commands print, and wrong exit statuses."""
    for name in ("sea.mcap", "sea.labels.csv", "tile.laz"):
        shutil.copy(ROOT / "samples" / name, folder)
    wrong = []

    def replaced(found):
        kind, text, expected = found.groups()
        if title := re.fullmatch(r'csv title="(\S+)"', kind):
            (folder / title[1]).write_text(text, encoding="utf-8")
        if kind != "sh" or text.startswith(_SETUP):
            return found[0]
        status, printed = run(text, folder)
        if status != int((_STATUS.findall(text) or ["0"])[-1]):
            wrong.append(f"{text}exit status {status}\n{printed}")
        if expected is None:
            return found[0]
        shown = printed
        if expected.endswith("…\n"):
            shown = "".join([*printed.splitlines(keepends=True)[: expected.count("\n") - 1], "…\n"])
        return f"```sh\n{text}```\n\n```\n{shown}```\n"

    return _BLOCK.sub(replaced, PAGE.read_text(encoding="utf-8")), wrong


def run(script, folder):
    """Return the exit status of the last command of a script, and what it prints to a terminal of 80 columns."""
    variables = {name: value for name, value in os.environ.items() if not name.startswith("SEACLUTTER_")}
    path = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))
    done = subprocess.run(
        ["bash", "-c", script],
        cwd=folder,
        env={**variables, "PATH": path, "COLUMNS": "80", "PYTHONIOENCODING": "utf-8"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        check=False,
    )
    return done.returncode, done.stdout.decode()


def without_times(text):
    """Return a text without durations, rates and sizes of files, which differ from run to run."""
    return _TIMES.sub("T", text)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        page, wrong = play(Path(name))
    PAGE.write_text(page, encoding="utf-8")
    sys.exit("\n".join(wrong))
