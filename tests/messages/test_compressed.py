"""Codec for compressed clouds against rosbags, zstandard and gzip."""

import gzip
import sys
import zlib

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from seaclutter_cli.errors import CloudError, MissingExtraError, UnsupportedCloudError
from seaclutter_cli.messages.pointcloud2 import CompressedPointCloud2, rewrapped
from tests.messages import wrapped
from tests.messages.clouds import Field, Plain, plain_clouds
from tests.messages.test_pointcloud2 import attributes, little_endian

CODECS = {"cdr": CompressedPointCloud2(2), "ros1": CompressedPointCloud2(1)}
ENCODINGS = pytest.mark.parametrize("encoding", ["cdr", "ros1"])
FORMS = pytest.mark.parametrize("form", ["zstd", "zlib"])
UNPACK = {"zstd": zstandard.decompress, "zlib": gzip.decompress}
FIELDS = (*(Field(name, 4 * k, "f4") for k, name in enumerate("xyz")), Field("intensity", 12, "u2", 3))
PLAIN = Plain(2, 3, FIELDS, 18, 60, False, bytes(range(120)), True, 1_700_000_000_123_456_789, "lidar")


def changed(**changes):
    return Plain(**{**vars(PLAIN), **changes})


def message(plain, form, encoding="cdr"):
    return wrapped.compressed(plain, encoding, form, wrapped.PACK[form](plain.data))


@ENCODINGS
@FORMS
@settings(max_examples=60, deadline=None)
@given(st.data())
def test_round_trip_of_messages_from_rosbags(encoding, form, data):
    plain = data.draw(plain_clouds(encoding))
    cloud = CODECS[encoding].decode(message(plain, form, encoding))
    assert attributes(cloud) == vars(plain)
    again = wrapped.deserialised(encoding, wrapped.COMPRESSED, CODECS[encoding].encode(cloud))
    assert (again.format, again.height, again.width, again.row_step) == (
        form,
        plain.height,
        plain.width,
        plain.row_step,
    )
    assert UNPACK[form](again.compressed_data.tobytes()) == bytes(cloud.data)
    assert encoding == "cdr" or again.header.seq == 3


@FORMS
def test_a_selection_keeps_the_form_and_the_bytes_of_its_points(form):
    keep = np.array([True, False, True, False, False, True])
    data = CODECS["cdr"].encode(CODECS["cdr"].decode(message(PLAIN, form)).select(keep))
    found = wrapped.deserialised("cdr", wrapped.COMPRESSED, data)
    assert (found.format, found.height, found.width, found.row_step) == (form, 1, 3, 54)
    assert UNPACK[form](found.compressed_data.tobytes()) == b"".join(PLAIN.points[k] for k in (0, 2, 5))


def test_big_endian_cdr_and_zlib_without_gzip():
    packed = wrapped.PACK["raw zlib"](PLAIN.data)
    data = wrapped.compressed(PLAIN, "cdr", "zlib", packed, little=False)
    assert bytes(CODECS["cdr"].decode(data).data) == PLAIN.data


def test_several_zstd_frames_are_one_cloud():
    packed = zstandard.compress(PLAIN.data[:50]) + zstandard.compress(PLAIN.data[50:])
    assert bytes(CODECS["cdr"].decode(wrapped.compressed(PLAIN, "cdr", "zstd", packed)).data) == PLAIN.data


@FORMS
def test_clouds_without_points(form):
    empty = changed(height=1, width=0, row_step=0, data=b"")
    for packed in (b"", wrapped.PACK[form](b"")):
        cloud = CODECS["cdr"].decode(wrapped.compressed(empty, "cdr", form, packed))
        assert cloud.size == 0
        assert CODECS["cdr"].decode(CODECS["cdr"].encode(cloud)).size == 0


@FORMS
@pytest.mark.parametrize(("size", "text"), [(113, "the points occupy 114 bytes"), (121, "more than the 120 bytes")])
def test_data_of_another_size_than_the_points(form, size, text):
    packed = wrapped.PACK[form](bytes(size))
    with pytest.raises(CloudError, match=text):
        CODECS["cdr"].decode(wrapped.compressed(PLAIN, "cdr", form, packed))


@FORMS
def test_truncated_data_are_damage_unless_all_points_are_there(form):
    packed = wrapped.PACK[form](PLAIN.data)
    lost = 0
    for size in range(len(packed)):
        try:
            cloud = CODECS["cdr"].decode(wrapped.compressed(PLAIN, "cdr", form, packed[:size]))
        except CloudError:
            lost += 1
        else:
            assert cloud.points.tobytes() == b"".join(PLAIN.points)
    assert lost > len(packed) - 16


