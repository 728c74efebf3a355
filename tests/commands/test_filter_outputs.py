"""Names and folders of filtered logs."""

import shutil
from contextlib import closing

import pytest

from seaclutter_cli.records import Message
from seaclutter_cli.sinks.formats import OUTPUT_FORMATS
from seaclutter_cli.sinks.options import FORMAT
from seaclutter_cli.sources.formats import open_source
from tests.paths import SAMPLE
from tests.running import execute


def run(*arguments):
    return execute("filter", *arguments, "-n", "1", "-m", "none")


@pytest.mark.parametrize("name", ["out.pcap", "out.PCAPNG", "out.npy", "out.ply", "out.csv", "out.bin"])
def test_a_name_of_a_format_that_is_only_read_is_refused(tmp_path, name):
    result = run(SAMPLE, "-o", tmp_path / name)
    assert result.exit_code == 2
    assert "this format can only be read; choose a name such as out.mcap" in result.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["out.bag", "out.BAG", "out.pcd", "out.las", "out.laz", "out.npz"])
def test_the_name_selects_the_format(tmp_path, name):
    assert run(SAMPLE, "-o", tmp_path / name).exit_code == 0
    assert [path.name for path in tmp_path.iterdir()] == [name]
    with closing(open_source(tmp_path / name)) as source:
        is_bag = name.lower().endswith("bag")
        assert source.format == ("ROS 1 bag" if is_bag else f"{name[-3:].upper()} file")
        messages = [record for record in source.records() if isinstance(record, Message)]
        assert len(messages) == 1 + is_bag  # with the diagnostics


@pytest.mark.parametrize(
    ("name", "to", "problem"),
    [
        ("out.DB3", None, "a ROS 2 recording is a folder; use -o out --to rosbag2-db3"),
        ("out.bag", "mcap", "has the suffix of other files than --to mcap"),
        ("out.mcap", "pcd", "has the suffix of other files than --to pcd"),
        ("out.pcd", "las", "has the suffix of other files than --to las"),
    ],
)
def test_a_name_of_another_format_is_refused(tmp_path, name, to, problem):
    result = run(SAMPLE, "-o", tmp_path / name, *(["--to", to] if to else []))
    assert result.exit_code == 2
    assert problem in result.stderr
    assert not list(tmp_path.iterdir())


def test_the_formats_of_the_option_are_those_of_the_registry():
    assert tuple(OUTPUT_FORMATS) == FORMAT.names


@pytest.mark.parametrize("name", ["out.xyz", "out.e57", "out.mcap.old", "out.Txt"])
def test_a_suffix_of_no_format_is_refused(tmp_path, name):
    result = run(SAMPLE, "-o", tmp_path / name)
    assert result.exit_code == 2
    suffix = name[name.rindex(".") :]
    advice = (
        f"no format has the suffix {suffix}; use .mcap, .bag, .pcd, .las, .laz or .npz, or name the format with --to"
    )
    assert advice in result.stderr
    assert not list(tmp_path.iterdir())
    assert run(SAMPLE, "-o", tmp_path / name, "--to", "mcap").exit_code == 0
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize("name", ["out.mcap", "out.MCAP", "out", "out.v2", "out.2"])
def test_other_names_are_taken_as_they_are(tmp_path, name):
    assert run(SAMPLE, "-o", tmp_path / name).exit_code == 0
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_a_missing_folder_is_created_but_not_its_parents(tmp_path):
    assert run(SAMPLE, "-o", f"{tmp_path}/new/").exit_code == 0
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["snow.mcap"]
    result = run(SAMPLE, "-o", tmp_path / "nas" / "trial" / "out.mcap")
    assert result.exit_code == 2
    assert f"there is no folder {tmp_path / 'nas'}; create it first" in result.stderr
    assert not (tmp_path / "nas").exists()


def test_folders_of_a_search_are_those_of_its_outputs(tmp_path):
    for name in ("a.mcap", "day1/run.mcap", "day2/deep/run.mcap"):
        (tmp_path / "logs" / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(SAMPLE, tmp_path / "logs" / name)
    assert run(tmp_path / "logs", "-o", tmp_path / "out", "--recursive").exit_code == 0
    files = sorted(path.relative_to(tmp_path / "out").as_posix() for path in (tmp_path / "out").rglob("*.mcap"))
    assert files == ["a.mcap", "day1/run.mcap", "day2/deep/run.mcap"]
    result = run(tmp_path / "logs", "-o", tmp_path / "no" / "such", "--recursive")
    assert (result.exit_code, (tmp_path / "no").exists()) == (2, False)
