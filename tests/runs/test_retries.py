"""What a second attempt at a recording meets, after the process or worker of the first has died."""

import pickle

import pytest

from seaclutter_cli.errors import ClusterError, MissingExtraError, SeaclutterError
from seaclutter_cli.runs.filter import filter_run
from seaclutter_cli.runs.observer import SILENT, Silent
from seaclutter_cli.runs.options.logs import FilterOptions
from tests.logs import cloud_log


@pytest.fixture
def work(tmp_path):
    cloud_log(tmp_path / "a.mcap", frames=3)
    (work,) = filter_run(FilterOptions(tmp_path / "a.mcap", tmp_path / "out.mcap"), SILENT).works
    return work


def test_an_output_that_the_first_attempt_has_completed_is_accepted(work):
    first = work.run(Silent())
    data = work.target.read_bytes()
    second = work.run(Silent())
    assert first.error is second.error is None
    assert second.frames == first.frames == 3
    assert work.target.read_bytes() == data
    assert [path.name for path in work.target.parent.iterdir() if path.name.endswith(".part")] == []


@pytest.mark.parametrize("kind", ["no output", "of another recording"])
def test_any_other_file_is_an_error(work, tmp_path, kind):
    if kind == "no output":
        work.target.write_bytes(b"important")
    else:
        cloud_log(tmp_path / "b.mcap", frames=4)
        (other,) = filter_run(FilterOptions(tmp_path / "b.mcap", work.target), SILENT).works
        assert other.run(Silent()).error is None
    data = work.target.read_bytes()
    assert "out.mcap" in work.run(Silent()).error
    assert work.target.read_bytes() == data


@pytest.mark.parametrize("error", [MissingExtraError("LAZ", "las"), ClusterError("gone"), SeaclutterError("text")])
def test_errors_come_from_other_processes(error):
    copy = pickle.loads(pickle.dumps(error))
    assert type(copy) is type(error)
    assert str(copy) == str(error)
