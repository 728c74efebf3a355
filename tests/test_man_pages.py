"""The wheel contains a man page for each command, with all of its options."""

import re
import shutil
import subprocess
import sys
import zipfile

import click
import pytest

from seaclutter_cli import __version__
from seaclutter_cli.commands import cli
from tests.paths import ROOT


@pytest.fixture(scope="module")
def wheels(tmp_path_factory):
    pytest.importorskip("click_man")
    pytest.importorskip("hatchling")
    folders = [tmp_path_factory.mktemp("wheel") for _ in range(2)]
    for folder in folders:
        code = f"import hatchling.build; hatchling.build.build_wheel({str(folder)!r})"
        done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    return [next(folder.glob("*.whl")) for folder in folders]


@pytest.fixture(scope="module")
def pages(wheels):
    """Return the text of each page by its name."""
    prefix = f"seaclutter-{__version__}.data/data/share/man/man1/"
    with zipfile.ZipFile(wheels[0]) as wheel:
        names = [name for name in wheel.namelist() if name.startswith(prefix)]
        return {name.removeprefix(prefix): wheel.read(name).decode() for name in names}


def commands(command=cli, words=("seaclutter",)):
    yield "-".join(words), command
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            yield from commands(command.get_command(context, name), (*words, name))


COMMANDS = dict(commands())


def test_every_command_has_a_page(pages):
    assert set(pages) == {f"{name}.1" for name in COMMANDS}


def test_a_wheel_has_the_same_bytes_again(wheels):
    assert wheels[0].read_bytes() == wheels[1].read_bytes()


@pytest.mark.parametrize("name", COMMANDS)
def test_a_page_has_all_options_and_commands(name, pages):
    text, command = pages[f"{name}.1"].replace(r"\-", "-"), COMMANDS[name]
    assert f'"{__version__}"' in text.partition("\n")[0]
    assert "..." not in text.partition(".SH SYNOPSIS")[0]
    assert re.search(r"^\.SH DESCRIPTION\n\w", text, re.MULTILINE)
    for parameter in command.params:
        if isinstance(parameter, click.Option):
            assert all(option in text for option in parameter.opts)
    if isinstance(command, click.Group):
        for one in command.list_commands(click.Context(command)):
            assert rf"{name.replace('-', ' ')}-{one}(1)" in text


@pytest.mark.skipif(not shutil.which("groff"), reason="needs groff")
@pytest.mark.parametrize("name", COMMANDS)
def test_a_page_is_valid(name, pages):
    call = ["groff", "-man", "-ww", "-Kutf8", "-Tutf8", "-P-cbou", "-rLL=78n"]
    done = subprocess.run(call, input=pages[f"{name}.1"], capture_output=True, text=True, encoding="utf-8", check=True)
    assert not done.stderr
    assert "SYNOPSIS" in done.stdout
