import io
import struct
import sys

import numpy as np
import pytest
from pypcd4.pypcd4 import Encoding

from seaclutter_cli.errors import CloudError, MissingExtraError
from seaclutter_cli.sources.frame_files.laz import LazBackend
from tests.sources.frame_files.writers import FOUR, XYZI, las, npy, pcd, pcd_header, ply, read, sample

# PCD


@pytest.mark.parametrize("encoding", [Encoding.ASCII, Encoding.BINARY, Encoding.BINARY_COMPRESSED])
def test_pcd_keeps_every_field(tmp_path, encoding):
    dtype = [*XYZI, ("ring", "u2"), ("tag", "u1"), ("line", "i1"), ("rgb", "u4"), ("offset", "i4"), ("time", "f8")]
    points = sample(200, dtype)
    points["x"][3] = np.nan
    points["rgb"] = np.arange(200) * 0x010203 % 2**32
    cloud = read(tmp_path / "a.pcd", pcd(points, encoding))
    assert cloud.dtype == points.dtype
    for name in points.dtype.names:
        np.testing.assert_array_equal(cloud.points[name], points[name])


def test_pcd_keeps_packed_colours_bit_by_bit(tmp_path):
    bits = np.array([0xFF010203, 0x7FC00001, 0x00000001, 0xFFFFFFFF], "<u4")  # NaN payloads and a denormal
    content = pcd_header([*FOUR[:3], ("rgb", "F", 4, 1)], 4, "binary")
    content += np.stack([bits] * 4, axis=1).tobytes()
    points = read(tmp_path / "a.pcd", content).points
    np.testing.assert_array_equal(points["rgb"].copy().view("<u4"), bits)


SEVERAL = [
    ("x", "F", 4, 1),
    ("y", "F", 4, 1),
    ("z", "F", 4, 1),
    ("_", "U", 1, 4),
    ("normal", "F", 4, 3),
    ("t", "F", 8, 1),
]
SEVERAL_DTYPE = np.dtype([("x", "f4"), ("y", "f4"), ("z", "f4"), ("normal", "f4", (3,)), ("t", "f8")])


def several(encoding, points):
    """Return a PCD file with a field of three values, like PCL: compressed, the values of a point are adjacent."""
    fields = [field for field in SEVERAL if encoding == "binary" or field[0] != "_"]
    header = pcd_header(fields, len(points), encoding, height=2)
    if encoding == "ascii":
        rows = [" ".join(map(str, np.hstack([row[n] for n in points.dtype.names]).tolist())) for row in points]
        return header + "\n".join(rows).encode()
    if encoding == "binary":
        padded = np.zeros(len(points), [(n, f"{kind}{size}".lower(), (c,)) for n, kind, size, c in fields])
        for name in points.dtype.names:
            padded[name] = points[name].reshape(len(points), -1)
        return header + padded.tobytes()
    import lzf

    columns = b"".join(points[name].tobytes() for name in points.dtype.names)
    packed = lzf.compress(columns)
    return header + struct.pack("<II", len(packed), len(columns)) + packed


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
def test_pcd_several_values_padding_and_rows(tmp_path, encoding):
    points = np.tile(sample(20, SEVERAL_DTYPE), 4)
    cloud = read(tmp_path / "a.pcd", several(encoding, points))
    assert (cloud.height, cloud.width) == (2, 40)
    assert cloud.dtype == SEVERAL_DTYPE
    np.testing.assert_array_equal(cloud.points, points)


def test_pcd_of_old_versions_and_odd_names(tmp_path):
    fields = [*FOUR[:2], ("_z", "F", 4, 1), ("scan.angle(deg)", "F", 4, 1)]
    header = pcd_header(fields, 2, "binary", VERSION=".6", COUNT=None, VIEWPOINT=None).replace(b"\n", b"\r\n")
    cloud = read(tmp_path / "a.pcd", header + np.arange(8, dtype="<f4").tobytes())
    assert cloud.dtype.names == ("x", "y", "_z", "scan.angle(deg)")
    np.testing.assert_array_equal(cloud.points["scan.angle(deg)"], [3, 7])


def test_pcd_ascii_with_any_white_space(tmp_path):
    content = pcd_header(FOUR, 2, "ascii") + b" 1\t2  3 4 \r\n\r\n5 6 nan 8"
    points = read(tmp_path / "a.pcd", content).points
    np.testing.assert_array_equal(np.array(points.tolist()), [[1, 2, 3, 4], [5, 6, np.nan, 8]])


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ({"POINTS": 3}, "POINTS 3"),
        ({"WIDTH": "two"}, "two"),
        ({"SIZE": "4 4 4"}, "SIZE"),
        ({"TYPE": "F F F X"}, "X4"),
        ({"COUNT": "1 1 1 0"}, "x 0"),
        ({"FIELDS": "x y z z"}, "z"),
        ({"DATA": "zip"}, "zip"),
    ],
)
def test_pcd_wrong_headers(tmp_path, header, message):
    with pytest.raises(CloudError, match=message):
        read(tmp_path / "a.pcd", pcd_header(FOUR, 2, "binary", **header) + bytes(32))


