"""Split by tile and object, training, and model files."""

import hashlib
import io
import os
import subprocess
import sys
import warnings
import zipfile
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from seaclutter_cli.airborne.features import FeatureParams
from seaclutter_cli.airborne.forest import ForestParams, Samples, join, predict, split_samples, train
from seaclutter_cli.airborne.model import ObjectModel, load_model
from seaclutter_cli.airborne.settings import TileSettings
from seaclutter_cli.errors import InputError
from tests.paths import ROOT

PARAMS = ForestParams(trees=8, max_points_per_object=40)


def samples(tiles=1, objects=4, points=30, classes=(1, 2, 3), width=14, seed=0):
    rng = np.random.default_rng(seed)
    shape = (tiles, len(classes), objects, points)
    tile, kind, one, _ = (axis.reshape(-1) for axis in np.indices(shape))
    code = np.array(classes)[kind]
    features = rng.normal(size=(tile.size, width)) + code[:, None]
    return Samples(features, code, tile, kind * objects + one + 1)


@pytest.mark.parametrize(("tiles", "split"), [(1, "object"), (3, "object"), (4, "tile"), (9, "tile")])
def test_whole_tiles_or_objects_are_held_out(tiles, split):
    data = samples(tiles)
    test, unit = split_samples(data, PARAMS)
    assert unit == split
    assert set(data.code[test]) == set(data.code[~test]) == {1, 2, 3}
    pairs = [set(zip(data.tile[part].tolist(), data.number[part].tolist(), strict=True)) for part in (test, ~test)]
    assert not pairs[0] & pairs[1], "an object is in both parts"
    if split == "tile":
        assert not set(data.tile[test]) & set(data.tile[~test])
    assert 0.15 < test.mean() < 0.45


def test_every_class_is_trained_on_even_if_it_has_one_object():
    data = samples(1, objects=1)
    test, split = split_samples(data, PARAMS)
    assert (test.any(), split) == (False, "object")


def test_tiles_are_not_held_out_if_a_class_would_be_missing():
    data = samples(4)
    code = np.where((data.code == 3) & (data.tile != 2), 2, data.code)
    for seed in range(5):
        test, _ = split_samples(replace(data, code=code), replace(PARAMS, seed=seed))
        assert 3 in code[~test]


def test_points_of_no_object_are_left_out_and_one_class_is_refused():
    data = samples()
    data.code[:10] = 0
    assert len(join([data, data]).code) == 2 * (len(data.code) - 10)
    with pytest.raises(InputError, match="no labelled points"):
        join([replace(data, code=np.zeros_like(data.code))])
    with pytest.raises(InputError, match=r"one class \(reef\)"):
        join([replace(data, code=np.full_like(data.code, 2))])


def test_training_is_the_same_each_time_and_for_any_number_of_threads(monkeypatch):
    pytest.importorskip("sklearn")
    data = samples(2)
    found = []
    for threads in (1, 2, 3):
        monkeypatch.setenv("SEACLUTTER_THREADS", str(threads))
        monkeypatch.setattr("seaclutter_cli.airborne.forest._BLOCK", 100)
        found.append(predict(train(data, PARAMS), data.features).tobytes())
    assert found[0] == found[1] == found[2]


def test_a_large_object_does_not_outweigh_the_others():
    """The bootstrap draws as many samples as there are training points."""
    pytest.importorskip("sklearn")
    large = samples(1, objects=1, points=5000, classes=(1,))
    small = samples(1, objects=3, points=30, classes=(2,))
    together = Samples(
        *(np.concatenate([getattr(p, n) for p in (large, small)]) for n in ("features", "code", "tile", "number"))
    )
    together.number[5000:] += 1
    forest = train(together, PARAMS)
    assert int(forest.estimators_[0].tree_.n_node_samples[0]) <= 40 + 90


def model(features="full"):
    pytest.importorskip("skops")
    settings = replace(TileSettings(), features=FeatureParams(features=features), forest=PARAMS)
    data = samples(width=len(settings.features.names))
    return ObjectModel(settings, train(data, PARAMS)), data


@cache
def written(features="full"):
    """Return a model, which tests leave as it is, the data that it was trained on, and the content of its file."""
    one, data = model(features)
    return one, data, one.to_bytes()


