"""`seaclutter evaluate` on logs that are filtered already, or cannot be read."""

import csv
import json
import re
import shutil

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from tests.paths import ROOT
from tests.running import execute as run

SEA, LABELS = (ROOT / "samples" / name for name in ("sea.mcap", "sea.labels.csv"))


def figures(*arguments):
    result = run("evaluate", *arguments, "--json")
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)


def counts(scores):
    return {name: value for name, value in scores.items() if name != "filter_ms"}


def filtered(path, *options, log=SEA):
    result = run("filter", log, "-o", path, "-n", 20, *options)
    assert result.exit_code == 0, result.stderr
    return path


@pytest.fixture(scope="module")
def raw():
    """Return the scores of the raw sample in its first 20 frames."""
    return figures(SEA, "--labels", LABELS, "-n", 20, "-m", "joint", "-m", "none")["methods"]


def test_the_ideal_method_keeps_exactly_the_targets(raw):
    assert list(raw) == ["joint", "none", "ideal"]
    assert (raw["ideal"]["target_loss"], raw["ideal"]["clutter_removal"]) == (0, 1)
    assert raw["ideal"]["filter_ms"] == {"median": None, "p99": None}
    assert "ideal" not in figures(SEA, "--labels", LABELS, "-n", 2, "-m", "joint")["methods"]


@pytest.mark.parametrize(
    ("name", "options", "topic"),
    [
        ("removed.mcap", ["--with-removed"], ()),
        ("removed.bag", ["--with-removed"], ()),
        ("organized.mcap", ["--with-removed", "--keep-organized", "--no-diagnostics"], ()),
        ("raw.mcap", ["--with-removed", "--keep-raw"], ("-t", "/points/filtered")),
    ],
)
def test_a_filtered_log_counts_what_was_removed_from_it(tmp_path, raw, name, options, topic):
    log = filtered(tmp_path / name, *options)
    found = figures(log, "--labels", LABELS, "-m", "none", *topic)["methods"]
    assert counts(found["none"]) == counts(raw["joint"])
    assert counts(found["ideal"]) == counts(raw["ideal"])


def test_a_log_with_raw_clouds_is_evaluated_on_them(tmp_path, raw):
    log = filtered(tmp_path / "raw.mcap", "--with-removed", "--keep-raw")
    assert counts(figures(log, "--labels", LABELS, "-m", "none")["methods"]["none"]) == counts(raw["none"])
    assert "-t /points/filtered" in run("evaluate", log, "--labels", LABELS, "-n", 1).stderr


def test_a_second_filter_is_charged_with_what_the_first_removed(tmp_path, raw):
    log = filtered(tmp_path / "removed.mcap", "--with-removed")
    result = run("evaluate", log, "--labels", LABELS, "-m", "sor", "--json")
    assert "only filters the remaining points; what the earlier one" in result.stderr
    found = json.loads(result.stdout)["methods"]["sor"]
    assert found["target_points_in"] == raw["joint"]["target_points_in"]
    assert found["target_points_out"] < raw["joint"]["target_points_out"]


def test_a_filtered_log_without_the_removed_points_is_refused(tmp_path):
    log = filtered(tmp_path / "a.mcap")
    for method in ("none", "joint"):
        result = run("evaluate", log, "--labels", LABELS, "-m", method)
        assert (result.exit_code, result.stdout) == (1, "")
        assert "already filtered by joint, without the removed points, so missed targets cannot be" in result.stderr
    assert "threshold" not in run("filter", log, "-o", tmp_path / "b.mcap").stderr
    assert run("report", log, "-m", "none", "-o", tmp_path / "r.html").exit_code == 0, "without labels"


@pytest.mark.parametrize(("first", "second"), [((), ("--with-removed",)), (("--with-removed",), ("-t", "/points"))])
def test_a_log_with_the_removed_points_of_one_of_two_runs_is_refused(tmp_path, first, second):
    log = filtered(tmp_path / "b.mcap", "-m", "global_intensity", *second, log=filtered(tmp_path / "a.mcap", *first))
    result = run("evaluate", log, "-t", "/points", "--labels", LABELS, "-m", "none")
    assert (result.exit_code, "already filtered by joint, global_intensity" in result.stderr) == (1, True)


def test_a_run_that_removes_nothing_does_not_count(tmp_path, raw):
    unfiltered = filtered(tmp_path / "a.mcap", "-m", "none")
    log = filtered(tmp_path / "b.mcap", "--with-removed", log=unfiltered)
    found = figures(log, "--labels", LABELS, "-m", "none")["methods"]["none"]
    assert counts(found) == counts(raw["joint"])
    assert run("suspects", unfiltered, "-m", "joint").exit_code == 0


def test_labels_by_the_order_of_points_do_not_fit_a_filtered_log(tmp_path):
    log = filtered(tmp_path / "a.mcap", "--with-removed")
    (tmp_path / "labels").mkdir()
    (tmp_path / "labels" / "000000.label").write_bytes(b"")
    result = run("evaluate", log, "--labels", tmp_path / "labels")
    assert result.exit_code == 1
    assert "changes the order of the points" in result.stderr


