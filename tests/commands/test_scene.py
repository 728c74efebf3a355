"""``seaclutter scene``: its output, and its errors for all kinds of invalid command lines."""

import csv
import json
import sys
from functools import partial

import numpy as np
import pytest
from PIL import Image

from tests.paths import ROOT
from tests.running import execute
from tests.scenes.onnx_files import model_bytes
from tests.scenes.walls import write_toys

SEA = ROOT / "samples" / "sea.mcap"


run = partial(execute, "scene")


@pytest.fixture(scope="module")
def toys(tmp_path_factory):
    """Return a folder with three recordings of two frames for each class."""
    return write_toys(tmp_path_factory.mktemp("toys"), 3)


@pytest.fixture
def model(tmp_path):
    """Return a classifier that treats frames with few occupied cells as open."""
    pytest.importorskip("onnxruntime", reason="needs the extra scene")
    path = tmp_path / "model.onnx"
    path.write_bytes(model_bytes(threshold=0.008))
    return path


def test_predict_prints_the_scene_of_each_log(toys, model, tmp_path):
    table = tmp_path / "scenes.csv"
    result = run("predict", toys / "open", toys / "confined" / "confined0", "--model", model, "--csv", table, code=0)
    rows = [line.split() for line in result.stdout.splitlines()]
    assert rows[0] == ["recording", "topic", "frames", "scene", "changes", "open", "confined"]
    assert [row[:5] for row in rows[1:]] == [
        *([f"open{number}", "/points", "2", "open", "0"] for number in range(3)),
        ["confined0", "/points", "2", "confined", "0"],
    ]
    lines = list(csv.DictReader(table.open()))
    assert [line["scene"] for line in lines] == ["open"] * 6 + ["confined"] * 2
    assert [line["frame"] for line in lines[:4]] == ["0", "1"] * 2
    for line in lines:
        assert float(line["p_open"]) + float(line["p_confined"]) == pytest.approx(1, abs=2e-4)
        assert (float(line["p_open"]) > 0.5) == (line["scene"] == "open")


def test_predict_as_json(toys, model):
    result = run("predict", toys / "open", "--model", model, "--json")
    assert json.loads(result.stdout)[0] == {
        "schema_version": 1,
        "recording": "open0",
        "topics": {"/points": {"scene": "open", "changes": 0, "frames": {"open": 2, "confined": 0}}},
        "damage": [],
        "error": None,
    }


def test_every_and_hold_work_as_in_a_filter(tmp_path, model):
    folder = tmp_path / "trip"
    folder.mkdir()
    few, many = np.ones((1, 3), "f4"), np.random.default_rng(1).uniform(-59, 59, (5000, 3)).astype("f4")
    for number, points in enumerate((few, many, few, many, many, many, few)):
        np.save(folder / f"{number}.npy", points)

    def scenes(*options):
        table = tmp_path / "t.csv"
        run("predict", folder, "--model", model, "--csv", table, "--force", *options, code=0)
        lines = list(csv.DictReader(table.open()))
        return "".join(line["scene"][0] for line in lines), "".join(line["decided"] for line in lines)

    assert scenes() == ("ococcco", "1111111")
    assert scenes("--hold", "2") == ("ooooccc", "1111111")
    assert scenes("--every", "3") == ("oooccco", "1001001")
    assert scenes("-n", "2") == ("oc", "11")


def test_evaluate_prints_the_confusion_matrix(toys, model):
    result = run("evaluate", toys, "--model", model, code=0)
    assert result.stdout.splitlines()[0] == "12 frames of 6 recordings, 6 of them without a misclassified frame"
    assert [line.split() for line in result.stdout.splitlines()[1:]] == [
        ["true", "\\", "predicted", "open", "confined", "recall"],
        ["open", "6", "0", "100.0", "%"],
        ["confined", "0", "6", "100.0", "%"],
        ["precision", "100.0", "%", "100.0", "%"],
    ]
    wrong = run("evaluate", "--scene", f"open={toys}/confined/*", "--scene", f"confined={toys}/open", "--model", model)
    assert "12 frames of 6 recordings, 0 of them without a misclassified frame" in wrong.stdout


def test_evaluate_in_detail(toys, model, tmp_path):
    table = tmp_path / "t.csv"
    options = ("--scene", f"open={toys / 'confined' / 'confined1'}", "--scene", f"open={toys / 'open'}", "--csv", table)
    result = run("evaluate", *options, "--model", model, "--json")
    found = json.loads(result.stdout)
    assert found["classes"]["open"] == {
        "predicted": {"open": 6, "confined": 2},
        "precision": 1.0,
        "recall": 0.75,
    }
    assert found["classes"]["confined"]["recall"] is None
    assert found["misclassified"] == [{"recording": "confined1", "scene": "open", "wrong": 2, "frames": 2}]
    assert {line["truth"] for line in csv.DictReader(table.open())} == {"open"}
    text = run("evaluate", *options, "--model", model, "-v", "--force").stdout
    assert text.splitlines()[-1].split() == ["confined1", "open", "2", "2"]


def test_one_bad_log_does_not_stop_the_others(toys, model, tmp_path):
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(b"\x89MCAP0\r\n" + b"\0" * 40)
    result = run("predict", broken, toys / "open", "--model", model, code=1)
    assert "Error: " in result.stderr
    assert len(result.stdout.splitlines()) == 4
    result = run("evaluate", "--scene", f"open={broken}", toys, "--model", model, "--json", code=1)
    assert list(json.loads(result.stdout)["errors"]) == ["broken"]


