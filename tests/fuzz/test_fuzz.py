"""A short campaign over all formats, the same in every run, and tests that a campaign finds what it should find."""

import fnmatch
import random

import pytest
from mcap.opcode import Opcode

from seaclutter_cli.runs import filter as filter_run
from seaclutter_cli.sinks.log import LogSink
from seaclutter_cli.sources.mcap.source import McapSource
from tests.fuzz import layers, mutate
from tests.fuzz.campaign import Tally, campaign, check_limits, table
from tests.fuzz.formats import FORMATS
from tests.fuzz.run import Outcome, Recipe, check_honest, honest, make, run
from tests.logs import records_of
from tests.pairs import turns

INPUTS = 9


@turns(3)
@pytest.mark.parametrize("name", FORMATS)
def test_mutated_inputs_end_as_they_should(name, turn):
    check_honest(name)
    for number in range(turn * INPUTS, (turn + 1) * INPUTS):
        outcome = run(Recipe(name, 0, number))
        assert not outcome.problems, f"{outcome.recipe}: {outcome.problems}\n{outcome.traceback}"


def filtered():
    """Return the outcome of a run of ``filter`` on an honest log."""
    return run(Recipe("mcap zstd", 0, -1))


def test_the_honest_run_has_no_problems():
    outcome = filtered()
    assert (outcome.code, outcome.problems) == (0, [])


def test_a_traceback_is_found(monkeypatch):
    monkeypatch.setattr(McapSource, "records", lambda *_: {}["x"])
    assert "KeyError" in filtered().problems[0]


@pytest.mark.parametrize(("code", "problem"), [(0, "is missing"), (2, "exit status 2"), (3, "0 reports of damage")])
def test_a_wrong_exit_status_is_found(monkeypatch, code, problem):
    monkeypatch.setattr(filter_run, "filter_log", lambda *_, **__: (_ for _ in ()).throw(SystemExit(code)))
    assert any(problem in text for text in filtered().problems)


def test_files_left_are_found(monkeypatch):
    def fail(self):
        raise SystemExit(1)

    monkeypatch.setattr(LogSink, "end", fail)
    monkeypatch.setattr("seaclutter_cli.sinks.atomic.AtomicFile.__exit__", lambda *_: None)
    assert filtered().left


def test_an_unreported_loss_is_found(monkeypatch):
    monkeypatch.setattr(McapSource, "_report", lambda *_: None)
    recipes = (Recipe("mcap zstd", 0, 6 * number) for number in range(60))
    found = [problem for recipe in recipes if make(recipe)[2] for problem in run(recipe).problems]
    assert any("frames and points of" in problem for problem in found)


def test_time_and_memory_are_judged():
    outcome = Outcome("x:0:0", 0, 21.0, 301.0)
    check_limits(outcome, "filter")
    assert len(outcome.problems) == 2
    outcome = Outcome("x:0:0", 0, 19.0, 301.0)
    check_limits(outcome, "info")
    assert outcome.problems == []


def test_inputs_depend_on_the_recipe_only():
    for name in ("mcap lz4", "config", "rosbag2 db3", "model skops"):
        assert make(Recipe(name, 3, 5)) == make(Recipe(name, 3, 5))
        assert make(Recipe(name, 3, 5))[0] != make(Recipe(name, 4, 5))[0]


@pytest.mark.parametrize(
    "mutation", dict.fromkeys((*mutate.BYTES, *mutate.TEXT, *mutate.DOCUMENT)), ids=lambda one: one.__name__
)
def test_mutations_change_data_of_any_size(mutation):
    for data in (b"x", b"{}", b"a: [1, {b: 2}]\nc: d\n", bytes(range(256)) * 9):
        found = [mutation(data, random.Random(seed), [b"other"]) for seed in range(40)]
        assert len(set(found)) > (len(data) > 2)


@pytest.mark.parametrize("name", [name for name, form in FORMATS.items() if form.layers])
def test_layers_pack_content_again(name):
    """Content that is not changed is packed so that the program reads it as before."""
    for layer in FORMATS[name].layers:
        files = honest(name)
        file = max(fnmatch.filter(files, FORMATS[name].files))
        changed = []

        def keep(content, changed=changed):
            changed.append(content)
            return content

        assert len(layer(files[file], random.Random(1), keep)) > 100
        assert changed[0]


def test_the_checksum_of_a_chunk_fits():
    data = layers.mcap_chunk(honest("mcap zstd")["log.mcap"], random.Random(1), lambda content: content + bytes(8))
    assert any(piece.op == Opcode.CHUNK for piece in records_of(data))


def test_a_campaign_prints_a_table():
    reported = []
    *_, tallies = campaign(["config", "kitti bin"], 5, 12, 10**9, reported.append)
    assert [tally.codes.total() for tally in tallies.values()] == [6, 6]
    assert reported == []
    lines = table(tallies).splitlines()
    assert lines[0].startswith("| format | inputs | exit 0 | exit 1 | exit 2 | exit 3 | tracebacks |")
    assert lines[-1].startswith("| all | 12 |")


def test_a_worker_that_ends_is_one_outcome():
    tally = Tally()
    tally.add(Outcome("x:0:0", -11, 0.0, None, ["the process ended"], "Fatal Python error"))
    assert tally.row("x")[6:8] == ["1", "0"]
