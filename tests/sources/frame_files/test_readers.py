import struct
import tracemalloc

import numpy as np
import pytest
from pypcd4.pypcd4 import PointCloud

from seaclutter_cli.errors import CloudError
from seaclutter_cli.sources.frame_files import FRAME_READERS
from tests.paths import SHARED_DATA
from tests.sources.frame_files.writers import FOUR, WRITERS, las, pcd_header, ply, read, sample

DATA = SHARED_DATA
real_data = pytest.mark.skipif(not DATA.is_dir(), reason="the real recordings are missing")


def test_every_format_is_tested():
    assert WRITERS.keys() == FRAME_READERS.keys()


@pytest.mark.parametrize("suffix", WRITERS)
def test_round_trip(tmp_path, suffix):
    points = sample()
    cloud = read(tmp_path / f"a{suffix}", WRITERS[suffix](points))
    assert (cloud.height, cloud.width, cloud.stamp_ns) == (1, 50, 0)
    for name in "xyz":
        np.testing.assert_allclose(cloud.points[name], points[name], atol=0.00501 if "la" in suffix else 1e-5)
    expected = np.floor(points["intensity"]) if "la" in suffix else points["intensity"]
    np.testing.assert_allclose(cloud.points["intensity"], expected, rtol=1e-6)


@pytest.mark.parametrize("suffix", WRITERS)
def test_no_points_give_an_empty_cloud(tmp_path, suffix):
    cloud = read(tmp_path / f"a{suffix}", WRITERS[suffix](sample(0)))
    assert cloud.size == 0
    assert {"x", "y", "z", "intensity"} <= set(cloud.dtype.names)
    assert len(cloud.points) == 0


@pytest.mark.parametrize("suffix", WRITERS)
def test_empty_file(tmp_path, suffix):
    if suffix == ".bin":
        assert read(tmp_path / "a.bin", b"").size == 0
    else:
        with pytest.raises(CloudError):
            read(tmp_path / f"a{suffix}", b"")


@pytest.mark.parametrize("suffix", WRITERS)
def test_missing_file_is_not_reported_as_damaged(tmp_path, suffix):
    with pytest.raises(FileNotFoundError):
        read(tmp_path / f"a{suffix}")


