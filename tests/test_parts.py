"""Names of incomplete files, and what is left behind by killed runs."""

import os
import subprocess
import sys
from unittest.mock import patch

import pytest

from seaclutter_cli.parts import part_path, release, remove_stale
from seaclutter_cli.sinks.atomic import AtomicFile

POSIX = pytest.mark.skipif(os.name != "posix", reason="processes are looked up by signal 0")


def dead_pid():
    """Return the number of a process that has ended."""
    done = subprocess.Popen([sys.executable, "-c", ""])
    done.wait()
    return done.pid


def part_of(target, *, pid=None, host=None):
    """Create an incomplete file as another process would."""
    with patch("os.getpid", return_value=os.getpid() if pid is None else pid):
        path = part_path(target)
    release(path)
    if host is not None:
        base, _, end = path.name.rpartition(f"-{pid}-")
        path = path.with_name(f"{base.rpartition('.')[0]}.{host}-{pid}-{end}")
    path.touch()
    return path


def test_a_name_says_whose_it_is_and_is_never_given_twice(tmp_path):
    names = {part_path(tmp_path / "log.mcap").name for _ in range(100)}
    assert len(names) == 100
    for name in names:
        assert name.startswith(".log.mcap.")
        assert name.endswith(".part")
        assert f"-{os.getpid()}-" in name


@pytest.mark.parametrize("name", ["x" * 255, "ö" * 127, "船" * 85, "a" + "ö" * 127, "e\u0301" * 85])
def test_long_names_are_cut_to_valid_text(tmp_path, name):
    with AtomicFile(tmp_path / name) as file:
        part = file.part.name
        assert len(part.encode()) <= 255
        assert part[1:].startswith(name[:20])
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.skipif(sys.platform != "linux", reason="names need not be text")
def test_names_that_are_not_text(tmp_path):
    name = os.fsdecode(b"l\xe5g.mcap")
    with AtomicFile(tmp_path / name) as file:
        assert file.part.name.startswith(f".{name}.")
    assert [path.name for path in tmp_path.iterdir()] == [name]


@POSIX
def test_files_of_dead_processes_are_removed(tmp_path):
    pid = dead_pid()
    for name in ("a.mcap", "b.csv", "odd-1-00000000.part"):
        part_of(tmp_path / name, pid=pid)
    kept = part_of(tmp_path / "another.mcap", pid=pid)
    assert remove_stale(tmp_path, {"a.mcap", "b.csv", "odd-1-00000000.part"}) == 3
    assert list(tmp_path.iterdir()) == [kept]


@POSIX
@pytest.mark.parametrize("name", ["trial_12.mcap", "x" * 255])
def test_other_parts_and_cut_names_are_of_the_same_output(tmp_path, name):
    part_of(tmp_path / name, pid=dead_pid())
    assert remove_stale(tmp_path, {name.replace("12", "0")}) == 1


@POSIX
def test_an_earlier_process_with_the_number_of_this_one(tmp_path):
    """In a container, every run may have the number 1."""
    part_of(tmp_path / "a.mcap")
    with AtomicFile(tmp_path / "b.mcap"):
        assert remove_stale(tmp_path, {"a.mcap", "b.mcap"}) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["b.mcap"]


def test_files_of_living_processes_and_of_other_hosts_stay(tmp_path):
    kept = {
        part_of(tmp_path / "alive.mcap", pid=os.getppid()),
        part_of(tmp_path / "elsewhere.mcap", pid=dead_pid(), host="another"),
        part_of(tmp_path / "huge.mcap", pid=10**30, host="another"),
    }
    for name in (".log.mcap.part", ".log.mcap.4711.part", "log-1-00000000.part", ".log.host-x-00000000.part"):
        (tmp_path / name).touch()
        kept.add(tmp_path / name)
    assert remove_stale(tmp_path, {path.name.split(".")[1] + ".mcap" for path in kept}) == 0
    assert set(tmp_path.iterdir()) == kept


def test_folders_that_do_not_exist_have_no_stale_files(tmp_path):
    assert remove_stale(tmp_path / "none", {"a"}) == 0
