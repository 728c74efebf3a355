"""Logs that change while they are read."""

import pytest

from seaclutter_cli.errors import InputError
from seaclutter_cli.records import FilePart
from seaclutter_cli.sources.formats import open_source
from seaclutter_cli.sources.shared.log_file import LogFile, LostDataError
from tests.pairs import covering
from tests.paths import ROOT
from tests.sources.pcap.captures import frames, pcap
from tests.sources.rosbag1.bags import LZ4, write_bag
from tests.sources.rosbag2.test_db3 import write_file
from tests.sources.shared.packet_bags import captured


def test_slices(tmp_path):
    content = bytes(range(256)) * 40
    path = tmp_path / "log"
    path.write_bytes(content)
    file = LogFile(path, window=100)
    for start, stop in ((0, 10), (5, 90), (95, 120), (0, 9000), (10239, 10240), (10240, 10240), (7, 3), (9, 20000)):
        assert file[start:stop] == content[start:stop]
    assert bytes(FilePart(file, 3, 7000)) == content[3:7000]


def test_a_file_that_grows_keeps_its_size(tmp_path):
    path = tmp_path / "log"
    path.write_bytes(b"abc")
    file = LogFile(path)
    with path.open("ab") as more:
        more.write(b"def")
    assert (len(file), file[0:6]) == (3, b"abc")


def test_a_part_that_was_cut_off_is_an_error(tmp_path):
    path = tmp_path / "log"
    path.write_bytes(bytes(1000))
    file = LogFile(path, window=10)
    with path.open("r+b") as other:
        other.truncate(500)
    assert file[490:500] == bytes(10)
    with pytest.raises(LostDataError, match="truncated while it was read"):
        file[499:501]


@pytest.mark.parametrize("content", [None, b""])
def test_paths_that_are_not_logs(tmp_path, content):
    path = tmp_path / "log"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError):
        LogFile(path if content is not None else tmp_path)


SAMPLES = ROOT / "samples"


def write_capture(path):
    packets = captured(SAMPLES / "rs-lidar-32.pcap")
    rows = [(time_ns + number * 10**9, data, 6699) for number in range(10) for time_ns, data in packets]
    path.write_bytes(pcap(frames(rows)))
    return path


def copy_mcap(path):
    path.write_bytes((SAMPLES / "sea.mcap").read_bytes())
    return path


LOGS = {
    "a.mcap": copy_mcap,
    "a.pcap": write_capture,
    "a.db3": lambda path: write_file(path, messages=600, size=5000),
    "lz4.bag": lambda path: write_bag(path, LZ4, messages=600, size=3000),
    "none.bag": lambda path: write_bag(path, messages=600, size=3000),
}
"""Writers of logs of every format with random access; none fits into the memory that a reader keeps."""


@pytest.mark.parametrize(("name", "keep"), covering(LOGS, (0, 0.3)))
def test_a_log_truncated_while_it_is_read_loses_only_the_rest(tmp_path, name, keep):
    path = LOGS[name](tmp_path / name)
    whole = open_source(path)
    messages = sum(1 for _ in whole.records())
    whole.close()
    source = open_source(path)
    records = source.records()
    next(records)
    with path.open("r+b") as other:
        other.truncate(int(keep * path.stat().st_size))
    found = 1 + sum(1 for _ in records)
    source.close()
    assert found < messages
    assert source.damage
