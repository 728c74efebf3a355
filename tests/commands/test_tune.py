import csv
import io
import json

import pytest
from click.testing import CliRunner
from PIL import Image

from seaclutter_cli.commands import cli
from seaclutter_cli.config import load_config
from seaclutter_cli.errors import UsageError
from seaclutter_cli.runs.sweep import parse_sweep


@pytest.fixture(scope="module")
def trial(tmp_path_factory):
    folder = tmp_path_factory.mktemp("trial")
    run("simulate", "buoy_speedboat", "-n", 8, "-o", folder / "trial.mcap")
    return folder / "trial.mcap"


def run(*arguments):
    return CliRunner().invoke(cli, [str(argument) for argument in arguments])


def tune(trial, *arguments):
    return run("tune", trial, "--labels", trial.with_suffix(".labels.csv"), *arguments)


def test_every_combination_gives_the_same_as_evaluate(trial):
    result = tune(trial, "--sweep", "update_weight=0.2,1", "--sweep", "std_ratio=0.5:1:0.5", "--json")
    rows = json.loads(result.stdout)["combinations"]
    assert [(row["update_weight"], row["std_ratio"]) for row in rows] == [(0.2, 0.5), (0.2, 1), (1, 0.5), (1, 1)]
    for row in rows:
        settings = [f"filter.{key}={row[key]}" for key in ("update_weight", "std_ratio")]
        alone = run(
            *("evaluate", trial, "--labels", trial.with_suffix(".labels.csv"), "--json"),
            *(part for setting in settings for part in ("-s", setting)),
        )
        expected = json.loads(alone.stdout)["methods"]["joint"]
        assert {key: expected[key] for key in ("N_FP", "N_FN", "f1")} == {
            key: row[key] for key in ("N_FP", "N_FN", "f1")
        }


def test_the_best_configuration_is_written(trial, tmp_path):
    out = tmp_path / "best.yaml"
    result = tune(trial, "--sweep", "filter_rate=0.1,0.8", "-m", "global_intensity", "-o", out, "--json")
    best = json.loads(result.stdout)
    config = load_config(out)
    assert config.method == "global_intensity"
    assert best["best"] == f"filter_rate={config.filter.filter_rate}"
    assert [row["best"] for row in best["combinations"]].count(True) == 1
    assert "Best of 2 combinations on trial" in out.read_text()


def test_table_and_plots(trial, tmp_path):
    files = [tmp_path / name for name in ("t.csv", "curve.png", "thresholds.svg")]
    options = zip(("--csv", "--plot", "--plot-thresholds"), files, strict=True)
    arguments = [part for option in options for part in option]
    result = tune(trial, "--sweep", "update_weight=0.2:0.8:0.2", *arguments)
    assert result.exit_code == 0, result.output
    assert "best on 8 frames: update_weight=" in result.stdout
    rows = list(csv.DictReader(io.StringIO(files[0].read_text())))
    assert [row["update_weight"] for row in rows] == ["0.2", "0.4", "0.6", "0.8"]
    with Image.open(files[1]) as plot:
        assert plot.width > 900
    assert files[2].read_text().startswith("<?xml")
    first = [file.read_bytes() for file in files]
    tune(trial, "--sweep", "update_weight=0.2:0.8:0.2", *arguments, "--force")
    assert [file.read_bytes() for file in files] == first


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--sweep", "update_weight"], "write it as KEY=V1,V2"),
        (["--sweep", "evaluation.box_margin_m=1,2"], "with a key of the filter"),
        (["--sweep", "colour=1,2"], "unknown key; method joint has: start_m"),
        (["--sweep", "update_weight=2"], "filter.update_weight"),
        (["--sweep", "update_weight=[1"], "not valid YAML"),
        (["--sweep", "update_weight=1:0:0.1"], "not a valid range"),
        (["--sweep", "update_weight="], "no values given"),
        (["--sweep", "update_weight=0.1", "--sweep", "update_weight=0.2"], "the same key is given twice"),
        (["--sweep", "max_neighbors=1:400:1", "--sweep", "std_ratio=0,1"], "800 combinations"),
        (["--sweep", "update_weight=0.1", "--sweep", "std_ratio=1", "--plot", "a.png"], "a single --sweep"),
        (["--sweep", "update_weight=0.1", "--plot", "a.jpg"], "must end in .png or .svg"),
        (["--sweep", "update_weight=0.1", "--plot-thresholds", "a.png", "--ring", "5"], "has 4 range rings"),
        (["--sweep", "std_ratio=1", "-m", "sor", "--plot-thresholds", "a.png"], "has 0 range rings"),
        ([], "Missing option '--sweep'"),
    ],
)
def test_wrong_command_lines(trial, arguments, message):
    result = tune(trial, *arguments)
    assert result.exit_code == 2
    assert message in result.stderr


def test_values_of_a_sweep():
    assert parse_sweep("k=1,1,2").values == (1, 2)
    assert parse_sweep("k=1:3:1").values == (1, 2, 3)
    assert parse_sweep("k=0:0.3:0.1").values == (0, 0.1, 0.2, 0.3)
    with pytest.raises(UsageError):
        parse_sweep("=1")


def test_a_missing_log(tmp_path):
    result = run("tune", tmp_path / "none.mcap", "--labels", tmp_path, "--sweep", "update_weight=1")
    assert result.exit_code in (1, 2)
    assert "none.mcap" in result.stderr


def test_without_a_labelled_frame_there_is_no_best_configuration(trial, tmp_path):
    out = tmp_path / "best.yaml"
    labels = tmp_path / "first.csv"
    labels.write_text("frame,track_id,class,x,y,z,length,width,height,yaw\n0,0,none,,,,,,,\n")
    result = run("tune", trial, "--labels", labels, "--start", 0.5, "--sweep", "update_weight=0.2,1", "-o", out)
    assert result.exit_code == 0, result.output
    assert not out.exists()
    assert f"{out}: not written, because no frame is labelled" in result.stderr
