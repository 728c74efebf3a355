"""The check that workers see the files of a run."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from seaclutter_cli.errors import OutputError
from seaclutter_cli.runs import shared_files as module
from seaclutter_cli.runs.shared_files import shared_files


@dataclass(frozen=True)
class Places:
    reads: tuple
    writes: tuple = ()


@pytest.fixture(autouse=True)
def no_pause(monkeypatch):
    monkeypatch.setattr(module, "_PAUSE_S", 0.0)


@pytest.fixture
def places(tmp_path):
    log = tmp_path / "logs" / "a.mcap"
    log.parent.mkdir()
    log.write_bytes(b"log")
    return Places((log,), (tmp_path / "out" / "a.mcap",))


def check(places, change=lambda: None):
    with shared_files(places.reads, places.writes) as found:
        change()
        return found(lambda _: None)


def test_files_that_are_there(places):
    assert check(places) is None
    assert not places.writes[0].parent.exists(), "made for the check only"


def test_files_that_are_not_there(places):
    reason = check(places, places.reads[0].unlink)
    assert reason.startswith(f"cannot see {places.reads[0]}; ")


def test_another_file_of_the_same_name(places):
    assert check(places, lambda: places.reads[0].write_bytes(b"other")).startswith("sees another file under ")


def test_a_folder_of_the_same_name_that_is_not_shared(places):
    folder = places.writes[0].parent

    def replace():
        folder.rename(folder.with_name("elsewhere"))
        folder.mkdir()

    assert check(places, replace).startswith(f"cannot see the folder {folder}; ")


def test_a_folder_that_cannot_be_written(places, monkeypatch):
    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied")

    assert check(places, lambda: monkeypatch.setattr(Path, "touch", refuse)).startswith("cannot write to ")
    with pytest.raises(OutputError, match="cannot be written"):
        check(places)


def test_outputs_stay(places):
    check(places, lambda: places.writes[0].write_bytes(b"done"))
    assert [path.name for path in places.writes[0].parent.iterdir()] == ["a.mcap"]
