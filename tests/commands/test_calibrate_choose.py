"""`calibrate --choose` and `--trade-off`: held-out frames, the stated rule, and what is written."""

import json

import numpy as np
import pytest

from seaclutter_cli.config import load_config
from seaclutter_cli.evaluation.scores import Summary
from seaclutter_cli.runs.calibrate import candidates, training_frames
from seaclutter_cli.runs.calibrate_result import Candidate, TradeOff
from tests.commands.test_filter import POINT, write_log
from tests.paths import ROOT
from tests.running import execute

SEA, LABELS = ROOT / "samples" / "sea.mcap", ROOT / "samples" / "sea.labels.csv"


def calibrate(out, *arguments):
    line = ["calibrate", *map(str, arguments), "-o", str(out), "--force"]
    return execute(*line)


def data(out, *arguments):
    result = calibrate(out, *arguments, "--json")
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def errors(config):
    line = ["evaluate", str(SEA), "--labels", str(LABELS), "--json", "-m", "joint"]
    found = json.loads(execute(*line, *(["-c", str(config)] if config else [])).stdout)
    return sum(found["methods"]["joint"][key] for key in ("N_FP", "N_FN"))


@pytest.fixture(scope="module")
def chosen(tmp_path_factory):
    out = tmp_path_factory.mktemp("chosen") / "c.yaml"
    return data(out, SEA, "--labels", LABELS, "--choose"), out


def test_the_sample_gets_better_than_with_the_defaults(chosen, tmp_path):
    """A single rate of 0.8 made it worse."""
    _, out = chosen
    data(tmp_path / "single.yaml", SEA, "--labels", LABELS)
    assert errors(out) < errors(None) < errors(tmp_path / "single.yaml")


def test_the_best_by_the_rule_is_used(chosen):
    found, out = chosen
    rows = found["trade_off"]["candidates"]
    keys = [(row["N_FP"] + row["N_FN"], row["false_alarms"] + row["omitted_alarms"]) for row in rows]
    first = keys.index(min(keys))
    assert [row["best"] for row in rows] == [row["used"] for row in rows] == [n == first for n in range(len(rows))]
    assert (found["filter_rate"], found["max_left"]) == (rows[first]["filter_rate"], rows[first]["max_left"])
    assert {row["frames"] for row in rows} == {60}
    ring = found["rings"][0]
    assert ring["points"] - ring["below"] <= found["max_left"] * 60
    text = " ".join(out.read_text(encoding="utf-8").replace("# ", "").split())
    assert f"filter rate of 0.8 and at most {found['max_left']:g} clutter points per frame left in a range ring" in text


def test_the_trade_off_changes_nothing(tmp_path):
    shown = calibrate(tmp_path / "shown.yaml", SEA, "--labels", LABELS, "--trade-off", "-n", 20)
    assert calibrate(tmp_path / "plain.yaml", SEA, "--labels", LABELS, "-n", 20).exit_code == 0
    assert (tmp_path / "shown.yaml").read_bytes() == (tmp_path / "plain.yaml").read_bytes()
    assert "On 20 labelled frames, each half with thresholds from the other:" in shown.stdout
    rows = [line.split() for line in shown.stdout.splitlines() if line.startswith("0.")]
    assert [row[-1] for row in rows if "used" in row] == ["used"]
    assert [row[-1] for row in rows if "<" in row] == ["<"]
    assert all(len(line) <= 80 for line in shown.stdout.splitlines()[1:])


@pytest.mark.parametrize("option", ["--choose", "--trade-off"])
def test_labels_are_needed(tmp_path, option):
    result = calibrate(tmp_path / "c.yaml", SEA, option)
    assert (result.exit_code, f"{option}: filter rates are compared by --labels" in result.stderr) == (2, True)


def test_few_labelled_frames_are_refused(tmp_path):
    result = calibrate(tmp_path / "c.yaml", SEA, "--labels", LABELS, "--choose", "-n", "19")
    assert (result.exit_code, "19 labelled frames: too few" in result.stderr) == (1, True)
    assert not (tmp_path / "c.yaml").exists()


def test_thresholds_come_from_other_frames_than_those_judged(tmp_path):
    """In the first half, clutter is 100 times as bright: its thresholds remove all clutter of the second half."""

    def make(number):
        rng = np.random.default_rng(number)
        cloud = np.zeros(400, POINT)
        cloud["x"], cloud["y"] = rng.uniform(12, 20, 400), rng.uniform(-8, 8, 400)
        cloud["intensity"] = np.floor(rng.exponential(1000 if number < 20 else 10, 400))
        return cloud

    log = write_log(tmp_path / "log.mcap", frames=40, make=make)
    head = "frame,track_id,class,x,y,z,length,width,height,yaw\n"
    (tmp_path / "l.csv").write_text(head + "".join(f"{number},,none,,,,,,,\n" for number in range(40)))
    found = data(tmp_path / "c.yaml", log, "--labels", tmp_path / "l.csv", "--trade-off", "-m", "ring_intensity")
    for row in found["trade_off"]["candidates"]:
        assert row["N_FP"] == 20, "the dark half is without alarms, the bright half never"


def test_halves_and_their_training_frames_are_apart():
    for frames in range(5, 200):
        first, last = training_frames(frames)
        assert len(first) == len(last) >= 0.4 * frames - 1
        assert first.stop <= 0.48 * frames
        assert last.start >= 0.52 * frames


def test_in_a_tie_the_first_candidate_is_best():
    scores = {one: Summary(frames=10, n_fp=1, false_alarms=1) for one in candidates(Candidate(0.8))}
    assert TradeOff(scores, Candidate(0.8)).best == Candidate(0.5)
    scores[Candidate(0.8, 5.0)] = Summary(frames=10)
    assert TradeOff(scores, Candidate(0.8)).best == Candidate(0.8, 5.0)


def test_a_limit_without_labels(tmp_path):
    found = data(tmp_path / "c.yaml", SEA, "--max-left", "3")
    ring = found["rings"][1]
    assert ring["points"] - ring["below"] <= 180
    assert ring["filter_rate"] > 0.98
    assert load_config(tmp_path / "c.yaml").filter.initial_thresholds[1] == ring["threshold"]
