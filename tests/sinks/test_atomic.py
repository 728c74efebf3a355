"""Atomic files: they appear under their name when complete, and failures leave nothing."""

import gc
import os
import stat
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from seaclutter_cli.errors import OutputError
from seaclutter_cli.sinks.atomic import AtomicFile, AtomicFolder
from tests.paths import ROOT

POSIX = pytest.mark.skipif(sys.platform == "win32", reason="names, links and signals differ on Windows")


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_appears_when_complete(tmp_path):
    target = tmp_path / "folder" / "out.bin"
    with AtomicFile(target) as file:
        file.stream.write(b"some")
        file.stream.flush()
        assert not target.exists()
        assert len(names(target.parent)) == 1, "next to the target, so that it can be renamed"
        file.stream.write(b" bytes")
    assert target.read_bytes() == b"some bytes"
    assert names(target.parent) == ["out.bin"]


def test_replaces_an_existing_file_only_at_the_end(tmp_path):
    target = tmp_path / "out.bin"
    target.write_bytes(b"old")
    with AtomicFile(target) as file:
        file.stream.write(b"new")
        assert target.read_bytes() == b"old"
    assert target.read_bytes() == b"new"


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit, MemoryError, OSError, BrokenPipeError])
def test_an_error_changes_nothing(tmp_path, error):
    target = tmp_path / "out.bin"
    target.write_bytes(b"old")
    with pytest.raises(error):
        write(target, b"new" * 100_000, error)
    assert target.read_bytes() == b"old"
    assert names(tmp_path) == ["out.bin"]


def write(target, data, error=None):
    with AtomicFile(target) as file:
        file.stream.write(data)
        if error:
            raise error


@pytest.mark.usefixtures("full_disk")
@pytest.mark.parametrize("size", [1, 10**6])
def test_a_full_disk(tmp_path, size):
    """A large write fails immediately, a small one when the file is closed."""
    target = tmp_path / "out.bin"
    with pytest.raises(OutputError, match=f"^{target}: the disk is full; the incomplete file was removed$"):
        write(target, bytes(size))
    assert names(tmp_path) == []


@pytest.mark.usefixtures("full_disk")
def test_a_library_that_hides_why_it_cannot_write(tmp_path):
    """Lazrs raises an error of its own, without the reason."""

    def write_without_reason():
        with AtomicFile(tmp_path / "out.bin") as file:
            with suppress(OutputError):
                file.stream.write(bytes(10**6))
            raise RuntimeError("failed to call write")

    with pytest.raises(OutputError, match="the disk is full"):
        write_without_reason()
    assert names(tmp_path) == []


def test_a_file_that_grows_too_large(tmp_path):
    resource = pytest.importorskip("resource", reason="this platform has no resource limits")
    target = tmp_path / "out.bin"
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10**6, before[1]))
    try:
        with pytest.raises(OutputError, match=f"^{target}: writing failed .File too large.; the incomplete"):
            write(target, bytes(2 * 10**6))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert names(tmp_path) == []


@pytest.mark.usefixtures("full_disk")
def test_an_error_of_the_run_takes_precedence_over_an_error_of_closing(tmp_path):
    target = tmp_path / "out.bin"
    with pytest.raises(KeyboardInterrupt):
        write(target, b"a byte that is not in the file yet", KeyboardInterrupt)
    assert names(tmp_path) == []


@POSIX
def test_targets_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    (tmp_path / "folder" / "full").mkdir(parents=True)
    for target, message in (
        (tmp_path / "file" / "out.bin", r"cannot be written \(.*\)"),
        (tmp_path / ("n" * 300), r"cannot be written \(File name too long\)"),
        (tmp_path / "folder", "not a regular file, cannot be replaced"),
        (Path(os.devnull), "not a regular file, cannot be replaced"),
    ):
        with pytest.raises(OutputError, match=message):
            AtomicFile(target)
    assert names(tmp_path) == ["file", "folder"]


def test_a_target_that_becomes_a_folder_during_the_run(tmp_path):
    target = tmp_path / "out.bin"
    with pytest.raises(OutputError, match="can no longer be written"), AtomicFile(target):
        (target / "full").mkdir(parents=True)
    assert names(tmp_path) == ["out.bin"]


@POSIX
@pytest.mark.parametrize("files", [1, 3, 200])
def test_the_disk_has_an_output_before_its_name(tmp_path, monkeypatch, files):
    """A power failure must not leave a name without content."""
    seen = []

    def flushed(number):
        kind = "folder" if stat.S_ISDIR(os.fstat(number).st_mode) else "file"
        seen.append((kind, (tmp_path / "out").exists()))

    monkeypatch.setattr(os, "fsync", flushed)
    monkeypatch.setattr(os, "sync", lambda: seen.append(("all", (tmp_path / "out").exists())))
    with AtomicFile(tmp_path / "out") if files == 1 else AtomicFolder(tmp_path / "out") as output:
        for name in range(files if files > 1 else 0):
            output.open(str(name)).close()
    before = [("all", False)] if files == 200 else [("file", False)] * files
    assert seen == [*before, ("folder", True)]


@POSIX
def test_a_link_is_preserved(tmp_path):
    real, link = tmp_path / "disk" / "real.bin", tmp_path / "link.bin"
    link.symlink_to(real)
    for content in (b"first", b"second"):
        with AtomicFile(link) as file:
            file.stream.write(content)
        assert link.is_symlink()
        assert real.read_bytes() == content
    assert names(real.parent) == ["real.bin"]


@POSIX
def test_a_name_of_maximum_length(tmp_path):
    target = tmp_path / ("ö" * 125 + ".mcap")
    with AtomicFile(target) as file:
        file.stream.write(b"some")
    assert target.read_bytes() == b"some"


def test_a_file_whose_context_is_never_entered_is_removed(tmp_path):
    file = AtomicFile(tmp_path / "out.bin")
    file.stream.write(b"some")
    assert len(names(tmp_path)) == 1
    del file
    gc.collect()
    assert names(tmp_path) == []


def test_an_interrupt_before_the_context_is_entered(tmp_path):
    program = "from pathlib import Path; from seaclutter_cli.sinks.atomic import AtomicFile\n"
    program += f"file = AtomicFile(Path({str(tmp_path / 'out.bin')!r})); file.stream.write(b'some')\n"
    program += "raise KeyboardInterrupt"
    run = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False)
    assert "KeyboardInterrupt" in run.stderr
    assert names(tmp_path) == []


def test_an_interrupt_while_the_file_is_created(tmp_path, monkeypatch):
    def create(part, target):
        part.touch()
        raise KeyboardInterrupt

    monkeypatch.setattr("seaclutter_cli.sinks.atomic.PartFile", create)
    with pytest.raises(KeyboardInterrupt):
        AtomicFile(tmp_path / "out.bin")
    assert names(tmp_path) == []
