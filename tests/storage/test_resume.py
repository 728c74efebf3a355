"""Runs that go on where an earlier one stopped, and plans, with logs and outputs in object storage."""

import json
import shlex

import pytest

from seaclutter_cli.buckets import on_paths
from seaclutter_cli.runs.resume import digest_of_paths
from tests.logs import cloud_log
from tests.running import execute
from tests.storage.buckets import get, names, put


@pytest.fixture
def logs(bucket, scratch, tmp_path, monkeypatch):
    """Return the URL of a folder with two logs, which are also in the folder ``in``."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in").mkdir()
    for name, frames in (("a", 6), ("b", 3)):
        data = cloud_log(tmp_path / "in" / f"{name}.mcap", frames=frames, points=300).read_bytes()
        put(bucket / f"in/{name}.mcap", data)
    return bucket / "in"


def run(line):
    return execute(*shlex.split(line))


digest_there = on_paths(digest_of_paths)


def contents(folder):
    return {name: get(folder / name) for name in names(folder)}


@pytest.mark.parametrize("remote", ["logs", "outputs", "both"])
def test_complete_outputs_are_skipped(logs, bucket, tmp_path, remote):
    given = "in" if remote == "outputs" else str(logs)
    out = "out" if remote == "logs" else f"{bucket}/out"
    line = f"filter {given} -o {out}/ -j 2 --resume --csv"
    first = run(f"{line} first.csv --manifest runs.json --force")
    assert first.stdout.startswith("2 done; ")
    assert " 0 B out" not in first.stdout
    sizes = [row["bytes_out"] for row in json.loads((tmp_path / "runs.json").read_text())]
    assert sizes == [
        len((tmp_path / "out" / name).read_bytes() if remote == "logs" else get(bucket / "out" / name))
        for name in ("a.mcap", "b.mcap")
    ]
    again = run(f"{line} again.csv")
    assert again.exit_code == 0
    assert again.stdout.startswith("2 skipped; ")
    assert (tmp_path / "again.csv").read_bytes() == (tmp_path / "first.csv").read_bytes()
    put(logs / "b.mcap", cloud_log(tmp_path / "in" / "b.mcap", frames=4, points=300).read_bytes())
    other = run(f"{line} other.csv")
    assert other.stdout.startswith("1 done, 1 skipped; ")
    assert "b: filtered again; the earlier output is of another input" in other.stderr


@pytest.mark.parametrize("jobs", [1, 2])
@pytest.mark.parametrize("command", ["filter", "convert", "info", "evaluate"])
def test_several_recordings_with_any_number_of_processes(logs, bucket, command, jobs):
    put(logs / "c.mcap", get(logs / "b.mcap"))
    words = {"info": "", "evaluate": "-m none --labels {0}"}.get(command, "-o {1}/out/").format(logs, bucket)
    if command == "evaluate":
        for name in "abc":
            put(logs / f"{name}.labels.csv", b"frame,track_id,class,x,y,z,length,width,height,yaw\n0,,none,,,,,,,\n")
    result = run(f"{command} {logs}/*.mcap -j {jobs} {words}")
    assert result.exit_code == 0, result.output
    if command in ("filter", "convert"):
        assert names(bucket / "out") == ["a.mcap", "b.mcap", "c.mcap"]


def test_objects_of_a_large_folder_count_by_their_versions(logs):
    for number in range(70):
        put(logs / f"frames/{number:06d}.bin", bytes([number]))
    before = digest_there([logs / "frames"])
    assert digest_there([logs / "frames"]) == before
    put(logs / "frames/000040.bin", b"x")
    assert digest_there([logs / "frames"]) != before


def test_a_run_may_go_on_elsewhere(logs, bucket, tmp_path):
    """A trial is copied into a bucket with its outputs: they are still of these logs."""
    assert run("filter in -o out/").exit_code == 0
    for name in ("a", "b"):
        put(bucket / f"out/{name}.mcap", (tmp_path / f"out/{name}.mcap").read_bytes())
    assert run(f"filter {logs} -o {bucket}/out/ --resume").stdout.startswith("2 skipped; ")


def test_an_object_that_is_no_output_is_not_replaced(logs, bucket):
    put(bucket / "out/a.mcap", b"something else")
    result = run(f"filter {logs} -o {bucket}/out/ --resume")
    assert result.exit_code == 2
    assert f"{bucket}/out/a.mcap: not a filtered log, not replaced" in result.stderr
    assert contents(bucket / "out") == {"a.mcap": b"something else"}


def test_folders_have_the_digest_of_their_copies(logs, bucket, tmp_path):
    for name, data in (("a.b/1.pcd", b"1"), ("a/2.pcd", b"22"), ("a/b/3.pcd", b"333"), ("z.pcd", bytes(3_000_000))):
        put(bucket / "f" / name, data)
        (tmp_path / "f" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "f" / name).write_bytes(data)
    assert digest_there([bucket / "f"]) == digest_of_paths([tmp_path / "f"])
    assert digest_there([bucket / "f/z.pcd"]) == digest_of_paths([tmp_path / "f/z.pcd"])
    put(bucket / "f/z.pcd", bytes(2_999_999) + b"1")
    assert digest_there([bucket / "f/z.pcd"]) != digest_of_paths([tmp_path / "f/z.pcd"])


def test_a_plan_copies_and_writes_nothing(logs, bucket):
    put(bucket / "out/a.mcap", b"something else")
    result = run(f"filter {logs} -o {bucket}/out/ --dry-run --json")
    assert result.exit_code == 1
    rows = json.loads(result.stdout)["recordings"]
    assert [(row["status"], row["bytes_in"] > 0) for row in rows] == [("refuse", True), ("do", True)]
    assert rows[0]["reason"] == f"{bucket}/out/a.mcap: already exists; use --force to replace it"
    assert contents(bucket / "out") == {"a.mcap": b"something else"}
