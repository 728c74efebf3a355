"""Outputs in object storage: visible when complete, together with the others, or not at all."""

import _thread
import random
import threading

import pytest

from seaclutter_cli.errors import OutputError
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup
from seaclutter_cli.storage import objects
from tests.storage.buckets import get, names, put
from tests.storage.proxy import Action

DATA = random.Random(2).randbytes(11_000_000)


@pytest.fixture(autouse=True)
def _small_parts(monkeypatch):
    """Let the data be three parts."""
    monkeypatch.setattr(objects, "_PART", 5 * 2**20)


def write(path, data, group=None):
    with AtomicFile(path, group) as file:
        file.stream.write(data)


def is_upload(request):
    return request.method in ("PUT", "POST")


def is_abort(request):
    return request.method == "DELETE" and "uploadId" in request.path


@pytest.mark.parametrize("size", [0, 10, 5 * 2**20, len(DATA)])
def test_an_object_appears_at_the_end(bucket, scratch, local, size):
    url = bucket / "out/log.mcap"
    with AtomicFile(local(url)) as file:
        file.stream.write(DATA[:size])
        assert names(bucket) == []
        assert [path.stat().st_mode & 0o77 for path in scratch.iterdir()] == [0]
    assert get(url) == DATA[:size]


def test_an_error_leaves_nothing(bucket, proxy, local):
    def fail():
        with AtomicFile(local(bucket / "log.mcap")) as file:
            file.stream.write(DATA)
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert names(bucket) == []
    assert not any(map(is_upload, proxy.requests))


@pytest.mark.parametrize("action", [Action(status=503), Action(status=500), Action(reset_after=0)])
def test_servers_may_fail_in_between(bucket, proxy, local, action):
    proxy.fail(4, action, is_upload)
    write(local(bucket / "log.mcap"), DATA)
    assert get(bucket / "log.mcap") == DATA


def test_a_server_that_fails_for_long_leaves_nothing(bucket, proxy, local, few_retries):
    proxy.fail(1000, Action(status=503), lambda request: "partNumber" in request.path)
    with pytest.raises(OutputError, match=r"/log.mcap: the server answered 503 Service Unavailable$"):
        write(local(bucket / "log.mcap"), DATA)
    proxy.rule = lambda _: None
    assert any(map(is_abort, proxy.requests))
    assert names(bucket) == []


def test_a_group_appears_together(bucket, tmp_path, local):
    with OutputGroup() as group:
        for url in (bucket / "a", bucket / "b"):
            write(local(url), DATA, group)
        write(tmp_path / "c", b"c", group)
        assert names(bucket) == []
        assert not (tmp_path / "c").exists()
    assert names(bucket) == ["a", "b"]
    assert (tmp_path / "c").read_bytes() == b"c"


def test_a_group_of_which_one_cannot_be_sent_does_not_appear(bucket, proxy, tmp_path, local, few_retries):
    put(bucket / "a", b"earlier")

    def run():
        with OutputGroup() as group:
            for url in (bucket / "a", bucket / "b"):
                write(local(url), DATA, group)
            write(tmp_path / "c", b"c", group)
            proxy.fail(1000, Action(status=503), lambda request: request.path.rpartition("?")[0].endswith("/b"))

    with pytest.raises(OutputError, match=r"/b: the server answered 503"):
        run()
    proxy.rule = lambda _: None
    assert names(bucket) == ["a"]
    assert get(bucket / "a") == b"earlier"
    assert not (tmp_path / "c").exists()
    assert any(is_abort(request) and "/a?" in request.path for request in proxy.requests)


def test_an_interrupt_aborts_the_upload(bucket, proxy, local, monkeypatch):
    def interrupt(request):
        if "partNumber" in request.path:
            proxy.rule = lambda _: None
            _thread.interrupt_main()

    proxy.rule = interrupt
    monkeypatch.setattr(objects, "_AT_ONCE", 1)
    with pytest.raises(KeyboardInterrupt):
        write(local(bucket / "log.mcap"), DATA)
    assert names(bucket) == []
    assert any(map(is_abort, proxy.requests))


def test_a_bucket_that_is_not_there(bucket, local):
    missing = type(bucket)("s3", "not-there", "log.mcap")
    with pytest.raises(OutputError, match=r"^s3://not-there/log.mcap: there is no bucket not-there$"):
        write(local(missing), b"x")


def test_two_uploads_at_once_leave_one_of_them(bucket, local):
    threads = [threading.Thread(target=write, args=(local(bucket / "log.mcap"), data)) for data in (DATA, DATA[::-1])]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert get(bucket / "log.mcap") in (DATA, DATA[::-1])
