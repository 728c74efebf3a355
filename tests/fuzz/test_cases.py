"""Failures that campaigns have found do not return."""

import pytest

from tests.fuzz.cases import CASES
from tests.fuzz.formats import FORMATS
from tests.fuzz.run import Recipe, run_files


@pytest.mark.parametrize("name", CASES)
def test_a_failure_that_was_found_once(name):
    build, code, words = CASES[name]
    files, command = build()
    form = next(form for form in FORMATS if command in FORMATS[form].commands)
    outcome = run_files(Recipe(form, 0, 0), files, command, False)
    assert (outcome.code, outcome.problems) == (code, []), outcome.text
    assert words in outcome.text
