"""Plans of runs: what would be done, and nothing is."""

import json
import tempfile

import pytest

from tests.logs import START_NS, Entry, Topic, cloud_log, write_log
from tests.running import execute


@pytest.fixture
def trial(tmp_path, monkeypatch):
    """Return a folder with logs, one of them damaged and one no log; no temporary file is left."""
    logs, temporary = tmp_path / "logs", tmp_path / "tmp"
    logs.mkdir()
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    for name, frames in (("a", 30), ("b", 3)):
        cloud_log(logs / f"{name}.mcap", frames=frames, points=300)
    data = (logs / "a.mcap").read_bytes()
    (logs / "c.mcap").write_bytes(data[: len(data) * 2 // 3])
    (logs / "d.mcap").write_bytes(b"no log")
    yield tmp_path
    assert not list(temporary.glob("seaclutter*"))


def invoke(folder, *options):
    return execute("filter", folder / "logs", "-o", f"{folder / 'out'}/", "-j", "1", *options)


def planned(folder, *options):
    """Return the plan of each recording, after a check that nothing is written."""
    before = state(folder)
    result = invoke(folder, "--dry-run", "--json", *options)
    assert state(folder) == before
    data = json.loads(result.stdout)
    return {row["recording"]: (row["status"], row["reason"]) for row in data["recordings"]}, data, result.exit_code


def state(folder):
    return {path: (path.stat().st_mtime_ns, path.stat().st_size) for path in folder.rglob("*") if path.name != "tmp"}


def test_a_first_run(trial):
    plan, data, status = planned(trial, "--csv", str(trial / "f.csv"), "--manifest", str(trial / "m.csv"))
    assert {name: plan[name] for name in "abc"} == dict.fromkeys("abc", ("do", None))
    assert plan["d"][0] == "refuse"
    assert "no readable record" in plan["d"][1]
    assert status == 1
    assert [row["frames"] for row in data["recordings"]][:2] == [30, 3]
    assert data["recordings"][0]["bytes_in"] == (trial / "logs" / "a.mcap").stat().st_size
    assert data["recordings"][2]["damage"]
    assert data["bytes_in"] == sum(row["bytes_in"] for row in data["recordings"] if row["status"] == "do")
    assert data["free_bytes"] > 0


def test_the_plan_is_what_the_run_does(trial):
    (trial / "logs" / "d.mcap").unlink()
    assert planned(trial)[2] == invoke(trial).exit_code == 3
    assert planned(trial)[0]["a"] == ("refuse", f"{trial}/out/a.mcap: already exists; use --force to replace it")
    assert invoke(trial).exit_code == 2
    assert planned(trial, "--force")[0] == dict.fromkeys("abc", ("do", "replaces the output"))
    assert planned(trial, "--resume")[0] == dict.fromkeys("abc", ("skip", "the output is complete"))
    (trial / "out" / "b.mcap").unlink()
    cloud_log(trial / "logs" / "a.mcap", frames=4, points=300)
    plan, _, _ = planned(trial, "--resume")
    again = "the earlier output is of another input"
    assert plan == {"a": ("do", again), "b": ("do", None), "c": ("skip", "the output is complete")}
    assert invoke(trial, "--resume").stdout.startswith("2 done, 1 skipped; ")


def test_as_text(trial):
    result = invoke(trial, "--dry-run", "-j", "2")
    lines = result.stdout.splitlines()
    assert lines[0].split() == ["recording", "size", "frames", "plan"]
    assert lines[2].split()[3:] == ["3", "do", "->", f"{trial}/out/b.mcap"]
    assert "damaged part" in lines[3]
    assert lines[5].startswith("3 to do, 1 to refuse; ")
    assert len(lines) == 6


def test_a_run_that_cannot_start(trial):
    manifest = trial / "m.csv"
    manifest.write_text("important\n")
    result = invoke(trial, "--dry-run", "--manifest", str(manifest))
    assert result.exit_code == 2
    assert "m.csv: already exists" in result.stderr
    inside = execute("filter", trial / "logs", "-o", str(trial / "logs") + "/", "--dry-run", code=2)
    assert "is part of the input" in inside.stderr


def test_no_frame_is_filtered(trial, monkeypatch):
    monkeypatch.setattr("seaclutter_cli.runs.filter.FilterWork.run", None)
    assert planned(trial)[0]["a"] == ("do", None)


def test_outputs_that_do_not_fit(trial, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("U", (), {"free": 10})())
    assert "the outputs may not fit" in invoke(trial, "--dry-run").stderr


@pytest.mark.parametrize("form", ["bag", "npz"])
def test_a_plan_of_a_conversion_is_what_the_run_does(trial, form):
    line = ["convert", str(trial / "logs"), "-o", f"{trial}/out/", "--to", form, "--json"]
    plan = execute(*line, "--dry-run", code=1)  # d.mcap is no log
    assert not (trial / "out").exists()
    planned = json.loads(plan.stdout)
    found = {one["recording"]: (one["status"], one["frames"]) for one in planned["recordings"]}
    assert found["a"] == ("do", 30)
    assert found["b"] == ("do", 3)
    assert found["d"][0] == "refuse"
    assert execute(*line).exit_code in (1, 3)
    again = json.loads(execute(*line, "--dry-run", "--resume").stdout)
    assert [one["status"] for one in again["recordings"]][:2] == ["skip", "skip"]
    refused = json.loads(execute(*line, "--dry-run").stdout)
    assert refused["recordings"][0]["status"] == "refuse"
    assert "--force" in refused["recordings"][0]["reason"]


def test_a_plan_of_a_log_without_clouds(tmp_path):
    log = tmp_path / "imu.mcap"
    topic = Topic("/wind", "json", ("Wind", "jsonschema", b"{}"))
    write_log(log, [topic], [Entry("/wind", START_NS, b"{}")])
    result = execute("convert", log, "-o", tmp_path / "b.mcap", "--dry-run", code=0)
    assert "1 to do" in result.stdout
