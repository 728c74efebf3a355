"""Runs on a cluster with logs and outputs in object storage."""

import json

from tests.jobs.cluster.conftest import own_cluster  # noqa: F401 - a fixture
from tests.logs import cloud_log
from tests.running import execute
from tests.storage.buckets import get, names, put

RECORDINGS = 6


def run(*words):
    return execute(*words, code=0).output


def test_workers_read_from_a_bucket_and_write_to_it(bucket, scratch, own_cluster, tmp_path):  # noqa: F811
    for number in range(RECORDINGS):
        log = tmp_path / "logs" / f"r{number}.mcap"
        log.parent.mkdir(exist_ok=True)
        cloud_log(log, frames=5 + number, points=400)
        put(bucket / "in" / log.name, log.read_bytes())
    for name in ("one", "two"):
        own_cluster.add(name, "--no-nanny")
    here, table = tmp_path / "here", tmp_path / "runs.json"
    run("filter", tmp_path / "logs", "-o", f"{here}/", "-j", 1)
    line = ["filter", f"{bucket}/in/", "-o", f"{bucket}/out/", "--cluster", own_cluster.address, "--manifest", table]
    run(*line)
    assert names(bucket / "out") == sorted(path.name for path in here.iterdir())
    assert [row["status"] for row in json.loads(table.read_text())] == ["done"] * RECORDINGS
    for path in here.iterdir():
        assert frames(get(bucket / "out" / path.name), tmp_path) == frames(path.read_bytes(), tmp_path)
    output = run(*line, "--resume", "--force")
    assert f"{RECORDINGS} skipped" in output


def frames(content, folder):
    """Return the messages of a filtered log; its record of the run names the places of inputs."""
    from mcap.reader import make_reader

    path = folder / "read.mcap"
    path.write_bytes(content)
    with path.open("rb") as stream:
        return [
            (channel.topic, message.log_time, message.data)
            for _, channel, message in make_reader(stream).iter_messages()
        ]
