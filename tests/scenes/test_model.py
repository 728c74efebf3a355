"""ONNX files of classifiers: any other file gives an error of one line."""

import json
import sys

import numpy as np
import pytest

from seaclutter_cli.errors import MissingExtraError, ModelError
from seaclutter_cli.scenes import SceneParams, make_scene_tracker
from seaclutter_cli.scenes import model as model_module
from seaclutter_cli.scenes.model import SceneModel, builtin_models
from tests.scenes.onnx_files import CLASSES, FLOAT, model_bytes

pytest.importorskip("onnxruntime", reason="needs the extra scene")

EMPTY = np.zeros((224, 224), np.uint8)
VALID = model_bytes()


def write(tmp_path, data):
    path = tmp_path / "model.onnx"
    path.write_bytes(data)
    return str(path)


def test_a_valid_file(tmp_path):
    model = SceneModel(write(tmp_path, VALID))
    assert model.classes == CLASSES
    assert model.extent_m == 60
    full = np.ones((224, 224), np.uint8)
    assert model.probabilities(EMPTY)[0] > 0.99
    assert model.probabilities(full)[1] > 0.99
    assert model.probabilities(full).dtype == np.float32


def test_a_model_that_does_not_end_is_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr(model_module, "_MOST_S", 0.2)
    with pytest.raises(ModelError, match=r"it takes more than 0\.2 s for an image"):
        SceneModel(write(tmp_path, model_bytes(endless=True)))


def test_a_model_that_needs_much_memory_is_an_error(tmp_path):
    with pytest.raises(ModelError, match=r"it does not run: .*Expand"):  # an image of 1 GiB
        SceneModel(write(tmp_path, model_bytes(huge=True)))


def test_the_same_image_gives_the_same_bits(tmp_path):
    image = (np.random.default_rng(1).random((224, 224)) < 0.02).astype(np.uint8)
    first, second = (SceneModel(write(tmp_path, VALID)).probabilities(image) for _ in range(2))
    assert first.tobytes() == second.tobytes()


def metadata_with(key, value):
    return {"seaclutter.classes": '["a", "b"]', "seaclutter.extent_m": "60"} | {f"seaclutter.{key}": value}


INVALID = {
    "empty": (b"", "not a usable ONNX file"),
    "text": (b"not a model\n" * 50, "not a usable ONNX file"),
    "cut": (VALID[: len(VALID) // 2], "not a usable ONNX file"),
    "an unknown layer": (model_bytes(last="Sofdmax"), "not a usable ONNX file"),
    "smaller images": (model_bytes(shape=("N", 1, 64, 64)), r"input is tensor\(uint8\) of \['N', 1, 64, 64\]"),
    "coloured images": (model_bytes(shape=("N", 3, 224, 224)), "not a usable ONNX file"),
    "two images": (model_bytes(shape=(2, 1, 224, 224)), r"expected images of 224 by 224 bytes"),
    "floats": (model_bytes(kind=FLOAT), r"input is tensor\(float\)"),
    "no metadata": (model_bytes(metadata={}), "metadata lacks seaclutter.classes and seaclutter.extent_m"),
    "no extent": (model_bytes(metadata={"seaclutter.classes": '["a", "b"]'}), "metadata lacks seaclutter.extent_m"),
    "classes as text": (model_bytes(metadata=metadata_with("classes", "a, b")), "metadata cannot be read"),
    "classes as numbers": (model_bytes(metadata=metadata_with("classes", "[1, 2]")), "different class names"),
    "one class": (model_bytes(metadata=metadata_with("classes", '["a"]')), "different class names"),
    "the same class": (model_bytes(metadata=metadata_with("classes", '["a", "a"]')), "different class names"),
    "a class without name": (model_bytes(metadata=metadata_with("classes", '["a", ""]')), "different class names"),
    "extent 0": (model_bytes(metadata=metadata_with("extent_m", "0")), "must be positive and finite, got 0.0 m"),
    "extent nan": (model_bytes(metadata=metadata_with("extent_m", "nan")), "must be positive and finite, got nan m"),
    "extent as text": (model_bytes(metadata=metadata_with("extent_m", "wide")), "metadata cannot be read"),
    "three outputs": (model_bytes(outputs=3), "output is not 2 probabilities"),
    "no probabilities": (model_bytes(last="Identity", threshold=3.0), "output is not a probability distribution"),
}


@pytest.mark.parametrize("name", INVALID)
def test_files_that_are_not_classifiers(name, tmp_path, capfd):
    data, message = INVALID[name]
    path = write(tmp_path, data)
    with pytest.raises(ModelError, match=message) as caught:
        SceneModel(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_every_truncated_file_is_an_error(tmp_path):
    for size in range(0, len(VALID), 37):
        with pytest.raises(ModelError):
            SceneModel(write(tmp_path, VALID[:size]))


def test_control_characters_of_a_file_are_escaped(tmp_path):
    data = model_bytes(metadata=metadata_with("extent_m", "\x1b[31m\nred"))
    with pytest.raises(ModelError) as caught:
        SceneModel(write(tmp_path, data))
    assert str(caught.value).isprintable()


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(ModelError, match=r"none\.onnx: cannot be read \(No such file"):
        SceneModel(str(tmp_path / "none.onnx"))
    with pytest.raises(ModelError, match="cannot be read"):
        SceneModel(str(tmp_path))


def test_a_huge_file_is_not_read(tmp_path):
    path = tmp_path / "huge.onnx"
    with path.open("wb") as file:
        file.truncate(2**33)
    with pytest.raises(ModelError, match="larger than 64 MB"):
        SceneModel(str(path))


def test_without_onnxruntime_the_message_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(MissingExtraError) as caught:
        make_scene_tracker(SceneParams())
    assert str(caught.value) == "the scene classifier requires an optional dependency: pip install 'seaclutter[scene]'"


def test_the_configured_extent_must_be_that_of_the_model(tmp_path):
    path = write(tmp_path, VALID)
    assert make_scene_tracker(SceneParams(scene_model=path, scene_extent_m=60.0)).classes == CLASSES
    with pytest.raises(ModelError, match="covers 60 m to each side, but scene_extent_m is 50"):
        make_scene_tracker(SceneParams(scene_model=path, scene_extent_m=50.0))


def test_a_file_takes_precedence_over_a_builtin_model_of_the_same_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "open_confined").write_bytes(model_bytes(("a", "b")))
    assert SceneModel("open_confined").classes == ("a", "b")


def test_builtin_models_are_small_and_valid():
    assert "open_confined" in builtin_models()
    for path in builtin_models().values():
        assert path.stat().st_size < 1e6
        assert SceneModel(path.stem).classes == CLASSES


def test_class_names_may_contain_any_letter(tmp_path):
    names = ["Gewässer", "río"]
    assert SceneModel(write(tmp_path, model_bytes(names))).classes == tuple(names)
    assert json.dumps(names).isascii()
