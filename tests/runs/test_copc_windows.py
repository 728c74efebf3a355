"""COPC files as surveys: read and separated in windows, without the rest of the file."""

import json
from functools import partial

import numpy as np
import pytest

from seaclutter_cli.errors import CloudError
from seaclutter_cli.runs.classify.separate import _SeparateWork
from seaclutter_cli.sources import extents
from seaclutter_cli.sources.extents import Extent, TilePart, windows_of
from seaclutter_cli.sources.frame_files import laz_worker
from seaclutter_cli.sources.frame_files.las import read_index
from seaclutter_cli.sources.tiles import LasTile
from tests.airborne.copc import write_copc
from tests.airborne.tiles import raw_records, read, write
from tests.running import execute
from tests.runs.test_tile_margins import classes, contents, scene

laspy = pytest.importorskip("laspy")
OFFSET = np.array([500_000, 4_000_000])


separate = partial(execute, "classify", "separate")


def points():
    """Return points that leave a bit of 200 m free."""
    return scene() * [0.999, 0.999, 1]


@pytest.fixture(scope="module")
def survey(tmp_path_factory):
    """Return a folder with a COPC file of 200 m by 200 m, and with the same points separated as one tile."""
    folder = tmp_path_factory.mktemp("copc")
    write_copc(folder / "survey.copc.laz", write(folder / "whole.laz", points()))
    separate(folder / "whole.laz", "-o", folder / "separated.laz", code=0)
    return folder


def test_windows_have_the_points_that_laspy_finds(survey):
    path = survey / "survey.copc.laz"
    with laspy.CopcReader.open(path) as reader:
        assert len(reader.query()) == len(points())
        for low in OFFSET + np.array([[0, 0], [70.5, 30.2], [150, 190]]):
            found = TilePart(path, Extent(tuple(low), tuple(low + 60.0)))
            expected = reader.query(laspy.copc.Bounds(low, low + 60.0 - 0.0011))  # whose bounds belong to it
            own = np.concatenate([part.array for part in found.parts()])
            assert found.size == len(expected) > 0
            np.testing.assert_array_equal(np.sort(own, order=["X", "Y"]), np.sort(expected.array, order=["X", "Y"]))


def test_windows_are_a_survey(survey, tmp_path, monkeypatch):
    monkeypatch.setattr(extents, "LEAST_M", 0)
    for jobs in (1, 1):
        out = tmp_path / f"out{len(list(tmp_path.iterdir()))}"
        line = (survey / "survey.copc.laz", "-o", f"{out}/", "--window", 100, "--margin", 50, "-j", jobs)
        result = separate(*line, "--json", code=0)
    assert contents(tmp_path / "out0") == contents(tmp_path / "out1")
    names = [f"survey_{x}_{y}" for x in (500_000, 500_100) for y in (4_000_000, 4_000_100)]
    assert [row["tile"] for row in json.loads(result.stdout)] == names
    found, whole = classes(sorted(out.iterdir())), classes([survey / "separated.laz"])
    np.testing.assert_array_equal(found[:3], whole[:3])
    assert (found[3] != whole[3]).mean() <= 0.001
    header = read(out / f"{names[0]}.laz").header
    assert (header.maxs[:2] <= OFFSET + 100).all()
    assert header.number_of_points_by_return.sum() == header.point_count == json.loads(result.stdout)[0]["points"]
    assert [row["status"] for row in json.loads(separate(*line, "--json", "--resume").stdout)] == ["skipped"] * 4


def test_only_the_chunks_of_a_window_are_read(survey, monkeypatch):
    read_points = []
    monkeypatch.setattr(extents, "read_chunks", lambda _, chunks: read_points.append(sum(n for *_, n in chunks)) or ())
    path = survey / "survey.copc.laz"
    for head in windows_of(path, 50):
        TilePart(path, head.window)
    assert len(read_points) == 16
    assert read_points[0] < 0.4 * len(points())  # the root and a quarter of the rest; one in the middle needs all


