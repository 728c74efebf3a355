"""Several recordings in one run: results do not depend on the number of processes."""

import csv
import json
import os
import re
import shutil
import signal
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

import seaclutter
from seaclutter_cli.commands.console import Console
from seaclutter_cli.errors import SeaclutterError
from seaclutter_cli.runs.batch import Work, run_all
from seaclutter_cli.runs.observer import Silent, raising
from seaclutter_cli.runs.options import BatchOptions
from seaclutter_cli.runs.recordings import Outcome
from seaclutter_cli.sources.recordings import Recording
from tests.logs import cloud_log
from tests.running import execute


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Return a folder with recordings of different lengths, one damaged and one that cannot be read."""
    folder = tmp_path_factory.mktemp("trial")
    for name, frames in (("a", 9), ("b", 2), ("d", 5)):
        cloud_log(folder / f"{name}.mcap", frames=frames, points=500)
    data = (folder / "a.mcap").read_bytes()
    (folder / "c.mcap").write_bytes(data[: len(data) * 2 // 3])
    (folder / "e.mcap").write_bytes(b"no log")
    return folder


def filtered(logs, folder, *options):
    out = folder / "out"
    line = ["filter", str(logs), "-o", f"{out}/", "--csv", str(folder / "frames.csv"), "--json", *options]
    result = execute(*line)
    files = {path.name: path.read_bytes() for path in sorted(out.iterdir())} if out.exists() else {}
    table = folder / "frames.csv"
    return result, files, table.read_bytes() if table.exists() else None


def untimed(text):
    """Return JSON without what depends on time and place."""
    return re.sub(r'"(seconds|filter_ms)": [\d.]+|"output": "[^"]*"', "", text)


@pytest.mark.parametrize("method", ["joint", "confirmed"])
def test_results_do_not_depend_on_the_number_of_processes(logs, tmp_path, method):
    runs = []
    for jobs in ("1", "3"):
        folder = tmp_path / jobs
        folder.mkdir()
        runs.append(filtered(logs, folder, "-m", method, "-j", jobs))
    (first, files, table), *others = runs
    assert first.exit_code == 1
    assert sorted(files) == ["a.mcap", "b.mcap", "c.mcap", "d.mcap"]
    assert [row["recording"] for row in json.loads(first.stdout)] == ["a", "b", "c", "d", "e"]
    recordings = [line.split(b",")[0] for line in table.splitlines()[1:]]
    assert recordings == sorted(recordings)
    assert set(recordings) == {b"a", b"b", b"c", b"d"}
    for result, same_files, same_table in others:
        assert result.exit_code == 1
        assert same_files == files
        assert same_table == table
        assert untimed(result.stdout) == untimed(first.stdout)
        assert sorted(named(result.stderr)) == sorted(named(first.stderr))


def named(text):
    """Return the lines about recordings without durations and paths of outputs."""
    return [re.sub(r"[\d.]+ s -> \S+", "", line) for line in text.splitlines()]


def test_a_line_for_each_recording_and_the_totals(logs, tmp_path):
    result = execute("filter", logs, "-o", f"{tmp_path}/", "-j", "2")
    assert result.stdout.startswith("3 done, 1 damaged, 1 failed; ")
    assert len(result.stdout.splitlines()) == 1
    lines = sorted(result.stderr.splitlines())
    assert len(lines) == 5
    assert re.fullmatch(r"a: 9 frames, \S+ % of the points kept, [\d.]+ s -> .*/a\.mcap", lines[1])
    assert "; damaged: " in lines[3]
    assert lines[0].startswith("Error: ")


def test_details_of_each_recording_if_verbose(logs, tmp_path):
    result = execute("filter", logs, "-o", f"{tmp_path}/", "-j", "2", "-v")
    assert result.stdout.count("range ring") == 4
    assert "Damaged: " in result.stderr


def test_quiet_shows_errors_only(logs, tmp_path):
    result = execute("filter", logs, "-o", f"{tmp_path}/", "-j", "2", "-q")
    assert result.stdout == ""
    assert [line.split(":")[0] for line in result.stderr.splitlines()] == ["Error"]


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_a_topic_that_one_log_lacks_is_an_error_of_that_log(tmp_path, jobs):
    (tmp_path / "logs").mkdir()
    for name, topic in (("a", "/points"), ("b", "/other"), ("c", "/points")):
        cloud_log(tmp_path / "logs" / f"{name}.mcap", topics=(topic,))
    out = tmp_path / "out"
    result = execute("filter", tmp_path / "logs", "-t", "/points", "-o", f"{out}/", "-j", jobs, code=1)
    (line,) = [line for line in result.stderr.splitlines() if line.startswith("Error")]
    assert "b" in line
    assert "/other" in line
    assert sorted(path.name for path in out.iterdir()) == ["a.mcap", "c.mcap"]


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_fail_fast_stops_after_an_error(logs, tmp_path, jobs):
    more = [shutil.copy(logs / "b.mcap", tmp_path / f"more{number:02}.mcap") for number in range(30)]
    line = ["filter", str(logs / "e.mcap"), *(str(logs / f"{name}.mcap") for name in "adb"), *map(str, more)]
    result = execute(*line, "-o", f"{tmp_path}/out/", "-j", jobs, "--fail-fast", "--json", code=1)
    assert "not processed" in [row["error"] for row in json.loads(result.stdout)]
    assert not list(tmp_path.glob("out/.*.part"))


@pytest.mark.parametrize("text", ["0", "-1", "two", "1.5", ""])
def test_a_wrong_number_of_jobs(logs, tmp_path, text):
    result = execute("filter", logs, "-o", f"{tmp_path}/", "-j", text, code=2)
    assert "expected a positive whole number or auto" in result.stderr


def test_the_api_raises_the_error_of_a_recording(logs, tmp_path):
    with pytest.raises(seaclutter.InputError, match="no readable record"):
        seaclutter.filter_log(logs, f"{tmp_path}/")


class Receiver(Silent):
    """Observer that counts."""

    def __init__(self):
        self.lines, self.errors, self.warnings = [], [], []

    def warn(self, text):
        self.warnings.append(text)

    def done(self, line, damage, error):
        self.lines.append(line)
        self.errors.append(error)


@dataclass(frozen=True)
class Step(Work[Outcome]):
    recording: Recording
    kills: bool = False

    def fill(self, outcome, observer):
        observer.warn(f"r: careful in {os.getpid()}")
        with observer.progress("x", 4) as step:
            for _ in range(4):
                step()
        if self.kills:
            os.kill(os.getpid(), signal.SIGKILL)


def works(count, kills=()):
    return [Step(Recording((Path(f"r{k}"),)), k in kills) for k in range(count)]


@pytest.mark.parametrize("jobs", [1, 3])
def test_outcomes_come_in_order(jobs):
    passed, receiver = [], Receiver()
    outcomes = run_all(works(6), BatchOptions(jobs=jobs), receiver, lambda one: passed.append(one.recording))
    assert [one.recording for one in outcomes] == passed == [f"r{k}" for k in range(6)]
    assert sorted(line.split(":")[0] for line in receiver.lines) == passed
    assert sorted(text.split(": ")[:2] for text in receiver.warnings) == [[f"r{k}", "r"] for k in range(6)]


def test_messages_appear_when_they_come_if_recordings_come_one_after_another():
    receiver = Receiver()
    stages = []
    receiver.done = lambda *_: stages.append("done")
    receiver.warn = lambda text: stages.append(text.split(":")[0])
    run_all(works(2), BatchOptions(jobs=1), receiver)
    assert stages == ["r0", "done", "r1", "done"]

    class Stops(Step):
        def run(self, observer):
            observer.warn("careful")
            assert stages[-1] == self.recording.name
            return super().run(observer)

    run_all([Stops(Recording((Path(f"r{k}"),))) for k in range(2)], BatchOptions(jobs=1), receiver)


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL")
def test_a_run_that_raises_ends_with_the_first_error():
    receiver, passed = Receiver(), []
    with pytest.raises(SeaclutterError, match=r"r1: .*killed"):
        run_all(works(3, kills={1}), BatchOptions(jobs=2), raising(receiver), passed.append)
    assert not any(receiver.errors)


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL")
def test_a_recording_that_kills_its_process_fails_alone():
    receiver = Receiver()
    outcomes = run_all(works(5, kills={1}), BatchOptions(jobs=2), receiver)
    assert [one.error is None for one in outcomes] == [True, False, True, True, True]
    assert "killed (SIGKILL), perhaps because memory ran out, 2 times" in outcomes[1].error
    assert sum(error is not None for error in receiver.errors) == 1


@pytest.fixture(scope="module")
def labelled(tmp_path_factory):
    """Return a folder with labelled recordings, one of which has labels that cannot be read."""
    folder = tmp_path_factory.mktemp("labelled")
    for seed in (1, 2, 3):
        execute("simulate", "passing_speedboat", "-o", folder / f"s{seed}.mcap", "--seed", seed, "-n", 6, "-q", code=0)
    return folder


def test_evaluations_do_not_depend_on_the_number_of_processes(labelled, tmp_path):
    found = []
    for jobs in ("1", "2"):
        table, summary = tmp_path / f"{jobs}.csv", tmp_path / f"{jobs}.json"
        line = ["evaluate", str(labelled), "--labels", str(labelled), "--compare", "paper", "-j", jobs]
        result = execute(*line, "-o", table, "--summary", summary, code=0)
        assert len(result.stderr.splitlines()) == 3
        times = r'"(seconds|median|p99)": [\d.e-]+'
        found.append((table.read_bytes(), re.sub(times, "", summary.read_text())))
    assert found[0] == found[1]
    rows = found[0][0].splitlines()
    assert len(rows) == 1 + 3 * 6 * 5
    assert b"target_points_in" in rows[0]


@pytest.mark.parametrize("method", ["joint", "confirmed"])
def test_calibrations_do_not_depend_on_the_number_of_processes(labelled, tmp_path, method):
    pytest.importorskip("matplotlib")
    found = []
    for jobs in ("1", "8"):
        config, plot = tmp_path / "c.yaml", tmp_path / "c.png"
        line = ["calibrate", str(labelled), "--labels", str(labelled), "-m", method, "-j", jobs, "--force"]
        result = execute(*line, "-o", config, "--plot", plot, code=0)
        assert sorted(line.split(":")[0] for line in result.stderr.splitlines()) == ["s1", "s2", "s3"]
        found.append((config.read_bytes(), plot.read_bytes(), result.stdout))
    assert found[0] == found[1]


def test_sweeps_do_not_depend_on_the_number_of_processes(labelled, tmp_path):
    found = []
    for jobs in ("1", "2"):
        config, table = tmp_path / "c.yaml", tmp_path / "c.csv"
        line = ["tune", str(labelled), "--labels", str(labelled), "--sweep", "update_weight=0.2,1", "-j", jobs]
        result = execute(*line, "--force", "-o", config, "--csv", table, code=0)
        assert sorted(line.split(":")[0] for line in result.stderr.splitlines()) == ["s1", "s2", "s3"]
        found.append((config.read_bytes(), table.read_bytes(), result.stdout))
    assert found[0] == found[1]
    assert found[0][1].splitlines()[1].startswith(b"0.2,12,"), "of 18 frames, two of each recording are held out"


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_a_calibration_needs_all_recordings(logs, tmp_path, jobs):
    line = ["calibrate", str(logs), "-o", str(tmp_path / "c.yaml"), "-j", jobs, "-q"]
    result = execute(*line, code=1)
    assert result.stderr.splitlines() == [f"Error: {logs / 'e.mcap'}: no readable record in this MCAP file"]
    assert not list(tmp_path.iterdir())


def test_labels_that_cannot_be_read_fail_their_recording_only(labelled, tmp_path):
    for path in labelled.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "s2.labels.csv").write_text("no labels\n")
    line = ["evaluate", str(tmp_path), "--labels", str(tmp_path), "-j", "2", "--json"]
    result = execute(*line, code=1)
    recordings = json.loads(result.stdout)["recordings"]
    assert [row["error"] is None for row in recordings] == [True, False, True]
    assert "s2.labels.csv" in recordings[1]["error"]


def test_contents_of_several_recordings_are_a_table(logs):
    result = execute("info", logs, "-j", "2", code=1)
    lines = result.stdout.splitlines()
    assert [line.split()[0] for line in lines[:-1]] == ["recording", "a", "b", "c", "d"]
    assert lines[-1] == "3 done, 1 damaged, 1 failed"
    verbose = execute("info", logs, "-j", "2", "-v").stdout
    assert verbose.count("median") == 1 + 4
    assert verbose.endswith(result.stdout)


def test_json_does_not_depend_on_the_number_of_processes(logs):
    found = [execute("info", logs, "--json", "-j", jobs).stdout for jobs in (1, 2)]
    assert untimed(found[0]) == untimed(found[1])
    assert len(json.loads(found[0])) == 5


@pytest.mark.parametrize("name", ["runs.csv", "runs.json"])
def test_a_manifest_has_a_row_for_each_recording(logs, tmp_path, name):
    out = tmp_path / "out"
    line = ["filter", str(logs), "-o", f"{out}/", "--manifest", str(tmp_path / name), "-j", "2"]
    execute(*line, code=1)
    text = (tmp_path / name).read_text()
    rows = json.loads(text) if name.endswith("json") else list(csv.DictReader(text.splitlines()))
    assert [row["recording"] for row in rows] == list("abcde")
    assert [row["status"] for row in rows] == ["done", "done", "damaged", "done", "failed"]
    assert [row["input"] for row in rows] == [str(logs / f"{name}.mcap") for name in "abcde"]
    assert int(rows[0]["frames"]) == 9
    assert int(rows[0]["points_in"]) == 9 * 500 > int(rows[0]["points_out"])
    assert int(rows[0]["bytes_out"]) == (out / "a.mcap").stat().st_size
    assert int(rows[2]["damaged_parts"]) > 0
    assert "no readable record" in rows[4]["error"]
    again = execute(*line[:2], "-o", f"{tmp_path / 'other'}/", *line[4:], code=2)
    assert "already exists" in again.stderr


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_an_interrupted_run_has_a_manifest(logs, tmp_path, monkeypatch, jobs):
    def interrupt(self, *_):
        raise KeyboardInterrupt

    manifest = tmp_path / "manifest.csv"
    monkeypatch.setattr(Console, "done", interrupt)  # after the first recording
    result, files, _ = filtered(logs, tmp_path, "--manifest", str(manifest), "-j", jobs)
    assert result.exit_code == 130
    with manifest.open(newline="") as file:
        rows = {row["recording"]: (row["status"], row["error"]) for row in csv.DictReader(file)}
    done = [f"{name}.mcap" for name, (status, _) in rows.items() if status == "done"]
    assert len(done) == 1
    assert set(done) <= set(files)
    assert len(files) <= int(jobs)  # the other process may have completed its recording, too
    assert sorted(rows) == ["a", "b", "c", "d", "e"]
    assert sum(error == "not processed" for _, error in rows.values()) == 4


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_a_warning_that_recordings_share_is_shown_once_and_counted(logs, tmp_path, jobs):
    log = tmp_path / "run.log"
    result, _, _ = filtered(logs, tmp_path, "--exclude", "/none", "-j", jobs, "--log-file", str(log))
    warned = [line for line in result.stderr.splitlines() if "matches no topic" in line]
    assert re.match(r"Warning: [abcd]: --exclude /none matches no topic", warned[0])
    assert warned[1:] == ["Warning: 3 more: --exclude /none matches no topic"]
    assert len(re.findall(r" [abcd]: --exclude /none matches no topic", log.read_text())) == 4


def test_a_manifest_of_an_evaluation(labelled, tmp_path):
    line = ["evaluate", str(labelled), "--labels", str(labelled), "--manifest", str(tmp_path / "m.csv")]
    execute(*line, code=0)
    rows = list(csv.DictReader((tmp_path / "m.csv").read_text().splitlines()))
    assert [(row["recording"], row["frames"], row["output"]) for row in rows] == [(f"s{k}", "6", "") for k in (1, 2, 3)]
    assert all(row["false_alarms"].isdigit() and row["missed_targets"].isdigit() for row in rows)


def test_a_log_file_has_all_messages(logs, tmp_path):
    log = tmp_path / "run.log"
    line = ["filter", str(logs), "-o", f"{tmp_path}/out/", "-q", "--log-file", str(log)]
    execute(*line)
    lines = log.read_text().splitlines()
    assert lines[0] == "# seaclutter log"
    assert all(re.match(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ (INFO|WARNING|ERROR) ", text) for text in lines[1:])
    assert sum(" INFO a: 9 frames, " in text for text in lines) == 1
    assert sum("ERROR" in text for text in lines) == 1
    assert sum("WARNING damaged: " in text for text in lines) >= 1
    execute(*line)
    assert "already exists" in log.read_text().splitlines()[-1], "the error that ends a run"
    execute(*line, "--force")
    assert log.read_text().splitlines()[: len(lines)] == lines
    assert log.read_text().count("# seaclutter log") == 1


def test_a_log_file_replaces_nothing(logs, tmp_path):
    victim = tmp_path / "notes.txt"
    victim.write_text("important\n")
    line = ["filter", str(logs), "-o", f"{tmp_path}/out/", "--log-file"]
    result = execute(*line, victim, code=1)
    assert "is not a log file" in result.stderr
    assert victim.read_text() == "important\n"
    execute(*line, tmp_path / "no" / "folder" / "x.log", code=1)


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("filter {0}/a.mcap -o {1}/x.log --log-file {1}/x.log", "is given for two outputs, -o and --log-file"),
        ("filter {0} -o {1}/out/ --manifest {1}/x.log --log-file {1}/x.log", "two outputs, --manifest and --log-file"),
        ("filter {0} -o {1}/out/ --csv {1}/m.csv --manifest {1}/m.csv", "two outputs, --csv and --manifest"),
        ("filter {0} -o {1}/out/ --manifest {1}/out/a.mcap", "two outputs, -o and --manifest"),
        ("filter {1}/a.mcap -o {1}/out/ --manifest {1}/a.mcap --force", "is part of the input, LOGS"),
        ("filter {1}/a.mcap -o {1}/out/ --log-file {1}/a.mcap", "is not a log file"),
        ("filter {1}/empty.mcap -o {1}/out/ --log-file {1}/empty.mcap", "is part of the input, LOGS"),
        ("evaluate {0} --labels {1}/l.csv --log-file {1}/l.csv", "is not a log file"),
        ("calibrate {1}/frames -o {1}/c.yaml --log-file {1}/frames/x.log", "is part of the input, LOGS"),
    ],
)
def test_files_about_a_run_are_no_input_and_no_other_output(logs, tmp_path, line, text):
    (tmp_path / "a.mcap").write_bytes((logs / "b.mcap").read_bytes())
    (tmp_path / "empty.mcap").touch()
    (tmp_path / "l.csv").write_text("frame,track_id,class,x,y,z,length,width,height,yaw\n")
    (tmp_path / "frames").mkdir()
    (tmp_path / "frames" / "0.bin").write_bytes(bytes(16))
    result = execute(*line.format(logs, tmp_path).split())
    assert result.exit_code in (1, 2)
    assert text in result.stderr
    assert (tmp_path / "a.mcap").read_bytes() == (logs / "b.mcap").read_bytes()
    assert not (tmp_path / "out").exists()


def test_a_log_file_may_be_beside_the_outputs(logs, tmp_path):
    line = ["filter", str(logs / "b.mcap"), "-o", f"{tmp_path / 'out'}/", "--log-file", str(tmp_path / "out" / "x.log")]
    execute(*line, code=0)
    execute(*line, "--force", code=0)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["b.mcap", "x.log"]
