"""``info`` of a large MCAP file in a bucket reads its beginning and its end."""

import json

import pytest

from seaclutter_cli.sources.mcap import excerpt as excerpts
from seaclutter_cli.storage import mirrors
from tests.logs import PERIOD_NS, START_NS, Entry, Layout, Topic, cloud_messages, cloud_topic, log_bytes
from tests.running import execute
from tests.storage.buckets import put

FRAMES = 100


@pytest.fixture(scope="module")
def log():
    """Return a log of 16 MB, mostly of pictures, with 200 chunks."""
    messages = cloud_messages("ros2", FRAMES, 500)
    entries = []
    for number, data in enumerate(messages):
        time_ns = START_NS + number * PERIOD_NS
        entries += [Entry("/points", time_ns, data), Entry("/camera", time_ns, bytes(150_000))]
    return log_bytes(
        [cloud_topic("/points"), Topic("/camera", "raw", None)], entries, Layout("", chunk_size=80_000), ()
    )


@pytest.fixture(autouse=True)
def _large(monkeypatch):
    monkeypatch.setattr(mirrors, "_WORTH_AN_EXCERPT", 2**20)


def info(place, *options):
    result = execute("info", place, "--json", *options, code=0)
    return json.loads(result.stdout)[0], result.stderr


def test_few_bytes_are_read(bucket, proxy, scratch, log, tmp_path):
    url = put(bucket / "log.mcap", log)
    (tmp_path / "log.mcap").write_bytes(log)
    proxy.reset()
    there, _ = info(url)
    assert proxy.sent < len(log) / 20
    here, _ = info(tmp_path / "log.mcap")
    assert (there["sampled"], here["sampled"]) == (True, False)
    same = ("recording", "format", "duration_s", "start_ns", "topics", "needs", "damage", "error")
    assert {key: there[key] for key in same} == {key: here[key] for key in same}
    few, all_ = there["clouds"]["/points"], here["clouds"]["/points"]
    assert 0 < few["frames"] < all_["frames"] == FRAMES
    assert few["fields"] == all_["fields"]
    text = execute("info", url).stdout
    assert text.startswith(f"{url}: MCAP, {here['duration_s']:.1f} s")
    assert "Only the first frames were read" in text


def test_nothing_is_copied_ahead(bucket, proxy, scratch, log):
    put(bucket / "a.bag", b"nothing")
    put(bucket / "b.mcap", log)
    proxy.reset()
    result = execute("info", bucket, "-v", "-j", "1")
    assert f"{bucket}/b.mcap: MCAP" in result.stdout
    assert proxy.sent < len(log) / 20


def test_all_is_read_on_request(bucket, scratch, log):
    there, _ = info(put(bucket / "log.mcap", log), "-n", "1000")
    assert not there["sampled"]
    assert there["clouds"]["/points"]["frames"] == FRAMES


@pytest.mark.parametrize("kept", [0.5, 0.9999])
def test_a_log_without_its_end_is_copied(bucket, scratch, log, kept):
    url = put(bucket / "log.mcap", log[: int(len(log) * kept)])
    result = execute("info", url, "--json", code=3)
    assert not json.loads(result.stdout)[0]["sampled"]
    assert f"Damaged: {url}: byte " in result.stderr


def test_a_changed_summary_is_not_trusted(log):
    def excerpt(data):
        return excerpts.excerpt(lambda start, stop: data[start:stop], len(data))

    assert excerpt(log).messages == {1: FRAMES, 2: FRAMES}
    for at in range(len(log) - 30_000, len(log), 997):
        changed = log[:at] + bytes([log[at] ^ 0xFF]) + log[at + 1 :]
        found = excerpt(changed)
        assert found is None or found == excerpt(log)
    assert excerpt(b"") is None
    assert excerpt(log[:20]) is None
