"""Runs that go on where an earlier one stopped."""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from seaclutter_cli.runs import resume
from tests.logs import LAYOUTS, cloud_log
from tests.running import execute
from tests.runs.test_batch import untimed


@pytest.fixture
def trial(tmp_path):
    """Return a folder with logs, one of them damaged."""
    logs = tmp_path / "logs"
    logs.mkdir()
    for name, frames in (("a", 6), ("b", 3)):
        cloud_log(logs / f"{name}.mcap", frames=frames, points=300)
    data = (logs / "a.mcap").read_bytes()
    (logs / "c.mcap").write_bytes(data[: len(data) * 2 // 3])
    return tmp_path


def run(folder, *options, logs="logs", out="out/"):
    target = f"{folder / out}{'/' if out.endswith('/') else ''}"
    return execute("filter", folder / logs, "-o", target, "-j", 1, *options)


def files(folder):
    return {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in sorted((folder / "out").iterdir())}


def contents(folder):
    return {name: data for name, (data, _) in files(folder).items()}


def test_complete_recordings_are_skipped_and_their_outcomes_restored(trial):
    first = run(trial, "--json")
    before = files(trial)
    again = run(trial, "--json", "--resume")
    assert files(trial) == before
    assert again.exit_code == first.exit_code == 3
    assert "Damaged: " in again.stderr
    status = {row["recording"]: row["status"] for row in json.loads(again.stdout)}
    assert status == dict.fromkeys("abc", "skipped")
    restored = untimed(again.stdout).replace('"skipped"', '"done"')
    assert restored == untimed(first.stdout).replace('"damaged"', '"done"')


@pytest.mark.parametrize("method", ["joint", "confirmed", "adaptive_radius", "none"])
def test_sums_of_every_kind_are_restored(trial, method):
    options = (
        ("--json", "-m", method, "-s", "filter.scene=open") if method == "adaptive_radius" else ("--json", "-m", method)
    )
    first, again = run(trial, *options), run(trial, *options, "--resume")
    assert untimed(again.stdout).replace('"skipped"', '"done"') == untimed(first.stdout).replace('"damaged"', '"done"')


def test_missing_recordings_are_filtered(trial):
    run(trial)
    before = files(trial)
    (trial / "out" / "b.mcap").unlink()
    result = run(trial, "--resume")
    assert result.stdout.startswith("1 done, 2 skipped; ")
    after = files(trial)
    assert {name: data for name, (data, _) in after.items()} == {name: data for name, (data, _) in before.items()}
    assert [name for name in after if after[name][1] != before[name][1]] == ["b.mcap"]


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["-s", "filter.start_m=12"], "another configuration"),
        (["-m", "sor"], "another configuration"),
        (["-n", "2"], "other options"),
        (["--keep-raw"], "other options"),
        (["--compression", "lz4"], "other options"),
        (["-t", "/points"], "other options"),
    ],
)
def test_other_settings_filter_again(trial, options, reason):
    run(trial)
    result = run(trial, "--resume", *options)
    lines = [line for line in result.stderr.splitlines() if "filtered again" in line]
    assert lines == [f"{name}: filtered again; the earlier output is of {reason}" for name in "abc"]
    resumed = contents(trial)
    shutil.rmtree(trial / "out")
    run(trial, *options)
    assert contents(trial) == resumed


def test_another_input_is_filtered_again(trial):
    run(trial)
    cloud_log(trial / "logs" / "b.mcap", frames=4, points=300)
    result = run(trial, "--resume")
    assert "b: filtered again; the earlier output is of another input" in result.stderr
    assert result.stdout.startswith("1 done, 2 skipped; ")


def frames_as_arrays(folder, frames, points=50):
    folder.mkdir(exist_ok=True)
    for number in range(frames):
        np.save(folder / f"{number:06d}.npy", np.full((points, 4), number + 1, np.float32))


@pytest.mark.parametrize("frames", [3, 70])
def test_a_folder_of_frames_of_which_one_changed_is_filtered_again(tmp_path, frames):
    frames_as_arrays(tmp_path / "logs", frames)
    assert run(tmp_path, "-m", "none", out="out.mcap").exit_code == 0
    time_ns = (tmp_path / "out.mcap").stat().st_mtime_ns
    np.save(tmp_path / "logs" / "000001.npy", np.full((50, 4), 7, np.float32))
    os.utime(tmp_path / "logs" / "000001.npy", ns=(time_ns - 10**12,) * 2)
    assert "is of another input" in run(tmp_path, "-m", "none", "--resume", out="out.mcap").stderr


