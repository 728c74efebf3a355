"""Environment of the doctests: they run in the repository, with a temporary folder for output."""

from pathlib import Path

import pytest
from _pytest.doctest import DoctestItem


@pytest.fixture(autouse=True)
def _doctest_environment(request, doctest_namespace, monkeypatch, tmp_path_factory):
    if isinstance(request.node, DoctestItem):
        monkeypatch.chdir(Path(__file__).parent)
        doctest_namespace["folder"] = tmp_path_factory.mktemp("example")