# PLY


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_every_type_and_other_elements(tmp_path, encoding):
    dtype = [*XYZI, ("a", "u1"), ("b", "i1"), ("c", "u2"), ("d", "i2"), ("e", "u4"), ("f", "i4"), ("g", "f8")]
    points = sample(30, dtype)
    order = ">" if encoding == "binary_big_endian" else "<"
    before = b"1.5 7\n2.5 8\n" if encoding == "ascii" else struct.pack(order + "fBfB", 1.5, 7, 2.5, 8)
    after = b"3 0 1 2\n" if encoding == "ascii" else struct.pack(order + "Biii", 3, 0, 1, 2)
    content = ply(
        points,
        encoding,
        before="element camera 2\nproperty float view\nproperty uchar id\n",
        after="element face 1\nproperty list uchar int vertex_indices\n",
        body_before=before,
        body_after=after,
    )
    cloud = read(tmp_path / "a.ply", content)
    assert cloud.dtype == points.dtype
    np.testing.assert_array_equal(cloud.points, points)


def test_ply_sized_type_names_and_windows_lines(tmp_path):
    content = ply(sample(), "ascii").replace(b"property float", b"property float32").replace(b"\n", b"\r\n")
    np.testing.assert_array_equal(read(tmp_path / "a.ply", content).points, sample())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ((b"element vertex", b"element face"), "no element 'vertex'; the file has face"),
        ((b"end_header", b"property list uchar int near\nend_header"), "'near' of element 'vertex' is a list"),
        (
            (b"element vertex", b"element f 1\nproperty list uchar int i\nelement vertex"),
            "'i' of element 'f' is a list",
        ),
        ((b"property float z", b"property float y"), "y"),
        ((b"property float z", b"property quad z"), "quad"),
        ((b"format binary_little_endian 1.0\n", b""), "format"),
        ((b"ply\n", b"plx\n"), "no PLY header"),
    ],
)
def test_ply_files_that_cannot_be_read(tmp_path, change, message):
    with pytest.raises(CloudError, match=message):
        read(tmp_path / "a.ply", ply(sample()).replace(*change))


def test_ply_ascii_names_the_line_of_a_fault(tmp_path):
    content = ply(sample(3), "ascii", before="element extra 1\nproperty uchar a\n", body_before=b"1\n")
    with pytest.raises(CloudError, match="line 15: 'oops' is not a number"):
        read(tmp_path / "a.ply", content[: content.rindex(b" ")] + b" oops\n")


def test_pcd_ascii_names_the_line_of_a_fault(tmp_path):
    content = several("ascii", sample(2, SEVERAL_DTYPE))
    with pytest.raises(CloudError, match="line 13 has 6 values, expected 7"):
        read(tmp_path / "a.pcd", content[: content.rindex(b" ")])
    with pytest.raises(CloudError, match="line 13 has 3 values, expected 4"):
        read(tmp_path / "a.pcd", pcd_header(FOUR, 2, "ascii") + b"1 2 3 4\n5 6 7\n")


# LAS


@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize("point_format", [0, 3, 6, 8])
def test_las_keeps_every_dimension(tmp_path, suffix, point_format):
    content = las(sample(), suffix, point_format)
    points = read(tmp_path / f"a{suffix}", content).points
    laspy = pytest.importorskip("laspy")
    expected = laspy.read(io.BytesIO(content))
    assert points.dtype["x"] == "f8"
    assert points.dtype["intensity"] == "u2"
    assert points.dtype["echo"] == "u2"
    assert set(points.dtype.names) == {*expected.point_format.dimension_names, "x", "y", "z"} - {"X", "Y", "Z"}
    for name in points.dtype.names:
        np.testing.assert_array_equal(points[name], np.asarray(expected[name]))


def test_las_without_laspy_names_the_extra(tmp_path, monkeypatch):
    content = las(sample(), ".las")
    monkeypatch.setitem(sys.modules, "laspy", None)
    with pytest.raises(MissingExtraError, match=r"seaclutter\[las\]"):
        read(tmp_path / "a.las", content)


def test_laz_without_a_decompressor_names_the_extra(tmp_path, monkeypatch):
    content = las(sample(), ".laz")
    monkeypatch.setattr(LazBackend, "is_available", lambda backend: False)
    with pytest.raises(MissingExtraError, match=r"seaclutter\[las\]"):
        read(tmp_path / "a.laz", content)


def test_las_damage_prints_nothing(tmp_path, capfd):
    for suffix in (".las", ".laz"):
        with pytest.raises(CloudError):
            read(tmp_path / f"a{suffix}", las(sample(), suffix)[:-300])
    assert capfd.readouterr() == ("", "")


# KITTI


def test_kitti_error_gives_the_size(tmp_path):
    with pytest.raises(CloudError, match="33 bytes"):
        read(tmp_path / "a.bin", bytes(33))


