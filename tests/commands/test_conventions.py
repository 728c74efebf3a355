"""What all commands have in common: suggestions, environment variables, standard streams, quiet output, versions."""

import json
import re
from importlib import metadata

import click
import pytest

from seaclutter_cli import __version__
from seaclutter_cli.commands import COMMANDS, cli
from seaclutter_cli.text import SCHEMA_VERSION
from tests.paths import ROOT
from tests.running import execute as run

SEA = ROOT / "samples" / "sea.mcap"


def leaves(group=cli, path=()):
    """Yield every command with its path."""
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        if isinstance(command, click.Group):
            yield from leaves(command, (*path, name))
        else:
            yield (*path, name), command


ALL = {" ".join(path): (path, command) for path, command in leaves()}


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        ("filtr x", "filter"),
        ("config chekc x", "check"),
        ("classify seperate x", "separate"),
        ("filter SEA -o OUT --metod sor", "--method"),
        ("filter SEA -o OUT -m jiont", "joint"),
        ("filter SEA -o OUT -m JOINT", "joint"),
        ("filter SEA -o OUT -t points", "/points"),
        ("filter SEA -o OUT -c rs-lidar32", "rs-lidar-32"),
        ("filter SEA -o OUT -s filter.strat_m=5", "start_m"),
        ("filter SEA -o OUT --sensor VLP16", "VLP-16"),
        ("simulate harbor -o OUT", "harbour"),
    ],
)
def test_a_similar_name_is_suggested(tmp_path, words, meant):
    result = run(*words.replace("SEA", str(SEA)).replace("OUT", str(tmp_path / "out.mcap")).split(), code=2)
    suggested = re.search(r"[Dd]id you mean( one of:)? (.*?)\?", " ".join(result.stderr.split()))
    assert suggested
    assert f"'{meant}'" in suggested[2]


def test_nothing_is_suggested_for_other_names(tmp_path):
    result = run("filter", SEA, "-o", tmp_path / "out.mcap", "-m", "xyz")
    assert "did you mean" not in result.stderr


@pytest.mark.parametrize("name", ALL)
def test_every_option_has_an_environment_variable(name):
    path, command = ALL[name]
    for option in command.params:
        if isinstance(option, click.Option) and option.expose_value:
            long = max(option.opts, key=len).strip("-")
            assert option.envvar == "_".join(("SEACLUTTER", *path, long)).upper().replace("-", "_")


def test_environment_variables_set_options_and_the_command_line_wins(tmp_path):
    variables = {
        "SEACLUTTER_FILTER_METHOD": "sor",
        "SEACLUTTER_FILTER_FRAMES": "2",
        "SEACLUTTER_FILTER_SET": "filter.neighbors=5 filter.std_ratio=2",
        "SEACLUTTER_FILTER_DIAGNOSTICS": "0",
    }
    out = tmp_path / "out.mcap"
    found = json.loads(run("filter", SEA, "-o", out, "-n", "1", "--json", env=variables).stdout)[0]
    assert found["topics"]["/points"]["frames"] == 1
    text = out.read_bytes()
    assert b"method: sor" in text
    assert b"neighbors: 5" in text
    assert b"std_ratio: 2" in text
    assert b"/seaclutter/diagnostics" not in text
    run("filter", SEA, "-o", out, env={"SEACLUTTER_FILTER_FRAMES": "many"}, code=2)


OUTPUTS = [
    "filter SEA -o -",
    "filter SEA -o OUT --csv -",
    "filter SEA -o OUT --manifest -",
    "calibrate SEA -o -",
    "simulate calm -o -",
    "report SEA -o -",
    "info -",
    "filter - -o OUT",
    "evaluate SEA --labels -",
]


