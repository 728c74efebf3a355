"""``classify train`` and ``predict``: from labelled tiles to classified objects."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from seaclutter_cli.sources.frame_files import FRAME_READERS
from tests.airborne.tiles import box, read, sea, write
from tests.running import execute as run

pytest.importorskip("skops")
pytest.importorskip("sklearn")

SCENE = """
tile: {size_m: [200, 150], gap_m: 8}
lidar: {pulses_m2: 1.0}
random: {ship: 2, shoal: 1, reef: 2}
"""


@pytest.fixture(scope="module")
def tiles(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tiles")
    (folder / "scene.yaml").write_text(SCENE)
    for seed in range(5):
        run("simulate", folder / "scene.yaml", "-o", folder / f"t{seed}.laz", "--seed", seed, code=0)
    return folder


@pytest.fixture(scope="module")
def trained(tiles):
    """Return the path of a model and its test report."""
    files = [tiles / f"t{seed}.laz" for seed in range(4)]
    model, plot = tiles / "model.skops", tiles / "confusion.png"
    result = run("classify", "train", *files, "-o", model, "--plot", plot, "--json", "-s", "forest.trees=20", code=0)
    return model, json.loads(result.stdout)


def test_the_report(trained, tiles):
    _, report = trained
    assert report["held_out"] == "tile"
    assert [row["class"] for row in report["classes"]] == ["ship", "reef", "shoal"]
    assert report["accuracy"] > 0.6
    matrix = np.array(report["confusion"])
    assert matrix.sum() == report["points_tested"]
    assert [row["points"] for row in report["classes"]] == matrix.sum(axis=1).tolist()
    assert sum(report["importances"].values()) == pytest.approx(1, abs=0.01)
    assert (tiles / "confusion.png").read_bytes().startswith(b"\x89PNG")


def test_training_again_gives_the_same_model(trained, tiles):
    files = [tiles / f"t{seed}.laz" for seed in range(4)]
    result = run("classify", "train", *files, "-o", tiles / "again.skops", "-s", "forest.trees=20")
    assert "overall accuracy" in result.stdout
    assert "points    object F1" in result.stdout
    assert all(len(line) <= 80 for line in result.stdout.splitlines())
    one, other = (
        run("classify", "predict", tiles / "t4.laz", "--model", m, "-o", tiles / "o.laz", "--json", "--force")
        for m in (trained[0], tiles / "again.skops")
    )
    assert one.stdout == other.stdout
    assert trained[0].read_bytes() == (tiles / "again.skops").read_bytes()


def test_predict_writes_points_objects_and_a_picture(trained, tiles, tmp_path):
    out = [tmp_path / name for name in ("out.laz", "o.csv", "o.geojson", "o.png")]
    options = zip(("-o", "--csv", "--geojson", "--plot"), out, strict=True)
    run("classify", "predict", tiles / "t4.laz", "--model", trained[0], *(x for pair in options for x in pair), code=0)
    one, other = read(tiles / "t4.laz"), read(out[0])
    for name in one.point_format.dimension_names:
        if name != "classification":
            np.testing.assert_array_equal(one[name], other[name], err_msg=name)
    names = ("predicted_class", "probability", "predicted_object")
    predicted, probability, number = (np.asarray(other[name]) for name in names)
    water = np.asarray(other.classification) == 9
    assert (predicted[water] == 0).all()
    assert set(predicted[~water]) <= {1, 2, 3}
    assert ((probability > 0) == ~water).all()
    assert probability.max() <= 1
    truth = np.asarray(one["object_class"])
    assert (predicted == truth)[~water & (truth > 0)].mean() > 0.7
    rows = list(csv.DictReader(out[1].open()))
    assert len(rows) == number.max() == len(json.loads(out[2].read_text())["features"])
    counts = np.bincount(number)[1:]
    assert [int(row["points"]) for row in rows] == counts.tolist()
    for row in rows:
        members = number == int(row["object"])
        assert abs(np.asarray(one.x)[members].mean() - float(row["x"])) < 15
    assert out[3].read_bytes().startswith(b"\x89PNG")


def test_clusters_that_are_left_out_are_reported(trained, tiles, tmp_path):
    predict = ("classify", "predict", tiles / "t0.laz", "--model", trained[0], "--force", "-o", tmp_path / "o.laz")
    strict = (*predict, "--plot", tmp_path / "o.svg", "-s", "objects.min_probability=1")
    kept, none = (json.loads(run(*options, "--json").stdout)[0] for options in (predict, strict))
    assert none["objects"] == []
    assert none["clusters_left_out"] == len(kept["objects"]) + kept["clusters_left_out"] > 1
    points = sum(one["points"] for one in kept["objects"]) + kept["points_left_out"]
    assert none["points_left_out"] == points
    message = f"{none['clusters_left_out']} clusters left out: {points:,} points, probability below 1 (objects.min_prob"
    assert message in run(*strict).stdout
    picture = (tmp_path / "o.svg").read_text()
    assert "<!-- left out -->" in picture
    assert "<!-- ship -->" not in picture


def test_objects_are_listed_with_numbers_in_80_columns():
    from seaclutter_cli.airborne.objects import FoundObject
    from seaclutter_cli.runs.classify.maps import MappedTile
    from seaclutter_cli.runs.classify.predict import ClassifiedTile
    from seaclutter_cli.sources.tiles import Crs

    far = FoundObject(1, 7, 0.621, 123456, (833978.4, 9997964.9), (1234.5, 234.5), 0.1, 12.34, 123456.7)
    objects = [replace(far, number=number) for number in range(1, 100)]
    found = MappedTile("t", Crs(), (), objects)
    tile = ClassifiedTile(recording="t", points=3, clusters_left_out=1, points_left_out=2, map=found)
    lines = tile.described(0.4).splitlines()
    assert max(map(len, lines)) <= 80
    assert " ".join(lines[2].split()) == "1 fishing fence 0.62 123,456 833978 9997965 1234.5 234.5 12.3 123,457"
    assert lines[-3].startswith("99 fishing fence")
    assert lines[-2] == "1 cluster left out: 2 points, probability below 0.4 (objects.min_probability)"


def test_predict_takes_other_clouds(trained, tmp_path):
    rng = np.random.default_rng(3)
    xyz = np.concatenate([sea(rng), box(rng, (20, 30), (10, 40), (2, 3))])
    write(tmp_path / "tile.las", xyz, point_format=1)
    run("classify", "separate", tmp_path / "tile.las", "-o", tmp_path / "tile.ply")
    run("classify", "predict", tmp_path / "tile.ply", "--model", trained[0], "-o", tmp_path / "o.pcd", code=0)
    points = FRAME_READERS[".pcd"](tmp_path / "o.pcd").points
    assert {"predicted_class", "probability", "predicted_object", "gps_time"} <= set(points.dtype.names)


def test_a_tile_of_sea_has_no_objects(trained, tmp_path):
    tile = write(tmp_path / "sea.laz", sea(np.random.default_rng(1)))
    options = ("--csv", tmp_path / "o.csv", "--plot", tmp_path / "o.png")
    result = run("classify", "predict", tile, "--model", trained[0], "-o", tmp_path / "o.laz", *options, code=0)
    assert "no objects" in result.stdout
    assert (tmp_path / "o.csv").read_text().count("\n") == 1


def test_a_model_trained_with_other_features_is_refused(trained, tiles, tmp_path):
    for setting in ("features.features=texture", "features.radius_m=2"):
        result = run(
            "classify", "predict", tiles / "t4.laz", "--model", trained[0], "-o", tmp_path / "o.laz", "-s", setting
        )
        assert (result.exit_code, "was trained with other features" in result.stderr) == (2, True)
    ok = ("-s", "objects.min_points=40", "-s", "separation.height_m=0.6")
    run("classify", "predict", tiles / "t4.laz", "--model", trained[0], "-o", tmp_path / "o.laz", *ok, code=0)


def test_texture_alone(tiles, tmp_path):
    files = [tiles / f"t{seed}.laz" for seed in range(4)]
    settings = ("-s", "features.features=texture", "-s", "forest.trees=10")
    result = run("classify", "train", *files, "-o", tmp_path / "m", "--json", *settings)
    assert list(json.loads(result.stdout)["importances"]) == ["homogeneity", "dissimilarity", "second_moment"]
    run("classify", "predict", tiles / "t4.laz", "--model", tmp_path / "m", "-o", tmp_path / "o.laz", code=0)


def labelled(path, codes, **kwargs):
    """Write a tile with boxes of the given classes."""
    rng = np.random.default_rng(4)
    boxes = [box(rng, (10 + 15 * k, 16 + 15 * k), (10, 30), (1 + k, 2 + k), 200) for k in range(len(codes))]
    xyz = np.concatenate([sea(rng), *boxes])
    truth = np.concatenate([np.zeros(4000), np.repeat(codes, 200)])
    return write(path, xyz, extra=[("object_class", "u1", truth)], **kwargs)


def test_objects_without_numbers_are_clusters(tmp_path):
    tile = labelled(tmp_path / "t.laz", [1, 1, 2])
    result = run("classify", "train", tile, "-o", tmp_path / "m", "--json", "-s", "forest.trees=5", code=0)
    report = json.loads(result.stdout)
    assert (report["held_out"], report["points_tested"]) == ("object", 200)


def test_bad_tiles_for_training(tmp_path):
    plain = write(tmp_path / "plain.laz", sea(np.random.default_rng(1)))
    cases = {
        plain: "no field 'object_class' with ground truth",
        labelled(tmp_path / "one.laz", [2, 2, 2]): "all objects are of one class (reef)",
        labelled(tmp_path / "none.laz", [0, 0, 0]): "no labelled points",
        labelled(tmp_path / "nine.laz", [1, 2, 9]): "classes are 1 to 8",
    }
    train = ("classify", "train", "-o", tmp_path / "m")
    for tile, message in cases.items():
        result = run(*train, tile)
        assert (result.exit_code, message in result.stderr) == (1, True), result.stderr
    (tmp_path / "empty").mkdir()
    assert "empty: no tile found; supported suffixes:" in run(*train, tmp_path / "empty").stderr
    assert "none.las: no such file or folder" in run(*train, tmp_path / "none.las").stderr
    assert not (tmp_path / "m").exists()


def test_classes_that_could_not_be_tested_are_reported(tmp_path):
    tile = labelled(tmp_path / "t.laz", [1, 1, 2])
    result = run("classify", "train", tile, "-o", tmp_path / "m", "-s", "forest.trees=5")
    assert "no points of reef were held out" in result.stderr
    assert "kappa –\n" in result.stdout, "a test with ships only has no kappa"
    assert all(len(line) <= 80 for line in result.stdout.splitlines())


def test_without_held_out_data_there_is_no_test(tmp_path):
    tile = labelled(tmp_path / "t.laz", [1, 2])
    train = ("classify", "train", tile, "-s", "forest.trees=5", "--force", "-o", tmp_path / "m")
    result = run(*train, "--plot", tmp_path / "p.png", code=0)
    assert result.stdout == "trained on 400 points; no test, because nothing could be held out\n"
    assert "no class has two objects; train on more tiles, or on more objects" in result.stderr
    assert "p.png: not drawn" in result.stderr
    assert not (tmp_path / "p.png").exists()
    assert (tmp_path / "m").exists()
    report = json.loads(run(*train, "--json").stdout)
    assert (report["held_out"], report["points_tested"], report["kappa"]) == (None, 0, None)


def test_an_output_cannot_replace_an_input_or_another_output(trained, tiles, tmp_path):
    model, settings = trained[0], _file(tmp_path, "objects: {min_points: 9}")
    before = model.read_bytes()
    predict = ("classify", "predict", tiles / "t4.laz", "--model", model, "-c", settings, "--force")
    for name in (model, settings, tiles / "t4.laz"):
        result = run(*predict, "-o", tmp_path / "o.laz", "--csv", name)
        assert (result.exit_code, "is part of the input" in result.stderr) == (2, True)
    result = run(*predict, "-o", tmp_path / "o.laz", "--geojson", tmp_path / "." / "o.laz")
    assert (result.exit_code, "is given for two outputs" in result.stderr) == (2, True)
    result = run("classify", "train", tiles / "t4.laz", "-c", settings, "-o", settings, "--force")
    assert (result.exit_code, "is part of the input" in result.stderr) == (2, True)
    assert (model.read_bytes(), settings.read_text()) == (before, "objects: {min_points: 9}")


def test_bad_command_lines(trained, tiles, tmp_path):
    predict = ("classify", "predict", tiles / "t4.laz", "-o", tmp_path / "o.laz")
    (tmp_path / "text").write_text("not a model")
    assert "not a seaclutter model" in run(*predict, "--model", tmp_path / "text").stderr
    result = run(*predict, "--model", tmp_path)
    assert (result.exit_code, "is a directory" in result.stderr) == (2, True)
    both = ("classify", "predict", tiles / "t3.laz", tiles / "t4.laz", "-o", tmp_path / "o", "--model", trained[0])
    assert "needs a single tile, got 2" in run(*both, "--plot", tmp_path / "p.png").stderr
    assert "must end in .png or .svg" in run(*predict, "--model", trained[0], "--plot", tmp_path / "p.gif").stderr
    assert "unknown section" in run(*predict, "--model", trained[0], "-c", _file(tmp_path, "filter: {}")).stderr
    assert "write it as SECTION.KEY=VALUE" in run(*predict, "--model", trained[0], "-s", "radius=3").stderr
    assert not (tmp_path / "o.laz").exists()


def _file(folder, text):
    (folder / "settings.yaml").write_text(text)
    return folder / "settings.yaml"


def test_without_the_extra(tiles, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "sklearn.ensemble", None)
    result = run("classify", "train", tiles / "t0.laz", tiles / "t1.laz", "-o", tmp_path / "m")
    assert (result.exit_code, "seaclutter[classify]" in result.stderr) == (1, True)
