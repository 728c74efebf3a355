import csv
import io
import json
import shutil

import pytest
from PIL import Image

from seaclutter_cli.config import load_config
from seaclutter_cli.errors import UsageError
from seaclutter_cli.runs.methods import parse_sweep
from tests.running import execute as run


@pytest.fixture(scope="module")
def trial(tmp_path_factory):
    folder = tmp_path_factory.mktemp("trial")
    run("simulate", "buoy_speedboat", "-n", 8, "-o", folder / "trial.mcap")
    return folder / "trial.mcap"


def tune(trial, *arguments):
    return run("tune", trial, "--labels", trial.with_suffix(".labels.csv"), *arguments)


def test_every_combination_gives_the_same_as_evaluate(trial):
    sweeps = ("--sweep", "update_weight=0.2,1", "--sweep", "std_ratio=0.5:1:0.5")
    rows = json.loads(tune(trial, *sweeps, "--hold-out", 0, "--json").stdout)["combinations"]
    assert not any(key.startswith("held_out") for key in rows[0])
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
    assert "best on 6 frames: update_weight=" in result.stdout
    assert "held out: 2 frames at the end of the recording" in result.stdout
    assert all(len(line) <= 80 for line in result.stdout.splitlines())
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
        ([], "nothing to compare: give --sweep KEY=VALUES, or several methods"),
        (["--sweep", "ror.min_neighbors=3", "-m", "joint"], "ror.min_neighbors: unknown key; method joint has"),
        (["--sweep", "joint.std_ratio=1", "--sweep", "std_ratio=2"], "the same key is given twice"),
        (["--sweep", "std_ratio=1", "-m", "sor", "-m", "joint", "--plot", "a.png"], "of a single method"),
        (["-m", "sor", "-m", "joint", "--plot-thresholds", "a.png"], "needs a single method"),
        (["--sweep", "std_ratio=1,2", "--hold-out", "1"], "--hold-out"),
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
    result = run("tune", trial, "--labels", labels, "--start", 0.5, "--sweep", "update_weight=0.2,1", "-o", out, code=0)
    assert not out.exists()
    assert f"{out}: not written, because no frame is labelled" in result.stderr


def test_methods_are_compared(trial, tmp_path):
    """Each method is swept over the keys that it has; the scores are those of `evaluate`."""
    out = tmp_path / "best.yaml"
    methods = ("-m", "joint", "-m", "ror", "-m", "none")
    sweeps = ("--sweep", "update_weight=0.2,1", "--sweep", "ror.min_neighbors=2,4")
    found = json.loads(tune(trial, *methods, *sweeps, "--hold-out", 0, "-o", out, "--json").stdout)
    rows = [(row["method"], row["update_weight"], row["ror.min_neighbors"]) for row in found["combinations"]]
    assert rows == [("joint", 0.2, None), ("joint", 1, None), ("ror", None, 2), ("ror", None, 4), ("none", None, None)]
    alone = run(
        *("evaluate", trial, "--labels", trial.with_suffix(".labels.csv"), "-m", "ror"),
        *("-s", "filter.min_neighbors=4", "--json"),
    )
    expected = json.loads(alone.stdout)["methods"]["ror"]
    assert {key: found["combinations"][3][key] for key in ("N_FP", "f1")} == {
        key: expected[key] for key in ("N_FP", "f1")
    }
    assert load_config(out).method == found["best"].split()[0]
    text = tune(trial, "--compare", "peers").stdout
    assert all(f"\n{name} " in text for name in ("joint", "sor", "naive"))


def test_held_out_frames_do_not_choose(trial):
    """The last quarter of the frames has figures of its own; both together are those of all frames."""
    sweep = ("--sweep", "filter_rate=0.1,0.8", "-m", "global_intensity")
    every, parts = (json.loads(tune(trial, *sweep, *hold, "--json").stdout) for hold in ((("--hold-out", 0)), ()))
    assert (every["held_out"], parts["held_out"]) == (None, "2 frames at the end of the recording")
    for whole, row in zip(every["combinations"], parts["combinations"], strict=True):
        assert (row["frames"], row["held_out_frames"]) == (6, 2)
        for key in ("N_FP", "N_FN", "false_alarms", "omitted_alarms"):
            assert row[key] + row[f"held_out_{key}"] == whole[key]


def test_whole_recordings_are_held_out(trial, tmp_path):
    logs = [tmp_path / f"{name}.mcap" for name in "abcd"]
    for log in logs:
        shutil.copy(trial, log)
        shutil.copy(trial.with_suffix(".labels.csv"), log.with_suffix(".labels.csv"))
    result = run("tune", *logs, "--labels", tmp_path, "--sweep", "update_weight=0.2,1", "-n", 2)
    assert "best on 6 frames: " in result.stdout
    assert "held out: 2 frames (1 recording: d)" in result.stdout
    logs[3].write_bytes(b"no log")
    result = run("tune", *logs, "--labels", tmp_path, "--sweep", "update_weight=0.2,1", "-n", 2)
    assert "held out: 3 frames at the ends of the recordings" in result.stdout
