"""Several tiles in one run: outputs do not depend on the number of processes; those of predict appear together."""

import json
import math
import re
import shutil

import pytest

from seaclutter_cli.commands import console
from tests.airborne.tiles import read
from tests.paths import ROOT
from tests.running import execute as invoke

pytest.importorskip("laspy")


@pytest.fixture(autouse=True)
def _no_progress(monkeypatch):
    """Show no progress, which would be a line after ten seconds, on slow machines only."""
    monkeypatch.setattr(console, "_LINE_SECONDS", math.inf)


@pytest.fixture(scope="module")
def tiles(tmp_path_factory):
    """Return a folder with three tiles of a corner of the sample."""
    folder = tmp_path_factory.mktemp("tiles")
    tile = read(ROOT / "samples" / "tile.laz")
    tile.points = tile.points[(tile.x < tile.x.min() + 90) & (tile.y > tile.y.max() - 150)]
    for name in "abc":
        tile.write(folder / f"{name}.laz")
    return folder


@pytest.fixture(scope="module")
def model(tiles):
    """Return a model that was trained on one of the tiles."""
    pytest.importorskip("skops")
    path = tiles.parent / "model.skops"
    invoke("classify", "train", tiles / "a.laz", "-s", "forest.trees=5", "-o", path, "--force", code=0)
    return path


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_separation(tiles, tmp_path):
    found = []
    for jobs in (1, 2):
        result = invoke("classify", "separate", tiles, "-o", f"{tmp_path / str(jobs)}/", "-j", jobs, "--json", code=0)
        assert sorted(line.split(":")[0] for line in result.stderr.splitlines()) == ["a", "b", "c"]
        rows = [{key: row[key] for key in ("tile", "points", "sea", "other")} for row in json.loads(result.stdout)]
        outputs = [row["output"] for row in json.loads(result.stdout)]
        assert outputs == [str(tmp_path / str(jobs) / f"{name}.laz") for name in "abc"]
        found.append((contents(tmp_path / str(jobs)), rows))
    assert found[0] == found[1]
    assert sorted(found[0][0]) == ["a.laz", "b.laz", "c.laz"]


def test_classification(tiles, model, tmp_path):
    found = []
    for jobs in (1, 2):
        folder = tmp_path / str(jobs)
        table = tmp_path / f"{jobs}.csv"
        line = ("classify", "predict", tiles, "--model", model, "-o", f"{folder}/", "--csv", table, "-j", jobs)
        result = invoke(*line, code=0)
        found.append((contents(folder), table.read_bytes(), re.sub(r"in [\d.]+ s", "", result.stdout)))
    assert found[0] == found[1]


def test_an_error_in_one_tile_does_not_stop_the_others(tiles, model, tmp_path):
    shutil.copytree(tiles, tmp_path / "in")
    tiles = tmp_path / "in"
    (tiles / "b.laz").write_bytes((tiles / "a.laz").read_bytes()[:1000])
    table, out = tmp_path / "objects.csv", tmp_path / "out"
    line = ("classify", "predict", tiles, "--model", model, "-o", f"{out}/", "--csv", table)
    result = invoke(*line, "-j", 2, code=1)
    assert next(line for line in result.stderr.splitlines() if line.startswith("Error: ")).startswith(
        f"Error: {tiles}/b.laz"
    )
    others = {path.name for path in tiles.iterdir()} - {"b.laz"}
    assert set(contents(out)) == others
    assert {row.partition(",")[0] for row in table.read_text().splitlines()[1:]} <= {name[:-4] for name in others}
    table.write_text("of an earlier run")
    assert "objects.csv: not replaced" in invoke(*line, "-j", 1, "--force", code=1).stderr
    assert table.read_text() == "of an earlier run"


def test_existing_outputs_are_not_replaced(tiles, tmp_path, monkeypatch):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "b.laz").write_bytes(b"important")
    line = ("classify", "separate", tiles, "-o", f"{tmp_path / 'out'}/")
    invoke(*line, "-j", 2, code=2)
    assert contents(tmp_path / "out") == {"b.laz": b"important"}
    monkeypatch.setattr(console, "_LINE_SECONDS", 0.0)
    result = invoke(*line, "-j", 1, "--force", code=0)
    assert "3 tiles: tile 3 of 3\n" in result.stderr
    assert "recording" not in result.stderr
    assert len(contents(tmp_path / "out")["b.laz"]) > 1000
