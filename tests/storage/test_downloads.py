"""Copies in the scratch folder: complete, of one version, one ahead, and removed."""

import pickle
import random
import shutil
import threading

import pytest

from seaclutter_cli.errors import InputError, LabelError, OutputError
from seaclutter_cli.storage import downloads
from seaclutter_cli.storage.downloads import Download, Prefetcher
from seaclutter_cli.storage.mirrors import Mirror, skeleton
from seaclutter_cli.storage.objects import StoredObject, find_object, list_objects
from seaclutter_cli.storage.scratch import ScratchFolder
from tests.storage.buckets import put
from tests.storage.proxy import Action

DATA = random.Random(1).randbytes(5_000_000)


@pytest.fixture
def small_ranges(monkeypatch):
    """Let objects of some megabytes take several requests."""
    monkeypatch.setattr(downloads, "_RANGE", 2**20)
    monkeypatch.setattr(downloads, "_PIECE", 2**18)


def copied(*urls):
    """Return a copy of objects in a bucket."""
    objects = [find_object(url) for url in urls]
    return Download(objects[0].url.parent, objects)


def is_range(request):
    return "range" in {name.lower() for name in request.headers}


def test_copies_are_complete(bucket, scratch, small_ranges):
    urls = [put(bucket / "day/log.mcap", DATA), put(bucket / "day/sub/empty", b""), put(bucket / "day/a b.txt", b"ab")]
    download = copied(*urls)
    mirror = download.wait()
    assert (mirror.path / "log.mcap").read_bytes() == DATA
    assert (mirror.path / "sub" / "empty").read_bytes() == b""
    assert (mirror.path / "a b.txt").read_bytes() == b"ab"
    assert mirror.path.parent == scratch
    assert mirror.path.stat().st_mode & 0o77 == 0
    download.remove()
    assert not mirror.path.exists()


@pytest.mark.parametrize("action", [Action(status=503), Action(reset_after=0), Action(reset_after=100_000)])
def test_servers_may_fail_in_between(bucket, proxy, scratch, small_ranges, action):
    url = put(bucket / "log.mcap", DATA)
    found = find_object(url)
    proxy.fail(4, action, is_range)
    download = Download(bucket, [found])
    assert (download.wait().path / "log.mcap").read_bytes() == DATA
    download.remove()


def test_an_object_that_changes_is_an_error(bucket, proxy, scratch, small_ranges):
    url = put(bucket / "log.mcap", DATA)
    found, asked = find_object(url), []

    def change(request):
        asked.append(request)
        if len(asked) == 2:
            proxy.rule = lambda _: None
            put(url, DATA[::-1])

    proxy.rule = change
    download = Download(bucket, [found])
    with pytest.raises(InputError, match=r"^s3://.*/log.mcap: the object changed while it was read$"):
        download.wait()


def test_an_object_that_vanishes_is_an_error(bucket, scratch):
    found = StoredObject(bucket / "log.mcap", 100, None)
    with pytest.raises(InputError, match=r"log.mcap: no such object$"):
        Download(bucket, [found]).wait()


def test_space_is_checked(bucket, scratch, monkeypatch):
    found = find_object(put(bucket / "log.mcap", b"x" * 1000))
    monkeypatch.setattr(shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(10_000, 9_001, 999))
    with pytest.raises(InputError) as raised:
        Download(bucket, [found])
    assert "log.mcap: needs 0.00 GB in the scratch folder" in str(raised.value)
    assert "choose another with --scratch" in str(raised.value)


def test_a_stopped_copy_ends_at_once(bucket, proxy, scratch, small_ranges):
    found = find_object(put(bucket / "log.mcap", DATA))
    waiting, go_on = threading.Event(), threading.Event()

    def hold(_):
        waiting.set()
        go_on.wait(20)

    proxy.rule = hold
    download = Download(bucket, [found])
    waiting.wait(20)
    download.remove()
    assert not list(scratch.iterdir())
    go_on.set()


def test_the_next_recording_is_fetched_meanwhile(bucket, proxy, scratch):
    found = [find_object(put(bucket / f"{name}.mcap", name.encode())) for name in "abc"]
    prefetcher = Prefetcher()
    for one in found:
        prefetcher.add(bucket, (one,))
    first = prefetcher.take(bucket, (found[0],))
    prefetcher._next.wait()
    proxy.reset()
    second = prefetcher.take(bucket, (found[1],))
    prefetcher._next.wait()
    assert sum(is_range(request) for request in proxy.requests) == 1  # only that of c
    assert [(one.mirror.path / f"{n}.mcap").read_text() for one, n in ((first, "a"), (second, "b"))] == ["a", "b"]
    again = prefetcher.take(bucket, (found[0],))
    assert pickle.loads(pickle.dumps(prefetcher))._order == []
    for one in (first, second, again, prefetcher._next):
        one.remove()


def test_nothing_is_fetched_ahead_without_space(bucket, scratch, monkeypatch):
    found = [find_object(put(bucket / f"{name}.mcap", b"x" * 600)) for name in "ab"]
    prefetcher = Prefetcher()
    for one in found:
        prefetcher.add(bucket, (one,))
    monkeypatch.setattr(ScratchFolder, "free", lambda self: 1000 - 600 * (len(list(scratch.iterdir())) - 1))
    first = prefetcher.take(bucket, (found[0],))
    assert prefetcher._next is None
    first.remove()
    prefetcher.take(bucket, (found[1],)).remove()


def test_folders_of_killed_runs_are_removed(scratch, monkeypatch):
    folder = ScratchFolder()
    name = folder.path.name.replace(f"-{__import__('os').getpid()}-", "-99999999-")
    folder.path.rename(scratch / name)
    (scratch / name / "log.mcap").write_bytes(b"x")
    ScratchFolder().remove()
    assert not list(scratch.iterdir())


def test_a_scratch_folder_that_cannot_be_made(tmp_path, monkeypatch):
    monkeypatch.setenv("SEACLUTTER_SCRATCH", str(tmp_path / "none" / "none"))
    with pytest.raises(OutputError, match="the scratch folder cannot be used"):
        ScratchFolder()


def test_a_mirror_shows_urls_for_paths(bucket, scratch):
    mirror = Mirror(bucket / "day")
    url = bucket / "day" / "sub/log.mcap"
    assert mirror.url(mirror.local(url)) == url
    assert mirror.shown(f"{mirror.local(url)}: byte 5") == f"{url}: byte 5"
    with pytest.raises(LabelError, match=f"^{url}: wrong$"), mirror.naming():
        raise LabelError(f"{mirror.local(url)}: wrong")
    with pytest.raises(InputError, match="cannot have this name"):
        mirror.local(bucket / "day/\0")
    mirror.folder.remove()


def test_a_skeleton_has_the_names_and_no_content(bucket, scratch):
    for name, data in (("day/a.mcap", DATA), ("day/f/1.csv", b"x,y,z\n"), ("day/f/2.csv", b"x,y,z\n")):
        put(bucket / name, data)
    mirror = skeleton(bucket, list_objects(bucket))
    sizes = {str(path.relative_to(mirror.path)): path.stat().st_size for path in mirror.path.rglob("*.*")}
    assert sizes == {"day/a.mcap": 0, "day/f/1.csv": 6, "day/f/2.csv": 0}
    mirror.folder.remove()
