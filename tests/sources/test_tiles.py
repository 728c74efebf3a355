"""Tiles that names, folders and globs refer to."""

from pathlib import Path

import pytest

from seaclutter_cli.errors import InputError, SeaclutterError
from seaclutter_cli.sources.tiles import find_tiles


def test_tiles_of_folders_and_globs_are_found_once_in_order(tmp_path):
    for name in ("b.laz", "a.LAS", "notes.txt"):
        (tmp_path / name).touch()
    found = find_tiles([str(tmp_path / "b*"), str(tmp_path)])
    assert [path.name for path in found] == ["b.laz", "a.LAS"]


def test_a_tile_with_two_names_is_found_once(tmp_path, monkeypatch):
    (tmp_path / "a.las").touch()
    monkeypatch.chdir(tmp_path)
    assert find_tiles(["a.las", tmp_path]) == [Path("a.las")]


def test_a_single_name_is_a_tile_or_folder(tmp_path):
    (tmp_path / "a.las").touch()
    assert find_tiles(str(tmp_path)) == find_tiles(tmp_path) == find_tiles([tmp_path]) == [tmp_path / "a.las"]


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("none.las", "no such file or folder"),
        ("*.las", "no file matches this pattern"),
        ("", "no tile found; supported suffixes: .pcd"),
        ("notes.txt", "no tile found; supported suffixes: .pcd"),
    ],
)
def test_names_of_no_tile(tmp_path, name, reason):
    (tmp_path / "notes.txt").touch()
    with pytest.raises(SeaclutterError, match=reason):
        find_tiles([tmp_path / name])


def refused(name):
    with pytest.raises(InputError) as caught:
        find_tiles([str(name)])
    return str(caught.value)


@pytest.mark.parametrize("name", ["", "ept.json"])
def test_entwine_point_tiles_are_refused(tmp_path, name):
    (tmp_path / "ept-data").mkdir()
    (tmp_path / "ept.json").write_text("{}")
    assert "Entwine point tiles (EPT) are not read" in refused(tmp_path / name)


def test_urls_are_refused():
    assert refused("s3://bucket/harbour.laz").startswith("s3://bucket/harbour.laz: tiles are read from local files")
    assert "EPT" in refused("https://example.org/harbour/ept.json")