# NPY


@pytest.mark.parametrize("type_", ["f4", "f8", ">f4", "f2", "i2", "u1", "i8"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_npy_tables(tmp_path, type_, order):
    table = np.asarray(np.arange(70).reshape(10, 7), type_, order=order)
    points = read(tmp_path / "a.npy", npy(table)).points
    assert points.dtype.names == ("x", "y", "z", "intensity", "ring", "field_5", "field_6")
    np.testing.assert_array_equal(np.array(points.tolist()), table)


def test_npy_structured_arrays(tmp_path):
    points = sample(30, [*XYZI, ("ring", "u2"), ("t", ">f8"), ("pair", "f4", (2,))])
    cloud = read(tmp_path / "a.npy", npy(points))
    assert cloud.dtype.names == points.dtype.names
    np.testing.assert_array_equal(cloud.points, points)


@pytest.mark.parametrize(
    "array",
    [
        np.zeros((5, 2)),
        np.zeros(5),
        np.zeros((2, 5, 4)),
        np.zeros((5, 4), complex),
        np.full((5, 4), "a"),
        np.array(7.0),
        np.zeros((5, 2), [("x", "f4")]),
        np.zeros(5, [("x", "f4"), ("when", "M8[ns]")]),
    ],
)
def test_npy_arrays_that_are_not_clouds(tmp_path, array):
    with pytest.raises(CloudError):
        read(tmp_path / "a.npy", npy(array))


def test_npy_never_unpickles(tmp_path):
    with pytest.raises(CloudError):
        read(tmp_path / "a.npy", npy(np.array([[print, 1, 2]], object)))


# CSV


@pytest.mark.parametrize(
    "content",
    [
        b"x,y,z,intensity\n1,2,3,4\n5,6,7,8\n",
        b"X;Y;Z;intensity\r\n1;2;3;4\r\n5;6;7;8\r\n",
        b"\xef\xbb\xbfx\ty\tz\tintensity\n1\t2\t3\t4\n\n5\t6\t7\t8",
        b"# x y z intensity\n1 2  3 4\n 5 6 7 8\n",
        b"//X Y Z intensity\n1 2 3 4\n5 6 7 8\n",
        b"# made by a tool\n#x, y, z, intensity\n1, 2, 3, 4\n# between\n5, 6, 7, 8\n",
        b'"x","y","z","intensity"\n1,2,3,4\n5,6,7,8\n',
        b"1,2,3,4\n5,6,7,8\n",
        b"1 2 3 4\n5 6 7 8",
        b"# no names here\n\n1e0;2.0;3;4\n5;6;7;8\n",
    ],
)
def test_csv_dialects(tmp_path, content):
    points = read(tmp_path / "a.csv", content).points
    assert points.dtype == np.dtype([(name, "f8") for name in ("x", "y", "z", "intensity")])
    np.testing.assert_array_equal(np.array(points.tolist()), [[1, 2, 3, 4], [5, 6, 7, 8]])


def test_csv_names_of_more_columns(tmp_path):
    assert read(tmp_path / "a.csv", b"Time,x,y,z,,Ring\n1,2,3,4,5,6\n").dtype.names == (
        *("Time", "x", "y", "z", "field_4", "Ring"),
    )
    assert read(tmp_path / "b.csv", b"1,2,3,4,5,6\n").dtype.names == ("x", "y", "z", "intensity", "ring", "field_5")


@pytest.mark.parametrize("mark", [",", ";", "\t"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_csv_empty_cells_are_nan(tmp_path, mark, end):
    rows = ["x,y,z,i", "1,,3,", ",,,", "", "nan, ,3,4", "1,2,3,4"]
    content = end.join(rows).replace(",", mark).encode()
    points = read(tmp_path / "a.csv", content).points
    nan = np.nan
    expected = [[1, nan, 3, nan], [nan] * 4, [nan, nan, 3, 4], [1, 2, 3, 4]]
    np.testing.assert_array_equal(np.array(points.tolist()), expected)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"x,y,z\n1,2,3\n4,5\n", "line 3 has 2 values, expected 3"),
        (b"x,y,z\n1,2,3\n\n4,5,6,7\n", "line 4 has 4 values, expected 3"),
        (b"x y z\n1 2 3\n4 5\n", "line 3 has 2 values, expected 3"),
        (b"# x y z\n1 2 3\n4 five 6\n", "line 3: 'five' is not a number"),
        (b"1,2,3\n4,5,--\n", "line 2: '--' is not a number"),
        (b"frame,class\n1,ship\n", "line 1 contains neither numbers nor the column names x, y and z"),
        (b"1,2\n", "got 2"),
        (b"x,y,z,x\n1,2,3,4\n", "x"),
        (b"\n\n", "no points"),
    ],
)
def test_csv_names_the_fault(tmp_path, content, message):
    with pytest.raises(CloudError, match=message):
        read(tmp_path / "a.csv", content)
