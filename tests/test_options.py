"""Options are declared once: commands, functions, checks and documentation agree."""

import doctest
import inspect
import pickle
from pathlib import Path

import click
import numpy as np
import pytest

import seaclutter
from seaclutter_cli import buckets
from seaclutter_cli.commands import cli
from seaclutter_cli.commands.console import Console
from seaclutter_cli.errors import AdaptedThresholdsWarning, ConfigError, UsageError
from seaclutter_cli.options import declared
from seaclutter_cli.runs.options import BatchOptions, ReadOptions
from seaclutter_cli.runs.options.logs import FilterOptions, TuneOptions
from tests.paths import ROOT
from tests.running import execute

SEA, LABELS = ROOT / "samples" / "sea.mcap", ROOT / "samples" / "sea.labels.csv"
COMMANDS = {
    "info": "info",
    "filter": "filter_log",
    "convert": "convert_log",
    "calibrate": "calibrate",
    "mask": "find_mask",
    "evaluate": "evaluate",
    "tune": "tune",
    "report": "report",
    "simulate": "simulate",
    "labels check": "check_labels",
    "view": "view_logs",
    "scene train": "train_scenes",
    "scene evaluate": "evaluate_scenes",
    "scene predict": "predict_scenes",
    "classify separate": "separate_tiles",
    "classify train": "train_forest",
    "classify predict": "classify_tiles",
}


def parameters_of(words):
    command = cli
    for word in words.split():
        command = command.get_command(click.Context(command), word)
    return {parameter.name for parameter in command.params if parameter.expose_value}


@pytest.mark.parametrize(("words", "name"), COMMANDS.items())
def test_a_command_has_the_options_of_its_function(words, name):
    function = getattr(seaclutter, name)
    options = function.options
    assert parameters_of(words) - set(declared(Console)) == {
        name for name, one in declared(options).items() if one.flags
    }
    assert list(inspect.signature(function).parameters) == list(declared(options))
    for parameter in declared(options):
        assert f"\n{parameter} : " in function.__doc__


@pytest.mark.parametrize(
    ("arguments", "keywords"),
    [
        (("--filter-rate", "nan"), {"filter_rate": np.nan}),
        (("--filter-rate", "0"), {"filter_rate": 0}),
        (("--filter-rate", "1.5"), {"filter_rate": 1.5}),
        (("--max-left", "inf"), {"max_left": np.inf}),
        (("-n", "0"), {"frames": 0}),
        (("-n", "1.5"), {"frames": 1.5}),
        (("--rate", "nan"), {"rate_hz": np.nan}),
        (("--start", "soon"), {"start_s": "soon"}),
        (("--sensor", "VLP"), {"sensor": "VLP"}),
        (("-j", "0"), {"jobs": 0}),
        (("--clutter-ids", "a"), {"clutter_ids": ["a"]}),
        (("--labels", "-"), {"labels": "-"}),
        (("--plot", "folder/"), {"plot_file": "folder/"}),
    ],
)
def test_values_are_refused_alike(tmp_path, arguments, keywords):
    given = ["calibrate", str(SEA), "-o", str(tmp_path / "c.yaml"), *arguments]
    execute(*given, code=2)
    with pytest.raises(UsageError):
        seaclutter.calibrate(SEA, **keywords)


def test_a_wrong_keyword_is_an_error():
    with pytest.raises(TypeError, match="no_such"):
        seaclutter.filter_log(SEA, "out.mcap", no_such=1)
    with pytest.raises(TypeError, match="keep_raw"):
        seaclutter.convert_log(SEA, "out.mcap", keep_raw=True)


def test_none_stands_for_the_default():
    options = FilterOptions("a.mcap", "b.mcap", rate_hz=None, labels=None, diagnostics=None)
    assert options == FilterOptions("a.mcap", "b.mcap")
    assert options.reading == ReadOptions()


def test_single_values_are_sequences():
    options = TuneOptions("a.mcap", "a.csv", {"update_weight": [0.5, 1]}, methods="joint")
    assert (options.methods, [str(path) for path in options.labels]) == (("joint",), ["a.csv"])
    assert [(one.key, one.values) for one in options.sweeps] == [("update_weight", (0.5, 1))]


def test_options_are_frozen_and_travel_without_logs_and_observer():
    options = FilterOptions(["a.mcap"] * 3, "b.mcap", observer=seaclutter.LoggingObserver())
    with pytest.raises(AttributeError):
        options.force = True
    other = pickle.loads(pickle.dumps(options))
    assert (other.logs, other.output, other.reading) == ((), "b.mcap", options.reading)


def test_settings_of_python_are_those_of_the_command_line(tmp_path):
    with pytest.warns(AdaptedThresholdsWarning, match="5 range rings from 3 to 70 m"):
        made = seaclutter.make_filter("joint", start_m=np.float64(3))
    assert made.step(seaclutter.Frame.of_arrays(np.ones((1, 3)), np.ones(1))).rings.thresholds.size == 5
    arguments = ["filter", str(SEA), "-o", str(tmp_path / "c.mcap"), "-q", "-s", "filter.near=keep"]
    execute(*arguments, "-s", "filter.update_weight=0.2", code=0)
    texts = ("filter.near=keep", "filter.update_weight=0.2")
    for settings in (texts, {"filter.near": "keep", "filter.update_weight": 0.2}):
        seaclutter.filter_log(SEA, tmp_path / "p.mcap", settings=settings, force=True)
        assert (tmp_path / "c.mcap").read_bytes() == (tmp_path / "p.mcap").read_bytes()
    with pytest.raises(ConfigError, match="neighbors"):
        seaclutter.make_filter("sor", neighbors=object())


@pytest.mark.parametrize("name", [*COMMANDS.values(), "open_log", "plan_filter", "plan_convert"])
def test_each_function_has_an_example_that_runs(name):
    """Which pytest finds among the doctests of its module."""
    module = inspect.getmodule(getattr(seaclutter, name))
    found = {one.name for one in doctest.DocTestFinder(exclude_empty=True).find(module) if one.examples}
    assert f"{module.__name__}.{name}" in found


def test_urls_become_paths_wherever_they_are_given():
    """In logs and outputs as they were given, with the slash of a folder; in files as paths."""
    given = ["s3://trial/day1/*.mcap", "b.mcap"]
    options = FilterOptions(
        given,
        "s3://trial/out/",
        csv_file="s3://trial/frames.csv",
        labels=["s3://trial/labels"],
        config="s3://trial/joint.yaml",
        cluster="tls://host:8786",
        jobs=2,
        observer=seaclutter.LoggingObserver(),
    )
    local = buckets._argument(options, lambda url: Path("/copies") / url.key)
    assert local.logs == ["/copies/day1/*.mcap", "b.mcap"]
    assert local.output == "/copies/out/"
    assert local.csv_file == Path("/copies/frames.csv")
    assert local.labels == (Path("/copies/labels"),)
    assert local.config == Path("/copies/joint.yaml")
    assert local.part(BatchOptions()) == options.part(BatchOptions())
    assert local.observer is not options.observer
    assert options.logs == given
    with pytest.raises(UsageError, match="takes a local path"):
        BatchOptions(manifest="s3://trial/m.csv")
