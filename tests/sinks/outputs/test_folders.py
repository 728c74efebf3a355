"""Folders that appear when they are complete."""

import itertools
import os
import signal
import sys
from pathlib import Path

import pytest

from seaclutter_cli import parts
from seaclutter_cli.errors import OutputError
from seaclutter_cli.parts import remove_stale
from seaclutter_cli.sinks.atomic import AtomicFile, AtomicFolder, OutputGroup


def write(target, *names, group=None, error=None):
    with AtomicFolder(target, group) as folder:
        for name in names:
            with folder.open(name) as file:
                file.write(name.encode())
        assert not (target / names[0]).exists() or target.exists()
        if error:
            raise error


def tree(folder):
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*"))


def test_a_folder_appears_complete(tmp_path):
    with AtomicFolder(tmp_path / "out") as folder:
        folder.open("a").close()
        assert not (tmp_path / "out").exists()
    assert tree(tmp_path) == ["out", "out/a"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, MemoryError])
def test_an_error_leaves_nothing_and_changes_nothing(tmp_path, error):
    with pytest.raises(error):
        write(tmp_path / "out", "a", error=error())
    assert tree(tmp_path) == []
    write(tmp_path / "out", "old")
    with pytest.raises(error):
        write(tmp_path / "out", "new", error=error())
    assert tree(tmp_path) == ["out", "out/old"]


def test_a_folder_is_replaced_as_a_whole(tmp_path):
    write(tmp_path / "out", "old")
    write(tmp_path / "out", "new")
    assert tree(tmp_path) == ["out", "out/new"]


@pytest.fixture
def in_steps(monkeypatch):
    """Let the system be unable to exchange two names."""
    monkeypatch.setattr(parts, "_exchanged", lambda *_: False)


@pytest.mark.usefixtures("in_steps")
def test_a_folder_is_replaced_in_steps(tmp_path):
    write(tmp_path / "out", "old")
    write(tmp_path / "out", "new")
    assert tree(tmp_path) == ["out", "out/new"]


@pytest.mark.skipif(sys.platform != "linux", reason="other systems may have no such function")
def test_linux_exchanges_names_in_one_step(tmp_path, monkeypatch):
    monkeypatch.setattr(Path, "rename", None)
    (tmp_path / "a" / "of a").mkdir(parents=True)
    (tmp_path / "b").mkdir()
    parts.exchange(tmp_path / "b", tmp_path / "a")
    assert tree(tmp_path) == ["a", "b", "b/of a"]


@pytest.mark.usefixtures("in_steps")
@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes begin anew")
@pytest.mark.parametrize(("renamed", "left"), [(0, "old"), (1, "old"), (2, "new"), (3, "new")])
def test_a_run_that_is_killed_while_it_replaces_a_folder(tmp_path, monkeypatch, renamed, left):
    write(tmp_path / "out", "old")
    rename, count = Path.rename, itertools.count()

    def killed(self, target):
        if next(count) == renamed:
            os.kill(os.getpid(), signal.SIGKILL)
        return rename(self, target)

    child = os.fork()
    if not child:
        monkeypatch.setattr(Path, "rename", killed)
        monkeypatch.setattr(Path, "rmdir", lambda _: os.kill(os.getpid(), signal.SIGKILL))
        write(tmp_path / "out", "new")
    assert os.waitpid(child, 0)[1] == signal.SIGKILL
    assert [path.name for path in parts.take_back(tmp_path)] == (["out"] if renamed == 1 else [])
    parts.remove_stale(tmp_path, {"out"})
    assert tree(tmp_path) == ["out", f"out/{left}"]


@pytest.mark.usefixtures("in_steps")
def test_what_took_the_place_of_a_folder_that_was_moved_aside_stays(tmp_path, monkeypatch):
    write(tmp_path / "out", "old")
    write(tmp_path / "new", "new")
    aside = tmp_path / ".out.host-4194303-00000000.old"
    monkeypatch.setattr(parts, "_host", lambda: "host")
    aside.mkdir()
    (tmp_path / "out").rename(aside / "out")
    (tmp_path / "new").rename(aside.with_suffix(".part"))
    write(tmp_path / "out", "theirs")
    before = tree(tmp_path)
    assert parts.take_back(tmp_path) == []
    assert parts.remove_stale(tmp_path, {"out"}) == 0
    assert tree(tmp_path) == before


@pytest.mark.usefixtures("in_steps")
def test_the_old_folder_comes_back_if_the_new_one_cannot_be_renamed(tmp_path, monkeypatch):
    write(tmp_path / "out", "old")
    rename = Path.rename

    def fail(self, target):
        if self.name.endswith(".part") and (self / "new").exists():
            raise OSError(5, "broken")
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", fail)
    with pytest.raises(OutputError, match="broken"):
        write(tmp_path / "out", "new")
    assert tree(tmp_path) == ["out", "out/old"]


def test_a_folder_that_appears_meanwhile_is_not_replaced(tmp_path):
    group = OutputGroup(replace=False)
    write(tmp_path / "out", "new", group=group)
    write(tmp_path / "out", "theirs")
    with pytest.raises(OutputError, match="appeared"):
        group.__exit__(None, None, None)
    assert tree(tmp_path) == ["out", "out/theirs"]


def test_folders_and_files_of_a_group_appear_together(tmp_path):
    group = OutputGroup()
    write(tmp_path / "out", "a", group=group)
    with AtomicFile(tmp_path / "table", group) as file:
        file.stream.write(b"x")
    group.__exit__(ValueError, ValueError(), None)
    assert tree(tmp_path) == []


def test_a_file_in_the_way_is_an_error(tmp_path):
    (tmp_path / "out").write_text("mine")
    with pytest.raises(OutputError, match="not a folder"):
        AtomicFolder(tmp_path / "out")
    assert (tmp_path / "out").read_text() == "mine"


def test_folders_of_killed_runs_are_removed(tmp_path):
    folder = AtomicFolder(tmp_path / "out")
    stale = folder.part.with_name(folder.part.name.replace(f"-{os.getpid()}-", "-4194303-"))
    stale.mkdir()
    (stale / "a").write_text("x")
    assert remove_stale(tmp_path, {"out"}) == 1
    assert folder.part.is_dir()
    folder.discard()
    assert tree(tmp_path) == []


def test_a_link_to_a_folder_stays_a_link(tmp_path):
    write(tmp_path / "real", "old")
    (tmp_path / "link").symlink_to(tmp_path / "real")
    write(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert tree(tmp_path / "real") == ["new"]