def test_frames_without_their_removed_points_are_damage(tmp_path):
    log = filtered(tmp_path / "a.mcap", "--with-removed")
    with log.open("rb") as stream, (tmp_path / "b.mcap").open("wb") as out:
        writer = Writer(out)
        writer.start()
        reader, ids, dropped = make_reader(stream), {}, 0
        for metadata in reader.iter_metadata():
            writer.add_metadata(metadata.name, metadata.metadata)
        for schema, channel, message in reader.iter_messages():
            if channel.topic == "/points/removed" and (dropped := dropped + 1) in (3, 20):
                continue
            if channel.id not in ids:
                known = writer.register_schema(schema.name, schema.encoding, schema.data)
                ids[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, known)
            writer.add_message(ids[channel.id], message.log_time, message.data, message.publish_time)
        writer.finish()
    result = run("evaluate", tmp_path / "b.mcap", "--labels", LABELS, "-m", "none", "--json")
    assert result.exit_code == 3
    assert json.loads(result.stdout)["methods"]["none"]["frames"] == 18
    assert "frame 2 of /points is not a valid cloud (the points removed from it are missing)" in result.stderr


@pytest.fixture
def nested(tmp_path):
    """Return a folder with logs in two inner folders, two labelled ones of the same name, and one without labels."""
    for day, name in (("1", "sea"), ("2", "sea"), ("2", "other")):
        folder = tmp_path / "trial" / f"day{day}"
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copy(SEA, folder / f"{name}.mcap")
    for day in ("1", "2"):
        shutil.copy(LABELS, tmp_path / "trial" / f"day{day}" / "sea.labels.csv")
    return tmp_path / "trial"


def test_labels_beside_nested_logs_and_recordings_without(nested, tmp_path):
    files = "--manifest", tmp_path / "runs.csv", "--summary", tmp_path / "all.json"
    options = "-n", 3, "-m", "joint", "-m", "none", "-j", 1
    result = run("evaluate", nested, "--recursive", "--labels", nested, *options, *files)
    assert result.exit_code == 0, result.stderr
    assert "1 recording of 3 skipped, without labels: other" in result.stderr
    assert result.stdout.startswith("2 of 3 recordings, 1 skipped; 6 labelled frames")
    assert len(re.findall(r"^sea +(?:joint|none|ideal) +3 ", result.stdout, re.MULTILINE)) == 6
    with (tmp_path / "runs.csv").open() as stream:
        rows = [(row["recording"], row["method"], row["status"]) for row in csv.DictReader(stream)]
    each = [("sea", name, "done") for name in ("joint", "none", "ideal")]
    assert sorted(rows) == sorted([*each, *each, ("other", "", "skipped")])
    recordings = json.loads((tmp_path / "all.json").read_text())["recordings"]
    assert {(one["recording"], one["status"], one["reason"], len(one["methods"])) for one in recordings} == {
        ("sea", "done", "", 3),
        ("other", "skipped", "no labels", 0),
    }
    alike = run("tune", nested, "--recursive", "--labels", nested, "-m", "none", "-m", "ror", "-n", "2")
    assert (alike.exit_code, "skipped, without labels: other" in alike.stderr) == (0, True)


def test_labels_of_all_recordings_are_missing(nested):
    for labels in nested.rglob("*.csv"):
        labels.unlink()
    result = run("evaluate", nested, "--recursive", "--labels", nested)
    assert result.exit_code == 2
    assert "labels of all recordings are missing: sea.labels.csv" in result.stderr


def test_a_report_has_the_scores_of_each_recording(nested, tmp_path):
    logs = [nested / "day1" / "sea.mcap", nested / "day2" / "sea.mcap"]
    options = "--labels", nested, "-m", "joint", "-m", "none", "-n", 2
    assert run("report", *logs, *options, "-o", tmp_path / "r.html").exit_code == 0
    page = (tmp_path / "r.html").read_text()
    data = json.loads(page.partition('id="data">')[2].partition("</script>")[0])
    names = [[method["name"] for method in one["methods"]] for one in data["by_recording"]]
    assert names == [["joint", "none", "ideal"]] * 2


def test_of_many_recordings_the_worst_are_shown(nested, monkeypatch):
    monkeypatch.setattr("seaclutter_cli.runs.evaluate._MAX_ROWS", 2)
    options = "--labels", nested, "--recursive", "-n", 1, "-m", "joint", "-m", "sor", "-j", 1
    text = run("evaluate", nested, *options).stdout
    assert "worst of 2 recordings; all with -v, --manifest or --summary" in text
    assert len(re.findall(r"^sea +joint ", text, re.MULTILINE)) == 1
    assert len(re.findall(r"^sea +joint ", run("evaluate", nested, *options, "-v").stdout, re.MULTILINE)) == 3


def test_the_title_says_how_many_recordings_were_read(tmp_path):
    (tmp_path / "broken.mcap").write_text("broken")
    labels = str(ROOT / "samples" / "sea.labels.csv")
    logs = [str(ROOT / "samples" / "sea.mcap"), str(tmp_path / "broken.mcap")]
    result = run("evaluate", *logs, "--labels", labels, "--labels", labels, "-n", 2)
    assert result.stdout.startswith("1 of 2 recordings; 2 labelled frames")
