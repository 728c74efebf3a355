"""The documentation builds without warnings, every page is reachable, and the commands that it shows are accepted."""

import json
import os
import re
import shutil
import subprocess
import sys
from html import unescape
from pathlib import Path

import click
import pytest
import yaml
from click.testing import CliRunner

import seaclutter
from seaclutter_cli.commands import cli
from tests import command_lines, scene_keys
from tests.paths import ROOT

DOCS = ROOT / "docs"
PAGES = sorted(path for path in DOCS.rglob("*") if path.suffix in (".md", ".ipynb"))
TEXTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(page for page in PAGES if page.suffix == ".md")]
SCRIPTS = sorted((ROOT / "examples").glob("*.sh"))
SHELLS = ("bash", "zsh", "fish")
FOREIGN = {
    "--hypothesis-profile",
    "--quick",
    "--user",
    *("--format", "--hours", "--inputs", "--no-sign-request", "--replay"),
    "--memory-limit",
    "--nthreads",
}
"""Options of other programs."""


def name_of(path):
    return path.relative_to(ROOT).as_posix()


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    pytest.importorskip("mkdocs_jupyter", reason="the extra docs is not installed")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", folder]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, encoding="utf-8", check=False)
    assert done.returncode == 0, done.stderr
    return folder


def test_the_site_builds(site):
    assert {page.stem for page in PAGES} <= {path.parent.name for path in site.rglob("index.html")} | {"index"}


def test_the_reference_has_every_public_name(site):
    html = (site / "reference" / "index.html").read_text(encoding="utf-8")
    documented = set(re.findall(r'id="[\w.]+\.(\w+)"', html))
    assert set(seaclutter.__all__) - {"__version__"} <= documented


def test_the_notebook_runs_on_the_sample_and_gives_the_documented_results(site):
    html = (site / "first_steps" / "index.html").read_text(encoding="utf-8")
    page = unescape(re.sub("<style.*?</style>", "", html, flags=re.DOTALL))
    assert page.count('src="data:image/png;base64,') == 2
    assert "application/vnd.jupyter.stderr" not in page
    last = page.rpartition("jp-OutputArea-output")[2]
    assert "{'joint': (14, 8), 'ring_intensity': (32, 0), 'none': (60, 0), 'ideal': (0, 0)}" in last


def test_the_notebook_has_no_outputs_in_the_repository():
    notebook = json.loads((DOCS / "first_steps.ipynb").read_text(encoding="utf-8"))
    assert not any(cell.get("outputs") for cell in notebook["cells"])


def test_the_site_needs_no_other_host(site):
    for page in site.rglob("*.html"):
        for tag in re.findall(r"<(?:script|link|img)\b[^>]*>", page.read_text(encoding="utf-8")):
            assert not re.search(r'(?:src|href)="(?:https?:)?//', tag), (page, tag)


def pages_of(nav):
    for entry in nav:
        for value in entry.values() if isinstance(entry, dict) else [entry]:
            yield from pages_of(value) if isinstance(value, list) else [value]


def test_every_page_is_in_the_navigation():
    listed = list(pages_of(yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]))
    assert sorted(listed) == [page.relative_to(DOCS).as_posix() for page in PAGES]


def test_the_reference_of_scene_keys_is_current():
    assert scene_keys.PAGE.read_text(encoding="utf-8") == scene_keys.page(), "python -m tests.scene_keys updates it"


@pytest.mark.parametrize("path", TEXTS, ids=name_of)
def test_command_lines_are_accepted(path):
    text = path.read_text(encoding="utf-8")
    for arguments in command_lines.in_blocks(text):
        command_lines.check(arguments)
    for arguments in command_lines.inline(text):
        if arguments[0] != "COMMAND":
            command_lines.check_names(arguments)


@pytest.mark.parametrize("path", SCRIPTS, ids=name_of)
def test_command_lines_of_scripts_are_accepted(path):
    lines = list(command_lines.in_script(path.read_text(encoding="utf-8")))
    assert lines
    for arguments in lines:
        command_lines.check(arguments)


@pytest.mark.parametrize("path", TEXTS, ids=name_of)
def test_options_in_the_text_exist(path):
    named = set(re.findall(r"`(--[a-z][a-z-]*)[^`]*`", path.read_text(encoding="utf-8")))
    assert named <= command_lines.option_names() | FOREIGN


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("filter a.mcap", "Missing option"),
        ("filter a.mcap -o b.mcap --nonsense", "No such option"),
        ("filter a.mcap -o b.mcap --frames none", "not a valid integer"),
    ],
)
def test_the_check_finds_mistakes(text, error):
    (arguments,) = command_lines.in_blocks(f"```sh\nVARIABLE=1 .venv/bin/seaclutter {text} 2> file  # comment\n```\n")
    with pytest.raises(click.UsageError) as raised:
        command_lines.check(arguments)
    assert error in raised.value.format_message()


def test_the_check_finds_commands():
    lines = "a && seaclutter b -x \\\n  --y | c; do seaclutter d e > f; done\n  docker run -v x seaclutter g"
    block = f"  ```sh\n  {lines}\n  ```\n"
    assert list(command_lines.in_blocks(block)) == [["b", "-x", "--y"], ["d", "e"], ["g"]]
    assert list(command_lines.inline("see `seaclutter b\n--y` and\n" + block)) == [["b", "--y"]]


@pytest.mark.parametrize("shell", SHELLS)
def test_shell_completion(shell, tmp_path):
    page = (DOCS / "guide" / "command-line.md").read_text(encoding="utf-8")
    found = re.search(rf"(\w+)=({shell}_source) seaclutter > (\S+)", page)
    assert found, f"{shell} is not documented"
    variable, instruction, _ = found.groups()
    if shell == "bash" and not shutil.which("bash"):
        pytest.skip("click asks bash for its version")
    script = CliRunner().invoke(cli, env={variable: instruction}, prog_name="seaclutter")
    assert script.exit_code == 0
    assert f"{variable}={shell}_complete" in script.stdout
    if shutil.which(shell):
        (tmp_path / "complete").write_text(script.stdout, encoding="utf-8", newline="\n")
        subprocess.run([shell, "-n", tmp_path / "complete"], check=True)
    words = {"COMP_WORDS": "seaclutter fil", "COMP_CWORD": "fil" if shell == "fish" else "1"}
    completed = CliRunner().invoke(cli, env={variable: f"{shell}_complete", **words}, prog_name="seaclutter")
    assert re.search(r"\bfilter\b", completed.stdout)
    assert "evaluate" not in completed.stdout


@pytest.mark.skipif(os.name != "posix" or not shutil.which("bash"), reason="needs bash")
def test_bash_completes():
    program = (
        'eval "$(_SEACLUTTER_COMPLETE=bash_source seaclutter)"; COMP_WORDS=(seaclutter calib); COMP_CWORD=1; '
        "_seaclutter_completion seaclutter calib seaclutter; echo ${COMPREPLY[@]}"
    )
    environment = {**os.environ, "PATH": os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))}
    done = subprocess.run(["bash", "-c", program], env=environment, capture_output=True, text=True, check=False)
    assert done.stdout == "calibrate\n", done.stderr
