"""Copies in the scratch folder: complete, of one version, one ahead, and removed."""

import os
import random
import shutil
import threading
from pathlib import Path

import pytest

from seaclutter_cli.errors import InputError, OutputError
from seaclutter_cli.storage import mirrors
from seaclutter_cli.storage.mirrors import Mirror
from seaclutter_cli.storage.objects import StoredObject
from tests.storage.buckets import put
from tests.storage.proxy import Action

DATA = random.Random(1).randbytes(5_000_000)


@pytest.fixture
def small_ranges(monkeypatch):
    """Let objects of some megabytes take several requests."""
    monkeypatch.setattr(mirrors, "_RANGE", 2**20)


@pytest.fixture
def mirror(scratch):
    """Return a folder in which objects have paths."""
    made = Mirror()
    yield made
    made.close()


def is_range(request):
    return "range" in {name.lower() for name in request.headers}


def test_copies_are_complete(bucket, scratch, mirror, small_ranges):
    urls = [put(bucket / "day/log.mcap", DATA), put(bucket / "day/sub/empty", b""), put(bucket / "day/a b.txt", b"ab")]
    mirror.fetch([mirror.local(bucket / "day")])
    assert [mirror.local(url).read_bytes() for url in urls] == [DATA, b"", b"ab"]
    assert mirror.path.parent == scratch
    assert mirror.path.stat().st_mode & 0o77 == 0
    mirror.close()
    assert not mirror.path.exists()


@pytest.mark.parametrize("action", [Action(status=503), Action(reset_after=0), Action(reset_after=100_000)])
def test_servers_may_fail_in_between(bucket, proxy, mirror, small_ranges, action):
    path = mirror.local(put(bucket / "log.mcap", DATA))
    proxy.fail(4, action, is_range)
    mirror.fetch([path])
    assert path.read_bytes() == DATA


def test_an_object_that_changes_is_an_error(bucket, proxy, mirror, small_ranges):
    url, asked = put(bucket / "log.mcap", DATA), []
    mirror.know(mirror.local(url))

    def change(request):
        asked.append(request)
        if len(asked) == 2:
            proxy.rule = lambda _: None
            put(url, DATA[::-1])

    proxy.rule = change
    with pytest.raises(InputError, match=r"^s3://.*/log.mcap: the object changed while it was read$"):
        mirror.fetch([mirror.local(url)])


def test_an_object_that_vanishes_is_an_error(bucket, mirror):
    path = mirror.local(bucket / "log.mcap")
    mirror._add([StoredObject(bucket / "log.mcap", 100, None)])
    with pytest.raises(InputError, match=r"log.mcap: no such object$"):
        mirror.fetch([path])


def test_space_is_checked(bucket, mirror, monkeypatch):
    path = mirror.local(put(bucket / "log.mcap", b"x" * 1000))
    monkeypatch.setattr(shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(10_000, 9_001, 999))
    with pytest.raises(InputError) as raised:
        mirror.fetch([path])
    assert "log.mcap: needs 0.00 GB in the scratch folder" in str(raised.value)
    assert "choose another with SEACLUTTER_SCRATCH" in str(raised.value)


@pytest.fixture
def recordings(bucket, mirror):
    """Return the paths of three recordings, which are read one after another."""
    paths = [mirror.local(put(bucket / f"{name}.mcap", name.encode() * 600)) for name in "abc"]
    mirror.settle([[path] for path in paths])
    return paths


def test_a_stopped_copy_ends_at_once(proxy, scratch, mirror, recordings):
    waiting, go_on = threading.Event(), threading.Event()

    def hold(request):
        if is_range(request) and "b.mcap" in request.path:
            waiting.set()
            go_on.wait(20)

    proxy.rule = hold
    mirror.fetch(recordings[:1])
    waiting.wait(20)
    mirror.close()
    assert not list(scratch.iterdir())
    go_on.set()


def test_the_next_recording_is_fetched_meanwhile(proxy, mirror, recordings):
    mirror.fetch(recordings[:1])
    mirror._next.wait()
    proxy.reset()
    for number in (1, 2):
        mirror.fetch(recordings[number : number + 1])
    assert not any(map(is_range, proxy.requests))
    assert [path.read_text()[0] for path in recordings] == ["a", "b", "c"]


