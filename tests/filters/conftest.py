"""Fixtures for the tests of all filters."""

import pytest

from seaclutter_cli.filters import FILTERS


@pytest.fixture
def make():
    """Return a function that makes a filter from a name and params; `test_against_reference` is about the reference."""

    def made(name, **params):
        method = FILTERS[name]
        return method(method.Params(**params))

    return made