def test_a_window_is_as_large_as_what_is_read_of_it(survey):
    path = survey / "survey.copc.laz"
    works = [_SeparateWork(one, path, None, None, None, several=True, pixel_m=None) for one in windows_of(path, 50)]
    assert len(works) == 16
    assert 0 < min(one.input_bytes for one in works) < path.stat().st_size / 2
    assert max(one.input_bytes for one in works) < path.stat().st_size


def test_a_whole_copc_file_loses_its_index(survey, tmp_path):
    """The index of the input does not fit the chunks of the output."""
    separate(survey / "survey.copc.laz", "-o", tmp_path / "out.laz", code=0)
    _, before, after = raw_records(tmp_path / "out.laz")
    assert b"copc" not in [user for user, *_ in [*before, *after]]
    np.testing.assert_array_equal(classes([tmp_path / "out.laz"])[:3], classes([survey / "separated.laz"])[:3])


def test_large_chunks_are_decompressed_in_parts(survey, monkeypatch):
    monkeypatch.setattr(laz_worker, "_BLOCK_POINTS", 1000)
    lazrs, path = pytest.importorskip("lazrs"), survey / "survey.copc.laz"
    header = LasTile(path).header
    with laspy.open(path) as reader:
        described, size = reader.header.vlrs.get("LasZipVlr")[0].record_data, header.point_format.size
    chunks = read_index(path, header).chunks.tolist()
    assert max(points for *_, points in chunks) > 2000
    with path.open("rb") as file:
        blocks = list(laz_worker._read(lazrs, file, chunks, described, size, 0))
        file.seek(chunks[0][0])
        data = file.read(sum(length for _, length, _ in chunks))
    whole = bytearray(header.point_count * size)
    table = [(points, length) for _, length, points in chunks]
    lazrs.decompress_points_with_chunk_table(data, described, whole, table)
    assert b"".join(blocks) == whole
    assert max(map(len, blocks)) <= 1000 * size


def test_windows_need_a_copc_file(survey, tmp_path):
    result = separate(survey / "whole.laz", "-o", f"{tmp_path}/", "--window", 100)
    assert (result.exit_code, "only COPC files can be read by window" in result.stderr) == (2, True)


def test_windows_without_points_are_skipped(survey, tmp_path):
    result = separate(survey / "survey.copc.laz", "-o", f"{tmp_path / 'out'}/", "--window", 199.5, "--json", code=0)
    rows = json.loads(result.stdout)
    assert sum(row["points"] for row in rows) == len(points())
    assert all((row["status"] == "skipped") == (row["points"] == 0) for row in rows)


def _damaged(survey, tmp_path, name):
    """Return a COPC file with an impossible value in its index."""
    data = bytearray((survey / "survey.copc.laz").read_bytes())
    info = data.index(b"copc") + 52
    root = int.from_bytes(data[info + 40 : info + 48], "little")
    second = root + 32  # refers to a page of the index
    at, value = {
        "a page beyond the end": (info + 40, 2**40),
        "a page that refers to itself": (second + 16, root),
        "a chunk beyond the end": (root + 16, 2**40),
        "more points than the header": (root + 28, 2**30),
        "a deep level": (root, 2**20),
        "no size": (info + 24, 0),
    }[name]
    size = 4 if at in (root + 28, root) else 8
    data[at : at + size] = value.to_bytes(size, "little")
    path = tmp_path / "damaged.copc.laz"
    path.write_bytes(data)
    return path


@pytest.mark.parametrize(
    "name",
    [
        "a page beyond the end",
        "a page that refers to itself",
        "a chunk beyond the end",
        "more points than the header",
        "a deep level",
        "no size",
    ],
)
def test_a_damaged_index_is_an_error(survey, tmp_path, name):
    path = _damaged(survey, tmp_path, name)
    with pytest.raises(CloudError, match="COPC index has"):
        windows_of(path, 100)
    result = separate(path, "-o", f"{tmp_path / 'out'}/", "--window", 100)
    assert (result.exit_code, result.stderr.startswith(f"Error: {path}: the COPC index has")) == (1, True)
