"""Outputs in other formats than MCAP in object storage."""

import shlex

import pytest
from click.testing import CliRunner

from seaclutter_cli.commands import cli
from tests.logs import START_NS, Entry, cloud_messages, cloud_topic, write_log
from tests.storage.buckets import names


@pytest.fixture
def log(tmp_path, scratch, monkeypatch):
    """Return a log; the working folder contains it."""
    monkeypatch.chdir(tmp_path)
    entries = [Entry("/points", START_NS + k, data) for k, data in enumerate(cloud_messages("ros2", 3, 50))]
    return write_log(tmp_path / "a.mcap", [cloud_topic("/points")], entries)


def run(line, exit_code=0):
    result = CliRunner().invoke(cli, shlex.split(line))
    assert result.exit_code == exit_code, result.output
    return result


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
def test_a_folder_in_a_bucket_is_not_replaced(bucket):
    line = f"convert a.mcap -o {bucket}/out/ --to pcd -n"
    run(f"{line} 3")
    assert "already exists" in run(f"{line} 2 --force", exit_code=1).stderr
    assert len(names(bucket / "out")) == 5


@pytest.mark.usefixtures("log")
def test_parts_in_a_bucket_are_files_of_a_ros_2_recording_only(bucket):
    result = run(f"convert a.mcap -o {bucket}/out.bag --split 1s", exit_code=2)
    assert "--split needs an output on this machine, or --to rosbag2-mcap" in result.stderr