@pytest.mark.parametrize("features", ["texture", "full"])
def test_a_model_is_read_with_its_settings(tmp_path, features):
    one, data, content = written(features)
    (tmp_path / "m").write_bytes(content)
    again = load_model(tmp_path / "m")
    assert again.settings == one.settings
    np.testing.assert_array_equal(predict(again.forest, data.features), predict(one.forest, data.features))


def rewritten(data, change):
    """Return the content of a model file with its schema changed as text."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(out, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            new.writestr(name, change(content.decode()).encode() if name == "schema.json" else content)
    return out.getvalue()


def test_a_file_that_names_other_code_is_refused_before_any_of_it_runs(tmp_path):
    *_, content = written()
    change = lambda text: text.replace("RandomForestClassifier", "Popen").replace(
        "sklearn.ensemble._forest", "subprocess"
    )
    (tmp_path / "m").write_bytes(rewritten(content, change))
    with pytest.raises(InputError, match=r"refused.*subprocess.Popen"):
        load_model(tmp_path / "m")


def test_a_model_for_other_features_is_refused(tmp_path):
    one, _, content = written()
    (tmp_path / "m").write_bytes(rewritten(content, lambda text: text.replace("planarity", "colour")))
    with pytest.raises(InputError, match="its features differ"):
        load_model(tmp_path / "m")
    texture, *_ = written("texture")
    (tmp_path / "n").write_bytes(ObjectModel(one.settings, texture.forest).to_bytes())
    with pytest.raises(InputError, match="not a random forest of 14 features"):
        load_model(tmp_path / "n")


def test_a_tree_that_never_ends_is_refused(tmp_path):
    one, _ = model()
    one.forest.estimators_[0].tree_.children_left[0] = 0
    (tmp_path / "m").write_bytes(one.to_bytes())
    with pytest.raises(InputError, match="a tree is damaged"):
        load_model(tmp_path / "m")


@pytest.mark.parametrize("content", [b"", b"PK", b"pickle", None])
def test_files_that_are_not_models(tmp_path, content):
    pytest.importorskip("skops")
    if content is not None:
        (tmp_path / "m").write_bytes(content)
    with pytest.raises(InputError, match=r"not a seaclutter model|cannot be read"):
        load_model(tmp_path / "m")


def test_a_model_is_written_with_the_same_bytes_in_another_process():
    """Neither addresses nor the time nor unused memory are part of a model file."""
    code = "import hashlib; from tests.airborne.test_forest import model; data = model()[0].to_bytes()"
    command = [sys.executable, "-c", f"{code}; print(hashlib.sha256(data).hexdigest())"]
    environment = {**os.environ, "PYTHONHASHSEED": "7", "PYTHONMALLOC": "malloc"}
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env=environment, check=True)
    data = model()[0].to_bytes()
    assert done.stdout.strip() == hashlib.sha256(data).hexdigest()
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        assert {member.date_time[0] for member in archive.infolist()} == {1980}


def test_a_model_of_another_version_of_scikit_learn_is_loaded_with_one_warning(tmp_path):
    one, data, content = written()
    change = lambda text: text.replace(f'\\"{sklearn_version()}\\"', '\\"1.0.7\\"')
    (tmp_path / "m").write_bytes(rewritten(content, change))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        again = load_model(tmp_path / "m")
    (text,) = again.warnings
    assert "trained with scikit-learn 1.0.7" in text
    np.testing.assert_array_equal(predict(again.forest, data.features), predict(one.forest, data.features))


def sklearn_version():
    return pytest.importorskip("sklearn").__version__


def test_a_model_that_unpacks_to_much_more_is_refused(tmp_path):
    *_, content = written()
    (tmp_path / "m").write_bytes(rewritten(content, lambda text: text + " " * 70_000_000))
    with zipfile.ZipFile(tmp_path / "m") as archive, zipfile.ZipFile(tmp_path / "n", "w", zipfile.ZIP_DEFLATED) as new:
        for name in archive.namelist():
            new.writestr(name, archive.read(name))
    with pytest.raises(InputError, match=r"not a seaclutter model.*unpack to"):
        load_model(tmp_path / "n")
