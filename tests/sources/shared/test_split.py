"""Numbered files that are one recording, and those that are not."""

import itertools

import pytest

from seaclutter_cli.errors import UsageError
from seaclutter_cli.sources.recordings import Search, find_recordings
from seaclutter_cli.sources.shared.split import MAX_GAP_S, MAX_OVERLAP_S
from tests.logs import PERIOD_NS, START_NS, Entry, Topic, cloud_messages, cloud_topic, write_log
from tests.running import execute
from tests.sources.rosbag1.bags import write_bag

SECOND = 10**9


def part(path, start_s, *, frames=40, topic="/points"):
    """Write a file of clouds at 10 Hz."""
    (cloud,) = cloud_messages("ros2", 1, 5)
    times = (START_NS + round(start_s * SECOND) + number * PERIOD_NS for number in range(frames))
    return write_log(path, [cloud_topic(topic)], [Entry(topic, time, cloud) for time in times])


def found(folder, **search):
    lines = []
    recordings = find_recordings([str(folder)], Search(**search), lines.append)
    return [[path.name for path in recording.paths] for recording in recordings], lines


def test_continuous_files_are_one_recording_and_it_is_said(tmp_path):
    for number in range(3):
        part(tmp_path / f"run_{number}.mcap", 4 * number)
    groups, (line,) = found(tmp_path)
    assert groups == [["run_0.mcap", "run_1.mcap", "run_2.mcap"]]
    assert line == f"{tmp_path / 'run_0.mcap'} to run_2.mcap are one recording; --no-join separates them"
    assert found(tmp_path, join=False) == ([["run_0.mcap"], ["run_1.mcap"], ["run_2.mcap"]], [])


@pytest.mark.parametrize(
    ("start_s", "is_one"),
    [(3.9 + MAX_GAP_S, True), (4.1 + MAX_GAP_S, False), (4.0 - MAX_OVERLAP_S, True), (3.8 - MAX_OVERLAP_S, False)],
)
def test_gap_and_overlap(tmp_path, start_s, is_one):
    part(tmp_path / "run_0.mcap", 0)
    part(tmp_path / "run_1.mcap", start_s)
    assert (len(found(tmp_path)[0]) == 1) == is_one


@pytest.mark.parametrize("start_s", [0, -4, 0.1])
def test_short_files_at_the_same_time_are_separate(tmp_path, start_s):
    part(tmp_path / "run_0.mcap", 0, frames=5)
    part(tmp_path / "run_1.mcap", start_s, frames=5)
    assert len(found(tmp_path)[0]) == 2


def test_three_runs_an_hour_apart(tmp_path):
    for number in range(3):
        path = tmp_path / f"run_{number}.bag"
        write_bag(path, times=[(3600 * number * SECOND) + i * SECOND for i in range(60)])
    groups, (line,) = found(tmp_path)
    assert groups == [["run_0.bag"], ["run_1.bag"], ["run_2.bag"]]
    assert line.endswith(
        "to run_2.bag are 3 recordings: run_1.bag begins 59 min 1 s after the end of run_0.bag (and 1 more); "
        "--join makes them one"
    )
    assert found(tmp_path, join=True)[0] == [["run_0.bag", "run_1.bag", "run_2.bag"]]


def test_a_gap_in_the_middle_gives_two_recordings_with_names_of_their_own(tmp_path):
    for number, start_s in enumerate((0, 4, 100, 104)):
        part(tmp_path / f"run_{number}.mcap", start_s)
    recordings = find_recordings([str(tmp_path)])
    assert [recording.name for recording in recordings] == ["run", "run_2"]
    assert [recording.open().name for recording in recordings] == ["run", "run_2"]


def test_other_topics_are_another_recording(tmp_path):
    part(tmp_path / "run_0.mcap", 0)
    part(tmp_path / "run_1.mcap", 4, topic="/other")
    groups, (line,) = found(tmp_path)
    assert len(groups) == 2
    assert "run_1.mcap has other point-cloud topics than run_0.mcap" in line


@pytest.mark.parametrize("content", [b"", b"damaged" * 30])
def test_a_file_that_cannot_be_read_does_not_part_a_recording(tmp_path, content):
    part(tmp_path / "run_0.mcap", 0)
    (tmp_path / "run_1.mcap").write_bytes(content)
    part(tmp_path / "run_2.mcap", 8)
    assert len(found(tmp_path)[0]) == 1


def test_files_without_clouds_in_some_parts(tmp_path):
    part(tmp_path / "run_0.mcap", 0)
    write_log(tmp_path / "run_1.mcap", [Topic("/imu")], [Entry("/imu", START_NS + 4 * SECOND, b"x")])
    assert len(found(tmp_path)[0]) == 1


def test_named_files_are_joined_only_on_request(tmp_path):
    paths = [str(part(tmp_path / f"run_{number}.mcap", 50 * number)) for number in range(2)]
    assert len(find_recordings(paths)) == 2
    assert len(find_recordings([str(tmp_path / "*.mcap")])) == 2
    (recording,) = find_recordings([str(tmp_path / "*.mcap")], Search(join=True))
    assert recording.name == "run"


def tree(tmp_path):
    for name in ("a.mcap", "day1/b.mcap", "day2/deep/c.mcap"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        part(tmp_path / name, 0, frames=2)
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "log.txt").write_text("sunny")
    return tmp_path


def test_nested_folders_are_searched_on_request_and_said_otherwise(tmp_path):
    groups, (line,) = found(tree(tmp_path))
    assert groups == [["a.mcap"]]
    assert line == f"{tmp_path}: the recordings in day1 and 1 other folder are left out; --recursive includes them"
    assert found(tmp_path, recursive=True) == ([["a.mcap"], ["b.mcap"], ["c.mcap"]], [])


def test_a_folder_with_recordings_only_in_folders(tmp_path):
    (tree(tmp_path) / "a.mcap").unlink()
    with pytest.raises(UsageError, match="no logs or frames in this folder; --recursive searches the folders in it"):
        find_recordings([str(tmp_path)])


def test_frames_beside_logs_are_said(tmp_path):
    part(tmp_path / "a.mcap", 0)
    (tmp_path / "000001.pcd").write_text("")
    assert found(tmp_path)[1] == [f"{tmp_path}: the frames in this folder are left out, because it contains logs"]


def test_a_link_that_leads_back_ends(tmp_path):
    (tree(tmp_path) / "day1" / "back").symlink_to(tmp_path, target_is_directory=True)
    assert found(tmp_path, recursive=True)[0] == [["a.mcap"], ["b.mcap"], ["c.mcap"]]


@pytest.mark.parametrize("options", list(itertools.product(["--join", "--no-join"], ["--recursive"])))
def test_options(tmp_path, options):
    for number in range(2):
        part(tmp_path / f"run_{number}.mcap", 100 * number)
    out = execute("info", tmp_path, "--json", *options, code=0)
    assert out.stdout.count('"format"') == (1 if "--join" in options else 2)
