"""The JSON output of each command matches its schema in the documentation, which names all of its keys."""

import json
import re
import shlex

import click
import pytest
from jsonschema import Draft202012Validator
from referencing import Registry, Resource

from seaclutter_cli.commands import cli
from tests.paths import ROOT
from tests.running import execute
from tests.scenes.walls import write_toys

FOLDER = ROOT / "docs" / "schemas"
SCHEMAS = {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in sorted(FOLDER.glob("*.json"))}
SEA = f"{ROOT}/samples/sea.mcap"
LABELS = f"--labels {ROOT}/samples/sea.labels.csv"
COMMANDS = [
    f"info {SEA} cut.mcap bad.mcap",
    f"info {ROOT}/samples/rs-lidar-32.pcap",
    f"filter {SEA} cut.mcap bad.mcap -o out/ -n 3",
    f"filter {SEA} -o out/confirmed.mcap -m confirmed -n 9",
    f"filter {SEA} -o out/sor.mcap -m sor -n 2",
    f"filter {SEA} cut.mcap -o out2/ --dry-run",
    f"convert {SEA} cut.mcap bad.mcap -o converted/ --to bag -n 3",
    f"convert {SEA} -o converted.pcd -n 1",
    f"convert {SEA} cut.mcap -o converted2/ --to npz --dry-run",
    f"calibrate {SEA} -o a.yaml",
    f"calibrate {SEA} -o b.yaml {LABELS} --choose -n 20",
    f"calibrate {SEA} -o c.yaml -m confirmed -n 20",
    f"mask {SEA} cut.mcap -o m.csv",
    f"objects {SEA} cut.mcap -o o.csv",
    f"labels propose {SEA} cut.mcap -n 9 -o proposed/",
    f"labels compare {ROOT}/samples/sea.labels.csv {ROOT}/samples/sea.labels.csv",
    f"suspects {SEA} cut.mcap bad.mcap -n 9",
    f"labels check {SEA} {LABELS} -n 9",
    f"labels check {SEA} --labels swapped.csv",
    f"evaluate {SEA} {LABELS} -m joint -m none -n 3",
    f"evaluate bad.mcap {LABELS}",
    f"evaluate {SEA} --without-labels -m joint -m sor -n 9",
    f"evaluate {SEA} --labels empty.csv -n 3",
    f"tune {SEA} {LABELS} --sweep filter.update_weight=0.4,0.6 -n 8",
    f"tune {SEA} {LABELS} -m joint -m sor -n 4",
    f"report {SEA} {LABELS} -n 3 -o a.html",
    "simulate calm -n 1 -o a.mcap",
    "simulate small -o a.laz",
    "simulate calm -n 1 -o seeds/ --seeds 1,2",
    "scene train toys -o m.onnx --epochs 1 --every 2",
    f"scene evaluate --scene open={SEA}",
    f"scene evaluate --scene confined={SEA}",
    f"scene predict {SEA} bad.mcap",
    f"classify separate {ROOT}/samples/tile.laz -o sea.laz",
    "classify train tile.laz -o m.skops -s forest.trees=5",
    "classify predict tile.laz --model m.skops -o found.laz",
    "config show",
    "config show -c snow",
    "config list",
    "config list sensors",
]
EXTRAS = {"scene": "onnxruntime", "classify": "skops"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with damaged and unreadable logs, wrong labels, and what some commands need."""
    path = tmp_path_factory.mktemp("schemas")
    sample = (ROOT / "samples" / "sea.mcap").read_bytes()
    (path / "cut.mcap").write_bytes(sample[:200_000])
    (path / "bad.mcap").write_bytes(b"not a log")
    head, *rows = (ROOT / "samples" / "sea.labels.csv").read_text(encoding="utf-8").splitlines()
    cells = [row.split(",") for row in rows]
    swapped = [",".join([*row[:3], row[4], row[3], *row[5:]]) for row in cells]
    (path / "swapped.csv").write_text("\n".join((head, *swapped)), encoding="utf-8")
    (path / "empty.csv").write_text(f"{head}\n0,,none,,,,,,,\n", encoding="utf-8")
    (path / "toys").mkdir()
    write_toys(path / "toys", 3)
    return path


@pytest.fixture
def run(folder, monkeypatch):
    monkeypatch.chdir(folder)

    def run(line):
        return execute(*shlex.split(line), "--json", *(["--force"] if " -o " in line else []))

    return run


def strict(schema, *, whole=True):
    """Return a schema that allows only the keys that it names; ``whole`` is false for a part of an object."""
    if isinstance(schema, list):
        return [strict(item, whole=whole) for item in schema]
    if not isinstance(schema, dict):
        return schema
    found = {key: strict(value, whole=key not in ("allOf", "scores")) for key, value in schema.items()}
    described = "allOf" in schema or isinstance(schema.get("properties"), dict)
    return {"unevaluatedProperties": False, **found} if whole and described else found


def validator(name):
    resources = [(f"{key}.json", Resource.from_contents(strict(schema))) for key, schema in SCHEMAS.items()]
    return Draft202012Validator(strict(SCHEMAS[name]), registry=Registry().with_resources(resources))


def name_of(line):
    words = shlex.split(line)
    return words[0] if words[0] in SCHEMAS else "-".join(words[:2])


@pytest.mark.parametrize("line", COMMANDS)
def test_output_matches_its_schema(line, run, folder):
    group = line.split()[0]
    if group in EXTRAS:
        pytest.importorskip(EXTRAS[group])
    if line.startswith("scene train"):
        pytest.importorskip("torch")
    if line.startswith(("classify train", "classify predict")):
        made = {"tile.laz": "simulate small -o tile.laz"}
        made |= {"m.skops": "classify train tile.laz -o m.skops -s forest.trees=5"} if "predict" in line else {}
        assert all((folder / name).exists() or run(before).exit_code == 0 for name, before in made.items())
    result = run(line)
    assert result.stdout, result.stderr
    errors = validator(name_of(line)).iter_errors(json.loads(result.stdout))
    assert not [f"{error.json_path}: {error.message[:200]}" for error in errors]


def commands_with_json(group=cli, words=()):
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        if isinstance(command, click.Group):
            yield from commands_with_json(command, (*words, name))
        elif any("--json" in parameter.opts for parameter in command.params) and name != "sensors":
            yield "-".join((*words, name))


def test_every_command_with_json_has_a_schema_and_a_test():
    expected = set(commands_with_json())
    assert expected == set(SCHEMAS) - {"common"} == set(map(name_of, COMMANDS))


@pytest.mark.parametrize("name", SCHEMAS)
def test_schemas_are_valid_and_documented(name):
    Draft202012Validator.check_schema(SCHEMAS[name])
    assert SCHEMAS[name]["$id"] == f"{name}.json"
    page = (ROOT / "docs" / "guide" / "command-line.md").read_text(encoding="utf-8")
    assert f"(../schemas/{name}.json)" in page


def test_a_key_that_is_not_described_is_found(run):
    found = json.loads(run(f"evaluate {SEA} {LABELS} -n 1 -m none").stdout)
    found["methods"]["none"]["news"] = found["news"] = 1
    errors = list(validator("evaluate").iter_errors(found))
    assert sorted(error.json_path for error in errors) == ["$", "$.methods.none"]
    assert all(re.search("'news' was unexpected", error.message) for error in errors)
