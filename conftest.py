"""Surroundings of the examples in docstrings: the samples at hand, and a folder for what they write."""

from pathlib import Path

import pytest
from _pytest.doctest import DoctestItem


@pytest.fixture(autouse=True)
def _surroundings(request, doctest_namespace, monkeypatch, tmp_path_factory):
    if isinstance(request.node, DoctestItem):
        monkeypatch.chdir(Path(__file__).parent)
        doctest_namespace["folder"] = tmp_path_factory.mktemp("example")
