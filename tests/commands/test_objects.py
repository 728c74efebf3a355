"""``seaclutter objects``."""

import csv
import json

import pytest
from click.testing import CliRunner

import seaclutter
from seaclutter_cli.commands import cli
from seaclutter_cli.sinks.objects import COLUMNS
from tests.paths import ROOT

SEA = ROOT / "samples" / "sea.mcap"


def run(*words, code=0):
    result = CliRunner().invoke(cli, [str(word) for word in words])
    assert result.exit_code == code, result.output
    return result


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    path = tmp_path_factory.mktemp("objects") / "objects.csv"
    assert "2 objects" in run("objects", SEA, "-o", path).stdout
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_table_has_both_targets_in_all_frames(table):
    assert tuple(table[0]) == tuple(COLUMNS)
    seen = {(row["track_id"], row["frame"]) for row in table if row["state"] == "confirmed"}
    assert len(seen) == 120
    assert len({track for track, _ in seen}) == 2
    assert {row["velocity"] for row in table} == {"own_ship"}


def test_python_returns_the_same_table(table):
    found = seaclutter.find_objects(SEA).table()
    assert found.dtype.names == tuple(COLUMNS)
    assert found["x_m"].tolist() == [float(row["x_m"]) for row in table]
    assert found["frame"].tolist() == [int(row["frame"]) for row in table]


def test_the_method_is_that_of_the_options():
    tracks = json.loads(run("objects", SEA, "-m", "joint", "-n", 30, "--json").stdout)["recordings"][0]["tracks"]
    assert len(tracks) == 2