def test_damage_is_reported(toys, model, tmp_path):
    folder = write_toys(tmp_path / "t", 1)
    (folder / "open" / "open0" / "1.npy").write_bytes(b"not an array")
    result = run("evaluate", folder, "--model", model, code=3)
    assert "Damaged: " in result.stderr
    assert "3 frames of 2 recordings" in result.stdout
    (folder / "open" / "open0" / "0.npy").write_bytes(b"not an array")
    assert "open0: no frame can be read" in run("evaluate", folder, "--model", model).stderr


def first_error(result, code):
    assert result.exit_code == code, result.output
    (line,) = [line for line in result.stderr.splitlines() if line.startswith("Error: ")]
    return line


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "no logs: give a folder that contains a folder for each class"),
        (["--scene", "open"], "--scene open: write it as CLASS=LOGS"),
        (["--scene", "=x"], "write it as CLASS=LOGS"),
        (["--scene", "open=none/*"], "none/*: no file matches this pattern"),
        (["{toys}/none"], "none: no such folder"),
        (["{toys}/open"], "open0 is a recording"),
        (["{toys}/open/open0"], "open0 is a recording"),
        (["{empty}"], "but it contains no folders"),
        (["{toys}", "--scene", "open={toys}/confined/confined0"], "confined0: labelled as both open and confined"),
        (["--scene", "ice={toys}/open"], "unknown class ice; the model has open, confined"),
    ],
)
def test_invalid_logs(arguments, message, toys, model, tmp_path):
    (tmp_path / "empty").mkdir()
    filled = [argument.format(toys=toys, empty=tmp_path / "empty") for argument in arguments]
    assert message in first_error(run("evaluate", *filled, "--model", model), 2)


def test_a_file_that_is_not_a_model(toys, tmp_path):
    pytest.importorskip("onnxruntime", reason="needs the extra scene")
    (tmp_path / "m.onnx").write_bytes(b"none")
    assert "not a usable ONNX file" in first_error(run("predict", SEA, "--model", tmp_path / "m.onnx"), 1)


def test_without_the_extra(toys, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    for arguments in (["predict", SEA], ["evaluate", toys]):
        assert first_error(run(*arguments), 1).endswith("pip install 'seaclutter[scene]'")
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.setitem(sys.modules, "onnx", None)
    assert first_error(run("train", toys, "-o", tmp_path / "m.onnx"), 1).endswith("pip install 'seaclutter[train]'")


@pytest.mark.parametrize(("scene", "expected"), [("harbour", "confined"), ("buoy_speedboat", "open")])
def test_the_built_in_model(scene, expected, tmp_path):
    pytest.importorskip("onnxruntime", reason="needs the extra scene")
    log = tmp_path / "log.mcap"
    execute("simulate", scene, "-n", "2", "--seed", "77", "-o", log)
    assert json.loads(run("predict", log, "--json").stdout)[0]["topics"]["/points"]["frames"][expected] == 2


@pytest.fixture
def trainable():
    """Skip the test if the extra train is not installed."""
    for name in ("torch", "onnx", "onnxruntime"):
        pytest.importorskip(name, reason="needs the extra train")


def test_train_writes_a_model_for_the_other_commands(toys, trainable, tmp_path):
    files = tmp_path / "m.onnx", tmp_path / "curves.png"
    arguments = ("--epochs", 2, "--batch", 4, "--extent", 50, "--plot", files[1])
    scenes = ("--scene", f"open={toys}/open", "--scene", f"confined={toys}/confined")
    result = run("train", *scenes, "-o", files[0], *arguments, code=0)
    assert "open or confined, from 12 frames of 6 recordings (4 train, 4 validation, 4 test)" in result.stdout
    assert "epoch 2 of 2: loss" in result.stderr
    with Image.open(files[1]) as picture:
        assert picture.height > picture.width
    first = [file.read_bytes() for file in files]
    again = run("train", *scenes, "-o", files[0], *arguments, "--force", "-q", "--json")
    assert again.stderr == ""
    assert [file.read_bytes() for file in files] == first
    report = json.loads(again.stdout)
    assert report["frames"] == {"train": 4, "validation": 4, "test": 4}
    assert len(report["epochs"]) == 2
    confusion = json.loads(run("evaluate", toys, "--model", files[0], "--json").stdout)
    assert confusion["frames"] == 12


def test_train_takes_one_frame_in_n(toys, trainable, tmp_path):
    result = run("train", toys, "-o", tmp_path / "m.onnx", "--epochs", 1, "--every", 2, "--json", "-q")
    assert json.loads(result.stdout)["frames"] == {"train": 2, "validation": 2, "test": 2}


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["{toys}", "-o", "{tmp}/m.pt"], 2, "the name of a model file must end in .onnx"),
        (["{toys}", "-o", "{tmp}/m.onnx", "--plot", "c.pdf"], 2, "figure files must end in .png or .svg"),
        (["--scene", "open={toys}/open", "-o", "{tmp}/m.onnx"], 2, "all logs are of class open; training needs"),
        (["{toys}", "-o", "{toys}/open/open0/0.npy"], 2, "is part of the input"),
        (["{few}", "-o", "{tmp}/m.onnx"], 1, "2 recordings of confined: at least 3 are needed"),
    ],
)
def test_invalid_training(arguments, code, message, toys, trainable, tmp_path):
    few = write_toys(tmp_path / "few", 2)
    filled = [argument.format(toys=toys, tmp=tmp_path, few=few) for argument in arguments]
    assert message in first_error(run("train", *filled, "-q"), code)
    assert not (tmp_path / "m.onnx").exists()
