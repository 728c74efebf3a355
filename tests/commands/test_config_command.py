"""Tests of ``seaclutter config``: shown configurations can be read again."""

import json
from functools import partial

import pytest

from seaclutter_cli.config import load_config
from seaclutter_cli.filters import FILTERS
from tests.running import execute

invoke = partial(execute, "config")


@pytest.mark.parametrize("method", FILTERS)
def test_a_shown_configuration_is_valid(tmp_path, method):
    file = tmp_path / "shown.yaml"
    file.write_text(invoke("show", "-m", method).stdout)
    assert load_config(file) == load_config(method=method)
    invoke("check", file, code=0)
    assert json.loads(invoke("show", "-m", method, "--json").stdout) == load_config(method=method).as_dict()


def test_check_reports_every_file(tmp_path):
    (tmp_path / "good.yaml").write_text("filter: {far: drop}\n")
    (tmp_path / "bad.yaml").write_text("filter: {colour: red}\n")
    (tmp_path / "worse.yaml").write_text("filter: [")
    result = invoke("check", *(tmp_path / f"{name}.yaml" for name in ("bad", "good", "worse")), code=2)
    assert "good.yaml: valid, method joint" in result.stdout
    assert "colour" in result.stderr
    assert "worse.yaml: line 1, column 10: not valid YAML" in result.stderr
