"""ONNX files of classifiers: what is no classifier of this program is told in one line."""

import json
import sys

import numpy as np
import pytest

from seaclutter_cli.errors import MissingExtraError, ModelError
from seaclutter_cli.scenes import SceneParams, make_scene_tracker
from seaclutter_cli.scenes.model import SceneModel, builtin_models
from tests.scenes.onnx_files import CLASSES, FLOAT, model_bytes

pytest.importorskip("onnxruntime", reason="needs the extra scene")

NOTHING = np.zeros((224, 224), np.uint8)
SOUND = model_bytes()


def write(tmp_path, data):
    path = tmp_path / "model.onnx"
    path.write_bytes(data)
    return str(path)


def test_a_sound_file(tmp_path):
    model = SceneModel(write(tmp_path, SOUND))
    assert model.classes == CLASSES
    assert model.extent_m == 60
    full = np.ones((224, 224), np.uint8)
    assert model.probabilities(NOTHING)[0] > 0.99
    assert model.probabilities(full)[1] > 0.99
    assert model.probabilities(full).dtype == np.float32


def test_the_same_image_gives_the_same_bits(tmp_path):
    image = (np.random.default_rng(1).random((224, 224)) < 0.02).astype(np.uint8)
    first, second = (SceneModel(write(tmp_path, SOUND)).probabilities(image) for _ in range(2))
    assert first.tobytes() == second.tobytes()


def said(key, value):
    return {"seaclutter.classes": '["a", "b"]', "seaclutter.extent_m": "60"} | {f"seaclutter.{key}": value}


FOREIGN = {
    "nothing in it": (b"", "no ONNX file that can be used"),
    "text": (b"not a model\n" * 50, "no ONNX file that can be used"),
    "cut": (SOUND[: len(SOUND) // 2], "no ONNX file that can be used"),
    "an unknown layer": (model_bytes(last="Sofdmax"), "no ONNX file that can be used"),
    "smaller images": (model_bytes(shape=("N", 1, 64, 64)), r"takes tensor\(uint8\) of \['N', 1, 64, 64\]"),
    "coloured images": (model_bytes(shape=("N", 3, 224, 224)), "no ONNX file that can be used"),
    "two images": (model_bytes(shape=(2, 1, 224, 224)), r"not images of 224 by 224 bytes"),
    "floats": (model_bytes(kind=FLOAT), r"takes tensor\(float\)"),
    "no metadata": (model_bytes(metadata={}), "metadata has no seaclutter.classes and no seaclutter.extent_m"),
    "no extent": (model_bytes(metadata={"seaclutter.classes": '["a", "b"]'}), "has no seaclutter.extent_m"),
    "classes as text": (model_bytes(metadata=said("classes", "a, b")), "metadata cannot be read"),
    "classes as numbers": (model_bytes(metadata=said("classes", "[1, 2]")), "names no two different classes"),
    "one class": (model_bytes(metadata=said("classes", '["a"]')), "names no two different classes"),
    "the same class": (model_bytes(metadata=said("classes", '["a", "a"]')), "names no two different classes"),
    "a class without name": (model_bytes(metadata=said("classes", '["a", ""]')), "names no two different classes"),
    "extent 0": (model_bytes(metadata=said("extent_m", "0")), "an extent of 0.0 m"),
    "extent nan": (model_bytes(metadata=said("extent_m", "nan")), "an extent of nan m"),
    "extent as text": (model_bytes(metadata=said("extent_m", "wide")), "metadata cannot be read"),
    "three outputs": (model_bytes(outputs=3), "does not give 2 probabilities"),
    "no probabilities": (model_bytes(last="Identity", turn_at=3.0), "what it gives are no probabilities"),
}


@pytest.mark.parametrize("name", FOREIGN)
def test_damaged_and_foreign_files(name, tmp_path, capfd):
    data, why = FOREIGN[name]
    path = write(tmp_path, data)
    with pytest.raises(ModelError, match=why) as caught:
        SceneModel(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_every_cut_is_an_error(tmp_path):
    for size in range(0, len(SOUND), 37):
        with pytest.raises(ModelError):
            SceneModel(write(tmp_path, SOUND[:size]))


def test_control_characters_of_a_file_stay_in_it(tmp_path):
    data = model_bytes(metadata=said("extent_m", "\x1b[31m\nred"))
    with pytest.raises(ModelError) as caught:
        SceneModel(write(tmp_path, data))
    assert str(caught.value).isprintable()


def test_no_such_file(tmp_path):
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


def test_without_onnxruntime_one_line_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(MissingExtraError) as caught:
        make_scene_tracker(SceneParams())
    assert str(caught.value) == "the scene classifier needs an optional part: pip install 'seaclutter[scene]'"


def test_the_extent_of_the_configuration_has_to_be_that_of_the_model(tmp_path):
    path = write(tmp_path, SOUND)
    assert make_scene_tracker(SceneParams(scene_model=path, scene_extent_m=60.0)).classes == CLASSES
    with pytest.raises(ModelError, match="sees 60 m to each side, scene_extent_m is 50"):
        make_scene_tracker(SceneParams(scene_model=path, scene_extent_m=50.0))


def test_a_file_goes_before_a_builtin_model_of_its_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "open_confined").write_bytes(model_bytes(("a", "b")))
    assert SceneModel("open_confined").classes == ("a", "b")


def test_builtin_models_are_small_and_sound():
    assert "open_confined" in builtin_models()
    for path in builtin_models().values():
        assert path.stat().st_size < 1e6
        assert SceneModel(path.stem).classes == CLASSES


def test_metadata_may_hold_any_name(tmp_path):
    names = ["Gewässer", "río"]
    assert SceneModel(write(tmp_path, model_bytes(names))).classes == tuple(names)
    assert json.dumps(names).isascii()
