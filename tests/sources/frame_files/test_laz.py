"""The process that decompresses LAZ files."""

import struct

import numpy as np
import pytest

from seaclutter_cli.errors import CloudError
from seaclutter_cli.sources.frame_files import FRAME_READERS, laz
from seaclutter_cli.sources.frame_files.las import open_las
from tests.sources.frame_files.writers import las, sample

read_las = FRAME_READERS[".laz"]
CRASH = "import os, signal\nos.kill(os.getpid(), signal.SIGSEGV)\n"


@pytest.fixture
def path(tmp_path):
    pytest.importorskip("laspy")
    path = tmp_path / "points.laz"
    path.write_bytes(las(sample(1000), ".laz"))
    return path


@pytest.fixture(autouse=True)
def no_idle_processes():
    laz._end_idle()
    yield
    laz._end_idle()


@pytest.fixture
def started(monkeypatch):
    """Return the list of processes that are started."""
    workers, start = [], laz.subprocess.Popen
    monkeypatch.setattr(
        laz.subprocess, "Popen", lambda *args, **options: workers.append(start(*args, **options)) or workers[-1]
    )
    return workers


@pytest.mark.parametrize("parts", [1, 7, 500, 1000, 2000])
def test_points_equal_those_of_lazrs_in_parts_of_any_size(path, parts):
    import laspy

    with open_las(path) as reader:
        found = np.concatenate([part.array for part in reader.chunk_iterator(parts)])
    np.testing.assert_array_equal(found, laspy.read(path).points.array)
    assert found.flags.writeable


def test_a_crash_of_the_decoder_costs_only_its_file(path, tmp_path, monkeypatch, started):
    program = tmp_path / "crash.py"
    program.write_text(CRASH)
    with monkeypatch.context() as patch:
        patch.setattr(laz, "_PROGRAM", program)
        with pytest.raises(CloudError, match="the compressed points are damaged; their decoder crashed"):
            read_las(path)
    assert read_las(path).size == 1000
    assert [worker.poll() is None for worker in started] == [False, True]


def test_a_process_reads_several_files(path, started):
    for _ in range(3):
        read_las(path)
    assert len(started) == 1
    laz._end_idle()
    assert started[0].poll() is not None


def test_a_process_ends_if_a_file_is_not_read_to_its_end(path, started):
    with open_las(path) as reader:
        reader.read_points(10)
    assert started[0].poll() is None  # all points had arrived
    with open_las(path) as reader:
        assert reader.point_source is not None  # starts to read
    assert started[0].poll() is not None
    assert len(started) == 1


def test_two_files_at_the_same_time(path, started):
    with open_las(path) as one, open_las(path) as two:
        first, second = one.chunk_iterator(300), two.chunk_iterator(300)
        for a, b in zip(first, second, strict=True):
            np.testing.assert_array_equal(a.array, b.array)
    assert len(started) == 2


def test_an_error_of_the_decoder_is_reported(path):
    content = bytearray(path.read_bytes())
    start = int.from_bytes(content[96:100], "little")
    content[start : start + 8] = (len(content) - 8).to_bytes(8, "little")
    content[-8:] = bytes(8)
    path.write_bytes(content[: start + 60] + content[-8:])
    with pytest.raises(CloudError):
        read_las(path)


def point_wise(path):
    """Write the one chunk of a LAZ file as old LASzip did: without a table, nor its place before the points."""
    import laspy

    with laspy.open(path) as reader:
        start, record = reader.header.offset_to_point_data, reader.header.vlrs.get("LasZipVlr")[0].record_data
    data = path.read_bytes()
    assert data.count(record) == 1
    (table,) = struct.unpack_from("<q", data, start)
    path.write_bytes(data[:start].replace(record, b"\x01\x00" + record[2:]) + data[start + 8 : table])


def test_points_compressed_without_chunks(path):
    expected = read_las(path)
    point_wise(path)
    np.testing.assert_array_equal(read_las(path), expected)
    path.write_bytes(path.read_bytes()[:-2000])
    with pytest.raises(CloudError, match="the compressed points are damaged"):
        read_las(path)
