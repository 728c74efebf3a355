"""Thresholds when the command line changes the range rings; every setting shown in help and docs is accepted."""

import json
import re
import warnings

import click
import pytest

from seaclutter_cli.airborne.settings import load_settings
from seaclutter_cli.commands import cli
from seaclutter_cli.config import DEFAULT_SENSOR, load_config
from seaclutter_cli.errors import AdaptedThresholdsWarning, ConfigError
from seaclutter_cli.filters import FILTERS
from tests.commands.test_filter import write_log
from tests.paths import ROOT
from tests.running import execute

TEXTS = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")), *sorted((ROOT / "examples").glob("*.sh"))]


@pytest.mark.parametrize(
    ("overrides", "thresholds"),
    [
        (["filter.start_m=5"], (30, 16, 7, 4, 4)),
        (["filter.start_m=40"], (7, 4)),
        (["filter.end_m=100"], (30, 16, 7, 4, 4, 4)),
        (["filter.end_m=30"], (30, 16)),
        (["filter.ring_width_m=30"], (16, 4)),  # a middle between two: the farther one
        (["filter.ring_width_m=7.5"], (30, 30, 16, 16, 7, 7, 4, 4)),
        (["filter.start_m=100", "filter.end_m=110"], (4,)),
        (["filter.start_m=5", "filter.method=confirmed"], (30, 16, 7, 4, 4)),
    ],
)
def test_each_range_ring_has_the_threshold_of_the_nearest_one(overrides, thresholds):
    with pytest.warns(AdaptedThresholdsWarning, match="each has the threshold of the nearest one before") as caught:
        config = load_config(overrides=overrides)
    assert config.filter.initial_thresholds == thresholds
    assert str(list(thresholds)) in str(caught[0].message)
    assert config.threshold_sensor == DEFAULT_SENSOR


@pytest.mark.parametrize(
    "overrides", [["filter.start_m=12"], ["filter.start_m=5", "filter.initial_thresholds=[5, 4, 3, 2, 1]"]]
)
def test_thresholds_that_fit_stay(overrides):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load_config(overrides=overrides)


def test_thresholds_of_a_file_must_fit(tmp_path):
    path = tmp_path / "c.yaml"
    path.write_text("filter: {start_m: 5, initial_thresholds: [30, 16, 7, 4]}\n")
    with pytest.raises(ConfigError, match="initial_thresholds: expected 5"):
        load_config(path)


def test_the_program_says_so_once(tmp_path):
    log = write_log(tmp_path / "log.mcap")
    line = ["filter", str(log), "-o", str(tmp_path / "f.mcap"), "-s", "filter.start_m=5", "--json"]
    result = execute(*line, code=0)
    assert result.stderr.count("Warning: filter.initial_thresholds: 5 range rings from 5 to 70 m instead of 4;") == 1
    assert len(json.loads(result.stdout)[0]["topics"]["/points"]["rings"]) == 5


def commands_of(group, context):
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        if isinstance(command, click.Group):
            yield from commands_of(command, click.Context(command, parent=context, info_name=name))
        else:
            yield command, click.Context(command, parent=context, info_name=name)


def settings_shown():
    context = click.Context(cli)
    helps = [" ".join(command.get_help(own).split()) for command, own in commands_of(cli, context)]
    texts = [*helps, *(path.read_text(encoding="utf-8") for path in TEXTS)]
    found = {match for text in texts for match in re.findall(r"\b[a-z]+\.\w+=[^\s`,;)']+", text)}
    sections = ("filter", "evaluation", "separation", "features", "forest", "objects")
    return sorted(text for text in found if text.split(".")[0] in sections and not text.partition("=")[2].isupper())


def test_settings_are_found():
    assert {"filter.start_m=5", "separation.window_m=30"} <= set(settings_shown())


@pytest.mark.filterwarnings("ignore::seaclutter_cli.errors.AdaptedThresholdsWarning")
@pytest.mark.parametrize("text", settings_shown())
def test_settings_in_help_and_docs_are_accepted(text):
    section, key = text.partition("=")[0].split(".")[:2]
    if section not in ("filter", "evaluation"):
        load_settings(None, [text])
        return
    methods = [name for name, kind in FILTERS.items() if key in vars(kind.Params()) or section == "evaluation"]
    assert methods
    for method in methods:
        load_config(method=method, overrides=[text])
