"""Outputs in other formats than MCAP in object storage."""

import shlex

import pytest

from seaclutter_cli.storage.objects import Upload
from tests.logs import START_NS, Entry, cloud_messages, cloud_topic, write_log
from tests.running import execute
from tests.storage.buckets import get, names, put


@pytest.fixture
def log(tmp_path, scratch, monkeypatch):
    """Return a log; the working folder contains it."""
    monkeypatch.chdir(tmp_path)
    entries = [Entry("/points", START_NS + k, data) for k, data in enumerate(cloud_messages("ros2", 3, 50))]
    return write_log(tmp_path / "a.mcap", [cloud_topic("/points")], entries)


def run(line, exit_code=0):
    return execute(*shlex.split(line), code=exit_code)


@pytest.mark.usefixtures("log")
@pytest.mark.parametrize("form", ["bag", "rosbag2-db3", "npz"])
def test_outputs_appear_in_a_bucket_and_are_read_from_it(bucket, form):
    expected = {
        "bag": {"a.bag"},
        "rosbag2-db3": {"a/a_0.db3", "a/metadata.yaml"},
        "npz": {"a/seaclutter.json", "a/times.txt", *(f"a/00000{k}.npz" for k in range(3))},
    }[form]
    line = f"filter a.mcap -o {bucket}/out/ --to {form} -m none --no-diagnostics"
    run(line)
    assert set(names(bucket / "out")) == expected
    assert "skipped, the output was complete" in run(f"{line} --resume").output
    assert "already exists" in run(line, exit_code=2).stderr
    run(f"convert {bucket}/out/{'a.bag' if form == 'bag' else 'a'} -o back.mcap")
    assert "3 frames" in run("filter back.mcap -o again.mcap -m none").output


@pytest.mark.usefixtures("log")
@pytest.mark.parametrize("form", ["pcd", "npz", "rosbag2-mcap"])
def test_a_folder_in_a_bucket_is_replaced_as_a_whole(bucket, form):
    line = f"convert a.mcap -o {bucket}/out/ --to {form}"
    run(f"{line} -n 3")
    before = {name: get(bucket / "out" / name) for name in names(bucket / "out")}
    assert "already exists" in run(f"{line} -n 2", exit_code=2).stderr
    assert {name: get(bucket / "out" / name) for name in names(bucket / "out")} == before
    run(f"{line} -n 2 --force")
    fewer = {name: get(bucket / "out" / name) for name in names(bucket / "out")}
    run(f"convert a.mcap -o {bucket}/fresh/ --to {form} -n 2")
    fresh = {name: get(bucket / "fresh" / name) for name in names(bucket / "fresh")}
    assert fewer.keys() == fresh.keys() < before.keys() or form == "rosbag2-mcap"
    run(f"{line} -n 2 --resume")
    assert {name: get(bucket / "out" / name) for name in names(bucket / "out")} == fewer
    run(f"{line} -n 3 --resume")
    assert {name: get(bucket / "out" / name) for name in names(bucket / "out")} == before


@pytest.mark.usefixtures("log")
def test_a_folder_without_its_marker_is_never_replaced(bucket):
    put(bucket / "out" / "a" / "holiday.jpg", b"not ours")
    error = run(f"convert a.mcap -o {bucket}/out/ --to pcd --force", exit_code=2).stderr
    assert "is a folder without seaclutter.json, so it is incomplete or of something else" in " ".join(error.split())
    assert names(bucket / "out") == ["a/holiday.jpg"]


@pytest.mark.usefixtures("log")
def test_a_folder_with_other_objects_is_never_replaced(bucket):
    run(f"convert a.mcap -o {bucket}/out/ --to pcd")
    put(bucket / "out" / "a" / "photos" / "holiday.jpg", b"not ours")
    before = names(bucket / "out")
    error = run(f"convert a.mcap -o {bucket}/out/ --to pcd --force", exit_code=2).stderr
    assert "not of the run that wrote it, photos" in " ".join(error.split())
    assert names(bucket / "out") == before


@pytest.mark.usefixtures("log")
def test_a_replaced_folder_has_no_marker_until_it_is_complete(bucket, monkeypatch):
    """Another program that reads it then sees that it is incomplete."""
    run(f"convert a.mcap -o {bucket}/out/ --to pcd -n 3")
    seen = []
    complete = Upload._complete

    def noted(self, url):
        seen.append("a/seaclutter.json" in names(bucket / "out"))
        complete(self, url)

    monkeypatch.setattr(Upload, "_complete", noted)
    run(f"convert a.mcap -o {bucket}/out/ --to pcd -n 2 --force")
    assert seen == [False] * 4
    assert set(names(bucket / "out")) == {"a/000000.pcd", "a/000001.pcd", "a/seaclutter.json", "a/times.txt"}


@pytest.mark.usefixtures("log")
@pytest.mark.parametrize("suffix", ["bag", "mcap"])
def test_parts_in_a_bucket(bucket, suffix):
    line = f"convert a.mcap -o {bucket}/out.{suffix} --split 1B"
    run(line)
    assert names(bucket) == [f"out_{k}.{suffix}" for k in range(3)]
    assert "already exists" in run(line, exit_code=2).stderr
    assert "skipped, the output was complete" in run(f"{line} --resume").output
    run(f"{line} --force -n 2")
    assert names(bucket) == [f"out_{k}.{suffix}" for k in range(2)]
    run(f"convert {bucket}/out_1.{suffix} -o back.mcap")
    assert "1 frame" in run("filter back.mcap -o again.mcap -m none").output
