"""Groups of files: they appear together or not at all, the one that is completed last also last."""

import errno
import os
from contextlib import ExitStack

import pytest

from seaclutter_cli.errors import OutputError
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup


def contents(folder):
    return {path.name: path.read_text() for path in folder.iterdir() if path.is_file()}


def write(folder, names, group, text="new"):
    """Write files as a run does: all are open at once, and the first is completed last."""
    with ExitStack() as stack:
        files = [stack.enter_context(AtomicFile(folder / name, group)) for name in names]
        for file in files:
            file.stream.write(text.encode())


@pytest.fixture
def renamed(monkeypatch):
    """Record the names of files in the order in which they appear."""
    order = []
    publish = AtomicFile.publish

    def record(file, *, replace):
        order.append(file.path.name)
        publish(file, replace=replace)

    monkeypatch.setattr(AtomicFile, "publish", record)
    return order


def test_files_appear_together_and_the_main_one_last(tmp_path, renamed):
    with OutputGroup() as group:
        write(tmp_path, ["main", "table", "plot"], group)
        assert all(name.endswith(".part") for name in contents(tmp_path))
    assert contents(tmp_path) == {"main": "new", "table": "new", "plot": "new"}
    assert renamed == ["plot", "table", "main"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, OutputError])
def test_an_error_after_all_files_are_complete_changes_nothing(tmp_path, error):
    (tmp_path / "main").write_text("old")

    def fail():
        with OutputGroup() as group:
            write(tmp_path, ["main", "table"], group)
            raise error

    with pytest.raises(error):
        fail()
    assert contents(tmp_path) == {"main": "old"}


def test_an_error_in_one_file_changes_nothing(tmp_path):
    (tmp_path / "main").write_text("old")

    def fail():
        with OutputGroup() as group:
            write(tmp_path, ["main"], group)
            with AtomicFile(tmp_path / "table", group):
                raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert contents(tmp_path) == {"main": "old"}


def test_discarded_files_do_not_appear(tmp_path):
    with OutputGroup() as group:
        write(tmp_path, ["table"], group)
        group.discard()
        write(tmp_path, ["main"], group)
    assert contents(tmp_path) == {"main": "new"}


def test_a_group_in_a_group(tmp_path, renamed):
    with OutputGroup() as outer:
        with OutputGroup(outer) as main:
            write(tmp_path, ["log"], main)
            write(tmp_path, ["table"], outer)
        assert not renamed
    assert renamed == ["table", "log"]


def test_files_of_a_failed_inner_group_do_not_appear(tmp_path):
    def fail(outer):
        with OutputGroup(outer) as inner:
            write(tmp_path, ["log"], inner)
            raise ZeroDivisionError

    with OutputGroup() as outer:
        write(tmp_path, ["table"], outer)
        with pytest.raises(ZeroDivisionError):
            fail(outer)
    assert contents(tmp_path) == {"table": "new"}


def test_a_target_that_becomes_a_folder_keeps_the_others_from_appearing(tmp_path):
    (tmp_path / "table").write_text("old")

    def run():
        with OutputGroup() as group:
            write(tmp_path, ["main", "table"], group)
            (tmp_path / "main").mkdir()

    with pytest.raises(OutputError, match="main: can no longer be written; the incomplete file was removed"):
        run()
    assert contents(tmp_path) == {"table": "old"}


def interrupt(folder, group):
    with group:
        write(folder, ["main", "table"], group)
        raise KeyboardInterrupt


def test_an_interrupt_while_complete_files_wait_says_that_they_are_removed(tmp_path):
    with pytest.raises(KeyboardInterrupt) as caught:
        interrupt(tmp_path, OutputGroup())
    assert caught.value.__notes__ == [f"{tmp_path / 'main'}: the incomplete file was removed"]
    assert contents(tmp_path) == {}


def test_files_that_appear_meanwhile_are_not_replaced(tmp_path):
    group = OutputGroup(replace=False)

    def run():
        with group, OutputGroup(group) as inner:
            write(tmp_path, ["main", "table"], inner)
            (tmp_path / "main").write_text("other")

    with pytest.raises(OutputError, match="main: appeared while this run was writing it; use --force"):
        run()
    assert contents(tmp_path) == {"main": "other"}


@pytest.mark.parametrize("has_links", [True, False])
def test_of_two_groups_that_appear_at_once_the_first_wins(tmp_path, monkeypatch, has_links):
    def no_link(*_):
        raise OSError(errno.EPERM, "no hard links")

    monkeypatch.setattr(AtomicFile, "prepare", lambda _, **__: None)
    if not has_links:
        monkeypatch.setattr(os, "link", no_link)
    with OutputGroup(replace=False) as first:
        write(tmp_path, ["main", "table"], first, "first")

    def second():
        with OutputGroup(replace=False) as group:
            write(tmp_path, ["main", "table"], group, "second")

    with pytest.raises(OutputError, match="appeared while this run was writing it"):
        second()
    assert contents(tmp_path) == {"main": "first", "table": "first"}