def test_a_change_in_the_middle_of_a_file_is_noticed_by_its_time(trial):
    path = cloud_log(trial / "logs" / "b.mcap", LAYOUTS["none"], frames=40, points=5000)
    assert path.stat().st_size > 3 * 2**20
    run(trial)
    with path.open("r+b") as file:
        file.seek(path.stat().st_size // 2)
        file.write(b"change")
    result = run(trial, "--resume")
    assert "b: filtered again; the earlier output is of an input that was changed since" in result.stderr
    assert run(trial, "--resume").stdout.startswith("3 skipped; ")
    os.utime(path, (2**32, 2**32))  # a clock that was wrong says nothing
    assert run(trial, "--resume").stdout.startswith("3 skipped; ")


@pytest.mark.parametrize(
    "altered",
    [
        {"counts": [1, 2]},
        {"counts": "many"},
        {"counts": [[1, 2], [3, 4]]},
        {"counts": [10**30] * 9},
        {"counts": [2**62] * 9},
        {"frames": "six"},
        {"frames": -1},
        {"points_in": 1.5},
        {"water": [1.0]},
        {"scenes": {"open": "many"}},
        {"scenes": 5},
        {"rings": []},
        {"rings": {"thresholds": [1.0]}},
    ],
    ids=repr,
)
def test_a_record_that_was_altered_is_filtered_again(trial, altered):
    out, options = trial / "out", ("--to", "pcd")
    assert run(trial, *options, logs="logs/b.mcap", out="out").exit_code == 0
    content = json.loads((out / "seaclutter.json").read_text())
    (record,) = [one["entries"] for one in content["metadata"] if one["name"] == "seaclutter.run"]
    outcome = json.loads(record["outcome"])
    outcome["topics"]["/points"].update(altered)
    record["outcome"] = json.dumps(outcome)
    (out / "seaclutter.json").write_text(json.dumps(content))
    result = run(trial, *options, "--resume", logs="logs/b.mcap", out="out")
    assert result.exit_code == 0, result.output
    assert "filtered again; the earlier output is of incomplete record" in result.stderr


def test_another_version_is_filtered_again(trial, monkeypatch):
    monkeypatch.setattr(resume, "__version__", "0.0.1")
    run(trial)
    monkeypatch.undo()
    result = run(trial, "--resume")
    assert result.stderr.count("filtered again; the earlier output is of another version of seaclutter") == 3


@pytest.mark.parametrize("content", [b"", b"something else", "raw"])
def test_a_file_that_is_no_output_is_not_replaced(trial, content):
    (trial / "out").mkdir()
    data = (trial / "logs" / "a.mcap").read_bytes() if content == "raw" else content
    (trial / "out" / "b.mcap").write_bytes(data)
    result = run(trial, "--resume")
    assert result.exit_code == 2
    assert "b.mcap: " in result.stderr
    assert "not replaced" in result.stderr
    assert contents(trial) == {"b.mcap": data}
    assert run(trial, "--resume", "--force").exit_code == 3
    assert len(contents(trial)) == 3


def test_one_recording(trial):
    line = ["filter", str(trial / "logs" / "a.mcap"), "-o", str(trial / "a.mcap"), "--resume"]
    assert "frames/s" in execute(*line).stdout
    again = execute(*line, code=0)
    assert "6 frames; skipped, the output was complete" in again.stdout


def test_a_manifest_lists_skipped_recordings(trial):
    manifest = str(trial / "runs.json")
    run(trial, "--manifest", manifest)
    assert run(trial, "--resume", "--manifest", manifest).exit_code == 3
    rows = json.loads((trial / "runs.json").read_text())
    assert [(row["status"], row["frames"]) for row in rows[:2]] == [("skipped", 6), ("skipped", 3)]


@pytest.mark.parametrize(
    ("options", "jobs"),
    [((), 1), (("-m", "confirmed"), 2), (("-m", "none"), 1), (("-m", "adaptive_radius", "-s", "filter.scene=open"), 2)],
)
def test_the_table_of_frames_is_complete(trial, options, jobs):
    first, again = str(trial / "first.csv"), str(trial / "again.csv")
    run(trial, "--csv", first, *options)
    (trial / "out" / "b.mcap").unlink()
    before = files(trial)
    result = run(trial, "--resume", "--csv", again, "-j", jobs, *options)
    assert result.exit_code == 3
    assert result.stdout.startswith("1 done, 2 skipped; ")
    assert (trial / "again.csv").read_bytes() == (trial / "first.csv").read_bytes()
    assert {name: kept for name, kept in files(trial).items() if name != "b.mcap"} == before


def test_the_table_of_two_topics_and_of_one_recording(trial):
    logs = trial / "logs"
    for path in logs.iterdir():
        path.unlink()
    cloud_log(logs / "two.mcap", frames=5, points=100, topics=("/left", "/right"))
    for name in ("first.csv", "again.csv"):
        options = ("-t", "/left", "-t", "/right", "--csv", str(trial / name), "--resume")
        assert run(trial, *options).exit_code == 0
    assert (trial / "again.csv").read_bytes() == (trial / "first.csv").read_bytes()
    assert len((trial / "first.csv").read_bytes().splitlines()) == 11


def test_without_diagnostics_the_table_needs_another_run(trial):
    run(trial, "--no-diagnostics", "--csv", str(trial / "first.csv"))
    result = run(trial, "--resume", "--no-diagnostics", "--csv", str(trial / "again.csv"))
    assert result.stdout.startswith("2 done, 1 damaged; ")
    assert result.stderr.count("filtered again; the output lacks the diagnostics that the table needs") == 3
    assert (trial / "again.csv").read_bytes() == (trial / "first.csv").read_bytes()


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL")
@pytest.mark.parametrize("moments", [2, pytest.param(40, marks=pytest.mark.slow)])
def test_a_killed_run_goes_on(trial, moments):
    for name in "defgh":
        cloud_log(trial / "logs" / f"{name}.mcap", frames=20, points=2000)
    assert run(trial, "--csv", str(trial / "all.csv")).exit_code == 3
    expected = contents(trial)
    command = [sys.executable, "-m", "seaclutter_cli", "filter", str(trial / "logs"), "-o", f"{trial / 'out'}/", "-q"]
    rng = random.Random(5)
    for _ in range(moments):
        shutil.rmtree(trial / "out")
        process = subprocess.Popen(
            [*command, "-j", "2", "--resume"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        time.sleep(rng.uniform(0.5, 4.0))
        process.send_signal(signal.SIGKILL)
        process.wait()
        result = run(trial, "--resume", "--csv", str(trial / "table.csv"))
        assert result.exit_code == 3
        assert (trial / "table.csv").read_bytes() == (trial / "all.csv").read_bytes()
        assert {name: data for name, data in contents(trial).items() if not name.startswith(".")} == expected