@pytest.mark.parametrize("words", OUTPUTS)
def test_standard_streams_are_refused(tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    result = run(*words.replace("SEA", str(SEA)).replace("OUT", "out.mcap").split(), input="x", code=2)
    assert "standard" in result.stderr
    assert not list(tmp_path.iterdir())


def test_a_configuration_from_standard_input(tmp_path):
    shown = run("config", "show", "-m", "sor", "-s", "filter.neighbors=7").stdout
    out = tmp_path / "out.mcap"
    run("filter", SEA, "-o", out, "-n", "1", "-c", "-", input=shown, code=0)
    assert b"neighbors: 7" in out.read_bytes()


@pytest.mark.parametrize("text", ["filter: [", "5", "[1, 2]", "text", "filter: {method: x}", "a: 1"])
def test_another_text_from_standard_input_is_refused(tmp_path, text):
    result = run("filter", SEA, "-o", tmp_path / "out.mcap", "-c", "-", input=text, code=2)
    assert result.stderr.startswith(("Error: standard input: ", "Error: configuration: "))
    assert result.stderr.count("\n") == 1


def test_a_configuration_in_the_working_folder_is_used_and_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "seaclutter.yaml").write_text("filter: {method: ror}")
    note = "using seaclutter.yaml in the working folder; -c chooses another configuration\n"
    result = run("filter", SEA, "-o", "out.mcap", "-n", "1")
    assert result.stderr.startswith(note)
    assert b"method: ror" in (tmp_path / "out.mcap").read_bytes()
    assert note not in run("filter", SEA, "-o", "out.mcap", "-n", "1", "--force", "-q").stderr
    other = run("filter", SEA, "-o", "out.mcap", "-n", "1", "--force", "-c", "rs-lidar-32")
    assert note not in other.stderr
    assert b"method: joint" in (tmp_path / "out.mcap").read_bytes()


def test_a_filtered_log_is_shown_with_its_own_configuration_whatever_the_working_folder_has(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run("filter", SEA, "-o", "f.mcap", "-n", "3", "-m", "sor", "--keep-raw", "--with-removed", code=0)
    (tmp_path / "seaclutter.yaml").write_text("filter: {method: ror}")
    shown = run("report", "f.mcap", "-o", "r.html", "--json", code=0)
    assert json.loads(shown.stdout)["methods"].keys() == {"sor"}
    named = run("report", "f.mcap", "-t", "/points", "-o", "n.html", "-c", "seaclutter.yaml", "--json")
    assert json.loads(named.stdout)["methods"].keys() == {"ror"}


@pytest.mark.parametrize(
    ("words", "is_silent"),
    [
        ("filter SEA -n 1 -o OUT/a.mcap", True),
        ("calibrate SEA -o OUT/a.yaml", True),
        ("simulate calm -n 1 -o OUT/s.mcap", True),
        ("info SEA", False),
        ("evaluate SEA --labels LABELS -n 3", False),
    ],
)
def test_quiet_output_has_no_summary_of_what_was_written(tmp_path, words, is_silent):
    labels = SEA.with_suffix(".labels.csv")
    line = words.replace("SEA", str(SEA)).replace("OUT", str(tmp_path)).replace("LABELS", str(labels))
    result = run(*line.split(), "-q", code=0)
    assert (result.stdout == "") == is_silent
    assert result.stderr == ""


def test_versions_of_the_program_and_its_parts():
    result = run("--version")
    lines = result.stdout.splitlines()
    assert lines[0] == f"seaclutter, version {__version__}"
    assert f"numpy {metadata.version('numpy')}" in " ".join(result.stdout.split())
    assert all(len(line) < 80 for line in lines)


@pytest.mark.parametrize("words", ["info SEA", "filter SEA -n 1 -m none -o OUT", "config list"])
def test_json_has_the_version_of_its_schema(tmp_path, words):
    line = words.replace("SEA", str(SEA)).replace("OUT", str(tmp_path / "out.mcap"))
    data = json.loads(run(*line.split(), "--json").stdout)
    for item in data if isinstance(data, list) else [data]:
        assert next(iter(item.items())) == ("schema_version", SCHEMA_VERSION)


def test_lists_of_built_in_items():
    everything = json.loads(run("config", "list", "--json").stdout)
    assert {"sensors", "methods", "formats", "configs", "scenes", "layouts", "tiles", "lidars"} <= set(everything)
    assert json.loads(run("config", "sensors", "--json").stdout) == everything  # its former name
    methods = run("config", "list", "methods").stdout
    assert "joint" in methods
    assert "VLP-16" not in methods


def test_former_names_of_commands_are_not_listed():
    listed = re.findall(r"^  (\w+)  ", run("config", "--help").stdout.split("Commands:")[1], re.MULTILINE)
    assert listed == ["show", "check", "list"]


@pytest.mark.parametrize(
    "group", [*(name for name in COMMANDS if isinstance(cli.get_command(None, name), click.Group))]
)
def test_a_group_without_a_command_shows_its_help(group):
    result = run(group)
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr == run(group, "--help").stdout