def test_large_recordings_are_fetched_one_ahead(proxy, mirror, recordings, monkeypatch):
    monkeypatch.setattr(mirrors, "_SMALL", 500)
    mirror.fetch(recordings[:1])
    mirror._next.wait()
    proxy.reset()
    mirror.fetch(recordings[1:2])
    mirror._next.wait()
    assert sum(map(is_range, proxy.requests)) == 1  # only that of c


def test_a_copy_that_was_fetched_ahead_and_removed_is_fetched_again(mirror, recordings):
    mirror.fetch(recordings[:1])
    with mirror.copies_removed():
        mirror.fetch(recordings[1:2])
    mirror.fetch(recordings[1:2])
    assert recordings[1].read_bytes() == b"b" * 600


def test_an_error_of_another_recording_that_is_fetched_ahead(mirror, recordings):
    mirror.know(recordings[2])
    put(mirror.url(recordings[2]), b"changed")
    mirror.fetch(recordings[:1])
    mirror.fetch(recordings[1:2])
    assert recordings[1].read_bytes() == b"b" * 600
    with pytest.raises(InputError, match=r"c\.mcap: the object changed"):
        mirror.fetch(recordings[2:])


def test_nothing_is_fetched_ahead_without_space(mirror, recordings, monkeypatch):
    free = property(lambda self: 1000 - 600 * len(mirror._complete))
    monkeypatch.setattr(mirrors.shutil, "disk_usage", lambda path: type("Usage", (), {"free": free})())
    with mirror.copies_removed():
        mirror.fetch(recordings[:1])
        assert mirror._next is None
    mirror.fetch(recordings[1:2])


def test_copies_are_removed_when_they_are_read(mirror, recordings):
    mirror.fetch(recordings[:1])
    with mirror.copies_removed():
        mirror.fetch(recordings)
        assert recordings[2].read_bytes() == b"c" * 600
    assert [path.read_bytes()[:1] for path in recordings] == [b"a", bytes(1), bytes(1)]
    assert [path.stat().st_size for path in recordings] == [600] * 3


def test_folders_of_killed_runs_are_removed(scratch):
    mirror = Mirror()
    name = mirror.path.name.replace(f"-{os.getpid()}-", "-99999999-")
    mirror.path.rename(scratch / name)
    (scratch / name / "log.mcap").write_bytes(b"x")
    Mirror().close()
    assert not list(scratch.iterdir())


def test_a_scratch_folder_that_cannot_be_made(tmp_path, monkeypatch):
    monkeypatch.setenv("SEACLUTTER_SCRATCH", str(tmp_path / "none" / "none"))
    with pytest.raises(OutputError, match="the scratch folder cannot be used"):
        Mirror()


def test_a_mirror_shows_urls_for_paths(bucket, mirror):
    url = bucket / "day" / "sub/log.mcap"
    assert mirror.url(mirror.local(url)) == url
    assert mirror.shown(f"{mirror.local(url)}: byte 5") == f"{url}: byte 5"
    with pytest.raises(InputError, match="cannot have this name"):
        mirror.local(bucket / "day/\0")


def test_what_is_beside_a_file_is_found_where_only_the_file_is_known(bucket, mirror):
    """As in other processes."""
    path = mirror.local(put(bucket / "trial.pcap", b"nothing"))
    put(bucket / "trial.json", b"{}")
    mirror.know(path)
    mirror.look_beside(path)
    assert path.with_suffix(".json").exists()


def test_what_was_found_has_names_and_sizes_and_no_content(bucket, mirror):
    for name, data in (("day/a.mcap", DATA), ("day/f/1.csv", b"x,y,z\n"), ("day/f/2.csv", b"x,y,z\n")):
        put(bucket / name, data)

    def sizes():
        return [path.stat().st_size for path in sorted(Path(found).rglob("*.*"))]

    found = mirror.find(str(mirror.local(bucket)), ())
    assert sizes() == [0, 6, 0]  # the content of a table says what it is
    mirror.settle(())
    assert sizes() == [len(DATA), 6, 6]
