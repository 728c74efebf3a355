"""The tasks of ``docs/guide/first_trial.md`` run, print what the page shows, and fit a terminal of 80 columns."""

import os
import re
import shutil
import sys

import pytest

from tests import first_trial
from tests.first_trial import PAGE, without_times

pytestmark = pytest.mark.skipif(os.name != "posix" or not shutil.which("bash"), reason="needs bash")


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    return first_trial.play(tmp_path_factory.mktemp("trial"))


def test_the_exit_statuses_are_those_of_the_page(played):
    assert not played[1], "\n".join(played[1])


@pytest.mark.skipif(sys.platform != "linux", reason="simulated points may differ by rounding")
def test_the_page_shows_what_the_commands_print(played):
    shown = PAGE.read_text(encoding="utf-8")
    assert without_times(played[0]) == without_times(shown), "python -m tests.first_trial updates the page"


def test_the_output_fits_80_columns(played):
    outputs = re.findall(r"\n\n```\n((?:(?!```).*\n)*)```\n", played[0], re.MULTILINE)
    lines = [line for output in outputs for line in output.splitlines()]
    assert len(lines) > 60
    assert not [line for line in lines if len(line) > 80 and not line.startswith(("Warning: ", "Error: "))]


def test_ten_tasks():
    headings = re.findall(r"^## (\d+)\. ", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert headings == [str(number) for number in range(1, 11)]