@pytest.mark.parametrize("suffix", WRITERS)
def test_truncated_file_is_an_error(tmp_path, suffix):
    content = WRITERS[suffix](sample())
    # Truncation inside the last number of a text, or in the EVLRs after the points of LAS, cannot be recognised.
    for part in (len(content) // 3 + 1, len(content) // 2 + 1):
        cut = content.rindex(b",", 0, content.index(b"\n", part)) if suffix == ".csv" else part
        with pytest.raises(CloudError) as error:
            read(tmp_path / f"a{suffix}", content[:cut])
        assert "\n" not in str(error.value)


HUGE = 10**12


def las_declaring(count, suffix):
    content = bytearray(las(sample(), suffix, point_format=6))
    struct.pack_into("<Q", content, 247, count)
    return bytes(content)


def laz_with(change):
    """Return a LAZ file of layered chunks, changed by a function of its bytes and the offset of its points."""
    content = bytearray(las(sample(), ".laz", point_format=6))
    (start,) = struct.unpack_from("<I", content, 96)
    change(content, start)
    return bytes(content)


def huge_layer(content, start):
    record_length = struct.unpack_from("<H", content, 105)[0]
    struct.pack_into("<I", content, start + 8 + record_length + 4, 2**32 - 1)


def many_chunks(content, start):
    struct.pack_into("<I", content, struct.unpack_from("<q", content, start)[0] + 4, 2**32 - 1)


def wide_points(content, start):
    offset = content.index(b"laszip encoded") - 2 + 54 + 34 + 2
    struct.pack_into("<H", content, offset, 2**16 - 1)


def npy_declaring(count):
    header = f"{{'descr': '<f4', 'fortran_order': False, 'shape': ({count}, 4), }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode() + bytes(64)


BOMBS = {
    "binary.pcd": pcd_header(FOUR, HUGE, "binary") + bytes(64),
    "ascii.pcd": pcd_header(FOUR, HUGE, "ascii") + b"1 2 3 4\n",
    "compressed.pcd": pcd_header(FOUR, 10**8, "binary_compressed") + struct.pack("<II", 8, 16 * 10**8) + bytes(8),
    "count.pcd": pcd_header([*FOUR[:3], ("i", "F", 4, 10**8)], 1, "binary") + bytes(64),
    "binary.ply": ply(sample(3)).replace(b"vertex 3", b"vertex %d" % HUGE),
    "ascii.ply": ply(sample(3), "ascii").replace(b"vertex 3", b"vertex %d" % HUGE),
    "before.ply": ply(sample(3), "ascii").replace(b"element", b"element face %d\nelement" % HUGE),
    "npy.npy": npy_declaring(HUGE),
    "las.las": lambda: las_declaring(HUGE, ".las"),
    "laz.laz": lambda: las_declaring(HUGE, ".laz"),
    "layer.laz": lambda: laz_with(huge_layer),
    "chunks.laz": lambda: laz_with(many_chunks),
    "items.laz": lambda: laz_with(wide_points),
    "vlrs.las": lambda: (content := las(sample(), ".las"))[:100] + b"\xff\xff\xff\xff" + content[104:],
}
BOMBS_FOUND = {"npy.npy": ".", "laz.laz": ".", "layer.laz": "layers do not fit", "items.laz": "65549 bytes"}
"""Patterns of messages about anything but a declared size."""


@pytest.mark.parametrize("name", BOMBS)
def test_declared_sizes_take_no_memory(tmp_path, name):
    content = BOMBS[name]() if callable(BOMBS[name]) else BOMBS[name]
    tracemalloc.start()
    # Memory of compiled libraries is not traced; the messages show that they were not called.
    with pytest.raises(CloudError, match=BOMBS_FOUND.get(name, "declare")):
        read(tmp_path / name, content)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 64 * 2**20


# Real data


@real_data
@pytest.mark.parametrize("name", ["vlp16", "vlp32", "xt32"])
def test_real_pcd(name):
    (path,) = (DATA / "nebula" / name).glob("*.pcd")
    cloud = FRAME_READERS[".pcd"](path)
    expected = PointCloud.from_path(path).pc_data
    assert cloud.size == len(expected) > 10_000
    np.testing.assert_array_equal(cloud.points, expected)


@real_data
def test_real_laz():
    laspy = pytest.importorskip("laspy")
    path = DATA / "las" / "autzen_trim.laz"
    points, expected = FRAME_READERS[".laz"](path).points, laspy.read(path)
    assert len(points) == 110_000
    for name in ("x", "y", "z", "intensity", "gps_time", "red", "return_number"):
        np.testing.assert_array_equal(points[name], np.asarray(expected[name]))


@real_data
def test_real_kitti():
    path = min((DATA / "wads-36" / "velodyne").iterdir())
    points = FRAME_READERS[".bin"](path).points
    np.testing.assert_array_equal(np.array(points.tolist()), np.fromfile(path, "<f4").reshape(-1, 4))
    assert 0 <= points["intensity"].min() <= points["intensity"].max() <= 255


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (b"x,y,z\n1,2,3\n" + b"1," * 40_000 + b"\n", 3),
        (b"x,y,z\n1,2,3\n" + b"1," * 40_000, 3),
        (b"x,y,z\n" + b"1,2,3\n" * 20_000 + b"1" * 70_000 + b"\n1,2,3\n", 20_002),
        (b"x,y,z" + b",c" * 40_000 + b"\n" + b"1," * 1000, 1),
        (b"1 " * 40_000, 1),
        (b"#" * 70_000 + b"\n1 2 3\n", 1),
    ],
)
def test_lines_of_text_are_limited(tmp_path, content, line):
    with pytest.raises(CloudError, match=f"^line {line} is longer than 65,536 bytes$"):
        read(tmp_path / "a.csv", content)


def test_long_lines_and_faults_take_little_memory(tmp_path):
    for content in (b"x,y,z\n" + b"1," * 2**18, b"x,y,z\n" + b"1,2,3\n" * 2**15 + b"1,2\n"):
        tracemalloc.start()
        with pytest.raises(CloudError):
            read(tmp_path / "a.csv", content)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 7.5 * 2**18


def test_a_line_of_the_greatest_length(tmp_path):
    assert read(tmp_path / "a.csv", b"x,y,z\n1,2," + b"0" * 65_531 + b"3\n").points["z"].tolist() == [3]