@FORMS
def test_limits_of_the_unpacked_size(form, monkeypatch):
    size = 9 * 2**20
    zeros = changed(height=1, width=size // 18, row_step=0, data=b"")
    packed = wrapped.PACK[form](bytes(size // 18 * 18))
    with pytest.raises(CloudError, match=r"above the limit of 64 times .* \(SEACLUTTER_MAX_FILE_RATIO\)"):
        CODECS["cdr"].decode(wrapped.compressed(zeros, "cdr", form, packed))
    monkeypatch.setenv("SEACLUTTER_MAX_FILE_RATIO", "1000000")
    assert CODECS["cdr"].decode(wrapped.compressed(zeros, "cdr", form, packed)).size == size // 18
    monkeypatch.setenv("SEACLUTTER_MAX_MESSAGE_MIB", "8")
    with pytest.raises(CloudError, match=r"8 MiB \(SEACLUTTER_MAX_MESSAGE_MIB\)"):
        CODECS["cdr"].decode(wrapped.compressed(zeros, "cdr", form, packed))


@pytest.mark.parametrize("form", ["zstd", "zlib"])
def test_no_more_is_unpacked_than_the_points_need(form, monkeypatch):
    bomb = wrapped.PACK[form](bytes(2**26))
    read = []
    monkeypatch.setattr(zlib, "decompressobj", _spied(zlib.decompressobj, read))
    with pytest.raises(CloudError, match="more than the 120 bytes"):
        CODECS["cdr"].decode(wrapped.compressed(PLAIN, "cdr", form, bomb))
    assert read == ([121] if form == "zlib" else [])


def _spied(make, read):
    class Spy:
        def __init__(self, bits):
            self._stream = make(bits)
            self.eof = False

        def decompress(self, data, most):
            read.append(most)
            return self._stream.decompress(data, most)

    return Spy


@pytest.mark.parametrize(
    ("form", "text"), [("cloudini", "cloudini_rosbag_converter"), ("", "''"), ("x" * 99, "x{40}'")]
)
def test_other_compressions_are_named(form, text):
    with pytest.raises(UnsupportedCloudError, match=text):
        CODECS["cdr"].decode(wrapped.compressed(PLAIN, "cdr", form, b"CLOUDINI_V03"))


def draco(file="sequential", **options):
    plain = wrapped.draco_plain(**options)
    return wrapped.compressed(plain, "cdr", "draco", (wrapped.DATA / f"{file}.drc").read_bytes())


def test_draco_gives_the_values_of_its_attributes():
    cloud = CODECS["cdr"].decode(draco())
    expected = wrapped.draco_points()
    assert [field.name for field in cloud.fields] == ["x", "y", "z", "intensity", "ring"], "times are not exact"
    for name in cloud.dtype.names:
        assert little_endian(cloud.points[name]) == little_endian(expected[name])
    assert (cloud.point_step, cloud.size) == (26, 100)


def test_draco_with_quantised_values_and_another_order():
    cloud = CODECS["cdr"].decode(draco("kd_tree", without=("timestamp",)))
    points, expected = np.sort(cloud.points, order="x"), wrapped.draco_points()
    for name, span in {"x": 25, "y": 40, "z": 1, "intensity": 99}.items():
        np.testing.assert_allclose(points[name], expected[name], atol=span / 2**14)
    assert points["ring"].tolist() == expected["ring"].tolist()


def test_draco_is_written_as_zstd():
    cloud = CODECS["cdr"].decode(draco())
    assert "are written as the same messages with zstd" in rewrapped(cloud)
    keep = np.arange(100) < 40
    again = CODECS["cdr"].decode(CODECS["cdr"].encode(cloud.select(keep)))
    assert again.extra.format == "zstd"
    assert again.points.tobytes() == cloud.points[:40].tobytes()
    assert rewrapped(again) is None


def test_draco_colours_are_four_values_of_one_field(monkeypatch):
    import DracoPy

    fields = (Field("x", 0, "f4"), Field("rgb", 4, "f4"))
    plain = Plain(1, 100, fields, 8, 800, False, b"", True)
    colours = np.arange(400, dtype=np.uint8).reshape(100, 4)
    shown = [{"data": np.ones((100, 1), np.float32)}, {"data": colours}]
    monkeypatch.setattr(DracoPy, "decode", lambda _: type("Cloud", (), {"attributes": shown}))
    data = (wrapped.DATA / "sequential.drc").read_bytes()
    points = CODECS["cdr"].decode(wrapped.compressed(plain, "cdr", "draco", data)).points
    assert points["rgb"].tobytes() == colours.tobytes()


@pytest.mark.parametrize(
    ("plain", "text"),
    [
        ({"width": 101}, "have 100 points, the message has 101"),
        ({"fields": FIELDS[:3]}, "6 attributes, the message has 3 fields"),
        ({"point_step": 17}, "does not fit into a point of 17 bytes"),
        ({"fields": (Field("x", 0, "f4", 2), *(Field(f"{k}", k, "u1") for k in range(5)))}, "has the shape"),
    ],
)
def test_draco_data_of_another_cloud(plain, text):
    changed = Plain(**{**vars(wrapped.draco_plain()), **plain})
    data = (wrapped.DATA / "sequential.drc").read_bytes()
    with pytest.raises(CloudError, match=text):
        CODECS["cdr"].decode(wrapped.compressed(changed, "cdr", "draco", data))


def test_draco_needs_an_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    with pytest.raises(MissingExtraError, match=r"seaclutter\[draco\]"):
        CODECS["cdr"].decode(draco())
