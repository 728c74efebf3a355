"""YAML and JSON from outside: limits, and one line that says where a text is wrong."""

import re

import pytest
import yaml

from seaclutter_cli import documents
from seaclutter_cli.documents import MAX_DEPTH, DocumentError, load_json, load_yaml
from tests.attacks import JSON_DOCUMENTS, YAML_DOCUMENTS, YAML_VALUES
from tests.pairs import covering
from tests.running import execute

ATTACKS = YAML_DOCUMENTS | {name: f"filter: {{start_m: {value}}}" for name, value in YAML_VALUES.items()}


def refusal(load, text):
    with pytest.raises(DocumentError) as caught:
        load(text)
    return str(caught.value)


@pytest.mark.parametrize("text", [ATTACKS[name] for name in ATTACKS if name != "many keys"], ids=lambda text: text[:20])
@pytest.mark.parametrize("base", ["CSafeLoader", "SafeLoader"])
def test_yaml_is_refused_with_its_place(monkeypatch, text, base):
    """Both loaders of PyYAML agree, also on the place, since some builds lack the fast one."""
    monkeypatch.setattr(documents, "_Base", getattr(yaml, base))
    monkeypatch.setattr(documents, "MAX_YAML_NODES", 10_000)
    message = refusal(load_yaml, text)
    assert "\n" not in message
    assert len(message) < 200
    assert re.match(r"line \d+, column \d+: |more than ", message)


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("a: 1\nb: [*c]", "line 2, column 5"),
        ("a: 1\nb: !!int x", "line 2, column 4"),
        ("a: 1\na: 2", "line 2, column 1"),
        ("a:\n  - b\x07", "line 2, column 6"),
        ("a: [1, 2", "line 1, column 9"),
        ("a: 0x_", "line 1, column 4"),
    ],
)
def test_the_place_of_a_problem(text, place):
    assert refusal(load_yaml, text).startswith(f"{place}: ")


@pytest.mark.parametrize("text", ["2020-99-99", "2020-01-01", "2001-12-14t21:59:43.10-05:00", "<<", "="])
def test_dates_and_merge_keys_are_text(text):
    assert load_yaml(text) == text


def test_values_of_the_core_types():
    text = "{a: [1, -2.5, 0x1F, 1.0e+3, .inf], b: true, c: null, d: 'x', 1: é, e: &name y}"
    content = {"a": [1, -2.5, 31, 1000.0, float("inf")], "b": True, "c": None, "d": "x", 1: "é", "e": "y"}
    assert load_yaml(text) == content
    assert load_yaml("\ufeff# nothing") is None


@pytest.mark.parametrize(("load", "what"), [(load_yaml, "levels"), (load_json, "levels")])
def test_depth(load, what):
    assert load("[" * MAX_DEPTH + "]" * MAX_DEPTH)
    assert f"more than {MAX_DEPTH} {what}" in refusal(load, "[" * (MAX_DEPTH + 1) + "]" * (MAX_DEPTH + 1))


@pytest.mark.parametrize("text", JSON_DOCUMENTS.values(), ids=JSON_DOCUMENTS)
def test_json_is_refused(text):
    message = refusal(load_json, text.encode("utf-8", "surrogateescape"))
    assert "\n" not in message
    assert len(message) < 200


def test_long_json_is_refused():
    assert load_json(b'"xx"', max_bytes=4) == "xx"
    assert "more than 3 bytes" in refusal(lambda text: load_json(text, max_bytes=3), b'"xx"')


FILES = (
    ("config", "check"),
    ("simulate", "-o", "out.mcap"),
    ("classify", "separate", "none.las", "-o", "out.las", "-c"),
)


@pytest.mark.parametrize(("name", "arguments"), covering(ATTACKS, FILES))
def test_a_file_is_refused_with_its_name(tmp_path, monkeypatch, name, arguments):
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "attack.yaml"
    file.write_text(ATTACKS[name])
    result = execute(*arguments, file, code=2)
    assert result.stderr.startswith(f"Error: {file}: ")
    assert len(result.stderr) < 30_000
    assert [path.name for path in tmp_path.iterdir()] == ["attack.yaml"]


SETTINGS = (
    ("config", "show", "-s", "filter.start_m={}"),
    ("config", "show", "-s", "filter.presets.open={}", "-m", "adaptive_radius"),
    ("classify", "separate", "none.las", "-o", "out.las", "-s", "separation.cell_m={}"),
    ("tune", "none.mcap", "--labels", "none.csv", "--sweep", "start_m={}"),
)


@pytest.mark.parametrize(("name", "arguments"), covering(YAML_VALUES, SETTINGS))
def test_a_value_on_the_command_line_is_refused(tmp_path, monkeypatch, name, arguments):
    monkeypatch.chdir(tmp_path)
    result = execute(*(argument.replace("{}", YAML_VALUES[name]) for argument in arguments), code=2)
    assert re.match(r"Error: --(set|sweep) .*line 1, column \d+: ", result.stderr)
    assert result.stderr.count("\n") == 1


def test_a_key_with_many_parts_is_refused():
    result = execute("config", "show", "-s", f"filter{'.a' * 5000}=1", code=2)
    assert "write it as" in result.stderr


def test_a_sweep_of_many_values_is_refused():
    result = execute(
        "tune", "none.mcap", "--labels", "none.csv", "--sweep", "start_m=" + ",".join(map(str, range(20_000))), code=2
    )
    assert "at most 500 values" in result.stderr


def test_a_file_that_does_not_end_is_refused():
    result = execute("config", "check", "/dev/zero", code=2)
    assert result.stderr.startswith("Error: /dev/zero: ")
