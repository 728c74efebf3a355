"""Tests of the help texts: complete, fast, and consistent with the README."""

import subprocess
import sys

import click
import pytest

from seaclutter_cli.commands import COMMANDS, cli
from tests.paths import ROOT
from tests.running import execute

README = (ROOT / "README.md").read_text(encoding="utf-8")


def walk(group, path=()):
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        yield (*path, name), command
        if isinstance(command, click.Group):
            yield from walk(command, (*path, name))


ALL = list(walk(cli))
PATHS = [path for path, _ in ALL]


@pytest.mark.parametrize(("path", "command"), ALL, ids=map("-".join, PATHS))
def test_every_command_and_option_has_help(path, command):
    assert command.help
    for parameter in command.params:
        if isinstance(parameter, click.Option):
            assert parameter.help, parameter.name
    result = execute(*path, "--help", terminal_width=80, code=0)
    lines = result.output.splitlines()
    assert all(len(line) <= 80 for line in lines)
    usual = lines[lines.index("Options:") :]
    usual = usual[: usual.index("")] if "" in usual else usual
    assert sum(line.startswith("  -") for line in usual) <= 12, "others belong to a group"


@pytest.mark.parametrize("path", PATHS, ids="-".join)
def test_every_command_is_in_the_readme(path):
    assert f"seaclutter {' '.join(path)}" in README


def test_the_short_help_is_that_of_the_command():
    for path, command in ALL:
        if len(path) == 1:
            assert command.get_short_help_str(200) == COMMANDS[path[0]]


def test_help_does_not_import_slow_packages():
    code = (
        "import sys\n"
        "from seaclutter_cli.commands import main\n"
        "for arguments in %r:\n"
        "    sys.argv = ['seaclutter', *arguments]\n"
        "    try: main()\n"
        "    except SystemExit: pass\n"
        "    slow = [name for name in ('numpy', 'scipy', 'pydantic', 'mcap', 'rosbags') if name in sys.modules]\n"
        "    if slow: print(arguments, slow, file=sys.stderr)"
    )
    lines = [["--help"], ["--version"], *([*path, "--help"] for path in PATHS)]
    done = subprocess.run([sys.executable, "-c", code % lines], capture_output=True, text=True, check=True)
    assert done.stdout.count("Usage: ") == len(lines) - 1
    assert done.stderr == ""


def test_python_m_runs_the_program():
    command = [sys.executable, "-m", "seaclutter_cli", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("seaclutter, version ")
