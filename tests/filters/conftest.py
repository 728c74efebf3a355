"""Fixtures for the tests of all filters."""

import pytest

from seaclutter_cli.filters import FILTERS
from tests.filters.reference import REFERENCES


@pytest.fixture(params=["program", "reference"])
def make(request):
    """Return a function that makes a filter of the program or of the reference from a name and params."""

    def made(name, **params):
        method = FILTERS[name]
        params = method.Params(**params)
        return method(params) if request.param == "program" else REFERENCES[name](params)

    return made
