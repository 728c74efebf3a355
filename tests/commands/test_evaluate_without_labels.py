"""`seaclutter evaluate --without-labels`: indications, and what they say about methods of known quality."""

import json
from contextlib import closing

import pytest
from click.testing import CliRunner

from seaclutter_cli.commands import cli
from seaclutter_cli.config import load_config
from seaclutter_cli.runs.objects import mounting_of, recorded_configs
from seaclutter_cli.sources.formats import open_source
from tests.paths import ROOT

SEA, LABELS = (ROOT / "samples" / name for name in ("sea.mcap", "sea.labels.csv"))
METHODS = ("-m", "joint", "-m", "ror", "-m", "none", "-n", 30)


def run(*arguments):
    return CliRunner().invoke(cli, ["evaluate", *(str(argument) for argument in arguments)])


@pytest.fixture(scope="module")
def found():
    result = run(SEA, "--without-labels", *METHODS, "--json")
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)


def test_indications_order_methods_as_labels_do(found):
    true = json.loads(run(SEA, "--labels", LABELS, *METHODS, "--json").stdout)["methods"]
    indicated = found["indications"]
    assert list(indicated) == ["joint", "ror", "none"]
    for method, one in indicated.items():
        assert one["doubtful_per_frame"] == pytest.approx(true[method]["false_alarms_per_frame"], rel=0.3, abs=0.3)
    for guess, score in ("f1", "f1"), ("water_kept", "R_c"), ("doubtful_per_frame", "false_alarms_per_frame"):
        order = [
            sorted(indicated, key=lambda name: scores[name][key]) for scores, key in ((indicated, guess), (true, score))
        ]
        assert order[0] == order[1], guess


def test_what_the_indications_count(found):
    joint, _, none = found["indications"].values()
    assert none["targets_lost"] == none["changes_per_minute"] == 0
    assert none["water_kept"] == 1
    assert none["score_of_removed"] is None
    assert joint["score_of_kept"] > none["score_of_kept"] > joint["score_of_removed"]
    assert joint["targets_lost"] > 0 < joint["changes_per_minute"]
    assert joint["agreement"] < none["agreement"] < 1, "ror keeps most of what none keeps"
    table = joint["water_kept_by_height_and_range"]
    assert [len(row) for row in table] == [4, 4, 4][: len(table)]
    assert table[1][0] < 0.05


def test_several_recordings_and_the_text(tmp_path):
    (tmp_path / "a.mcap").write_bytes(SEA.read_bytes())
    text = run(SEA, tmp_path / "a.mcap", "--without-labels", "-n", 3, "-m", "joint", "-j", 1).stdout
    assert text.startswith("6 frames without labels\n\nmethod  targets lost  ")
    assert "Indications, not rates" in text
    assert all(len(line) <= 80 for line in text.splitlines())


@pytest.mark.parametrize("arguments", [(), ("--labels", LABELS, "--without-labels")])
def test_labels_or_none(arguments):
    result = run(SEA, *arguments)
    assert result.exit_code == 2
    assert "--without-labels" in result.stderr


def test_filtered_logs_need_the_points_that_were_removed(tmp_path):
    log = tmp_path / "a.mcap"
    filtered = CliRunner().invoke(cli, ["filter", str(SEA), "-o", str(log), "-n", "2", "-m", "joint"])
    assert filtered.exit_code == 0, filtered.stderr
    result = run(log, "--without-labels", "-m", "none")
    assert result.exit_code == 1
    assert "already filtered by joint, without the removed points" in result.stderr


def test_the_mounting_is_that_of_any_method_or_of_an_earlier_run(tmp_path):
    log = tmp_path / "a.mcap"
    given = ["-m", "confirmed", "-s", "filter.mounting_roll_deg=5", "--with-removed"]
    assert CliRunner().invoke(cli, ["filter", str(SEA), "-o", str(log), "-n", "3", *given]).exit_code == 0
    joint = load_config(None, method="joint")
    with closing(open_source(log)) as source:
        assert mounting_of(joint, *recorded_configs(source)).roll_deg == 5
    with closing(open_source(SEA)) as source:
        assert recorded_configs(source) == []
    assert mounting_of(joint, load_config(method="confirmed", overrides=["filter.mounting_roll_deg=7"])).roll_deg == 7
