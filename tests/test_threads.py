"""The number of threads that a process may use."""

import os

import pytest

from seaclutter_cli.errors import UsageError
from seaclutter_cli.threads import cores, threads


def test_all_cores_by_default(monkeypatch):
    monkeypatch.delenv("SEACLUTTER_THREADS", raising=False)
    assert threads() == cores() >= 1
    if hasattr(os, "sched_getaffinity"):
        assert cores() == len(os.sched_getaffinity(0))


def test_the_environment_sets_it(monkeypatch):
    monkeypatch.setenv("SEACLUTTER_THREADS", "3")
    assert threads() == 3


@pytest.mark.parametrize("text", ["0", "-1", "", "two", "1.5", "99999", "²"])
def test_other_texts_are_refused(monkeypatch, text):
    monkeypatch.setenv("SEACLUTTER_THREADS", text)
    with pytest.raises(UsageError, match="SEACLUTTER_THREADS: expected a positive whole number"):
        threads()
