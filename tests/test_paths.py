"""One file under several paths."""

import os

import pytest

from seaclutter_cli import paths
from seaclutter_cli.paths import Identities, files_in


def identity(path):
    return Identities().of(path)


POSIX = pytest.mark.skipif(os.name != "posix", reason="links need rights on Windows")


def test_files_that_do_not_exist_are_told_apart_by_their_folder_and_name(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    files = [tmp_path / "a" / "x", tmp_path / "a" / "y", tmp_path / "b" / "x", tmp_path / "a" / "new" / "x"]
    assert len({identity(path) for path in files}) == 4
    assert identity(files[0]) == identity(tmp_path / "a" / "x")


@POSIX
def test_hard_links_are_the_paths(tmp_path):
    (tmp_path / "x").touch()
    os.link(tmp_path / "x", tmp_path / "y")
    assert identity(tmp_path / "x") == identity(tmp_path / "y")


def test_where_case_is_ignored_names_are_compared_without_it(tmp_path, monkeypatch):
    assert identity(tmp_path / "Out.csv") != identity(tmp_path / "out.CSV") or os.name == "nt"
    monkeypatch.setattr(paths, "_ignores_case", lambda _: True)
    assert identity(tmp_path / "Out.csv") == identity(tmp_path / "out.CSV")
    assert identity(tmp_path / "New" / "x") == identity(tmp_path / "new" / "X")


@POSIX
def test_case_is_ignored_if_a_folder_has_both_names(tmp_path):
    (tmp_path / "Folder").mkdir()
    assert not paths._ignores_case(tmp_path / "Folder")
    (tmp_path / "fOLDER").symlink_to("Folder")
    assert paths._ignores_case(tmp_path / "Folder")


@POSIX
def test_files_of_folders(tmp_path):
    (tmp_path / "folder" / "inner").mkdir(parents=True)
    for name in ("one", "folder/two", "folder/inner/three"):
        (tmp_path / name).touch()
    (tmp_path / "folder" / "link").symlink_to(tmp_path / "one")
    (tmp_path / "folder" / "broken").symlink_to("none")
    expected = {identity(tmp_path / name) for name in ("one", "folder/two", "folder/inner/three")}
    assert set(files_in(tmp_path / "folder")) == expected
    assert set(files_in(tmp_path / "one")) == set()
