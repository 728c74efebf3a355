"""Simulations with several seeds."""

import json
from functools import partial

import pytest

from seaclutter_cli.errors import UsageError
from seaclutter_cli.runs.options.logs import parse_seeds
from tests.running import execute

invoke = partial(execute, "simulate")


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_each_seed_gives_what_it_gives_alone(tmp_path):
    alone = tmp_path / "alone"
    alone.mkdir()
    for seed in (2, 3, 9):
        invoke("calm", "-n", 2, "--seed", seed, "-o", alone / f"calm_{seed}.mcap", code=0)
    for jobs in (1, 2):
        folder = tmp_path / str(jobs)
        result = invoke("calm", "-n", 2, "--seeds", "2..3,9", "-o", f"{folder}/", "-j", jobs, "--json", code=0)
        assert [row["seed"] for row in json.loads(result.stdout)] == [2, 3, 9]
        assert contents(folder) == contents(alone)


def test_a_total_and_a_line_for_each(tmp_path):
    result = invoke("calm", "-n", 1, "--seeds", "1-2", "-o", tmp_path, "-j", 1)
    assert result.stdout == "2 done\n"
    assert [line.split(": ")[0] for line in result.stderr.splitlines()] == ["calm_1", "calm_2"]
    assert result.stderr.splitlines()[0].endswith(f" s -> {tmp_path / 'calm_1.mcap'}")
    again = invoke("calm", "-n", 1, "--seeds", "2..4", "-o", tmp_path, code=2)
    assert "calm_2.mcap: already exists" in again.stderr


def test_captures(tmp_path):
    invoke("calm", "-n", 1, "--seeds", "1,2", "--format", "pcap", "-o", tmp_path, code=0)
    assert sorted(contents(tmp_path)) == ["calm_1.labels.csv", "calm_1.pcap", "calm_2.labels.csv", "calm_2.pcap"]


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (("--seeds", "1,2", "--seed", 3, "-o", "out"), "give one of them"),
        (("--seeds", "1,2", "--scene-file", "s.yaml", "-o", "out"), "is for a single recording"),
        (("--seeds", "5..1", "-o", "out"), "write numbers and ranges"),
        (("--seeds", "", "-o", "out"), "write numbers and ranges"),
        (("-o", "out/"), "names a folder by the slash"),
        (("--seeds", "1", "-o", "s3://trial/out"), "takes a local path"),
    ],
)
def test_wrong_options(tmp_path, monkeypatch, options, text):
    monkeypatch.chdir(tmp_path)
    result = invoke("calm", *options, code=2)
    assert text in result.stderr
    assert not contents(tmp_path)


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "out").write_text("important")
    assert "needs a folder" in invoke("calm", "--seeds", "1", "-o", tmp_path / "out").stderr


@pytest.mark.parametrize("text", ["1..100001", "1..5000000000", "a", "1,,2", "-1", "1.5"])
def test_what_is_no_list_of_seeds(text):
    with pytest.raises(UsageError, match="write numbers and ranges"):
        parse_seeds(text)
