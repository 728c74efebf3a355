"""Operations on clouds, compared with loops over their bytes."""

import math
import struct
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaclutter_cli.cloud import FIELD_TYPES, Cloud, PointField, from_array, point_dtype
from seaclutter_cli.errors import CloudError, FieldError
from tests.messages.clouds import SIZES, TYPES, Field, Plain, plain_clouds

ORDER = {False: "<", True: ">"}


def masks(size):
    return st.lists(st.booleans(), min_size=size, max_size=size)


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_select(data):
    plain = data.draw(plain_clouds())
    keep = data.draw(masks(plain.height * plain.width))
    cloud = plain.cloud()
    selected = cloud.select(np.array(keep, np.bool_))
    expected = [point for point, kept in zip(plain.points, keep, strict=True) if kept]
    assert bytes(selected.data) == b"".join(expected)
    assert (selected.height, selected.width, selected.size) == (1, len(expected), len(expected))
    assert selected.row_step == len(selected.data)
    assert (selected.fields, selected.stamp_ns, selected.frame_id) == (cloud.fields, plain.stamp_ns, plain.frame_id)
    assert (selected.big_endian, selected.dense) == (plain.big_endian, plain.dense)
    assert not expected or selected.dtype == cloud.dtype


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_with_field(data):
    plain = data.draw(plain_clouds())
    kind = data.draw(st.sampled_from(sorted(TYPES)))
    size = plain.height * plain.width
    values = data.draw(st.lists(st.integers(0, 100), min_size=size, max_size=size))
    cloud = plain.cloud().with_field("reason", np.array(values, kind))
    code = ORDER[plain.big_endian] + TYPES[kind]
    expected = [point + struct.pack(code, value) for point, value in zip(plain.points, values, strict=True)]
    assert bytes(cloud.data) == b"".join(expected)
    taken, name = {field.name for field in plain.fields}, "reason"
    while name in taken:
        name += "_"
    assert cloud.fields == (*plain.cloud().fields, PointField(name, plain.point_step, kind))
    assert (cloud.height, cloud.width, cloud.point_step) == (1, size, plain.point_step + SIZES[kind])


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_blank(data):
    plain = data.draw(plain_clouds(distinct=True))
    removed = data.draw(masks(plain.height * plain.width))
    kind = data.draw(st.sampled_from(["f4", "f8"]))
    others = tuple(field for field in plain.fields if field.name not in "xyz")
    start, size = plain.point_step, SIZES[kind]
    step = start + 3 * size
    axes = tuple(Field(axis, start + k * size, kind) for k, axis in enumerate("xyz"))
    row_step = plain.width * step + 5
    content = data.draw(st.binary(min_size=plain.height * row_step, max_size=plain.height * row_step))
    wider = replace(plain, fields=others + axes, point_step=step, row_step=row_step, data=content)
    cloud = wider.cloud().blank(np.array(removed, np.bool_))

    expected = bytearray(content)
    nan = struct.pack(ORDER[plain.big_endian] + TYPES[kind], math.nan)
    for index, blank in enumerate(removed):
        at = index // plain.width * row_step + index % plain.width * step + start
        expected[at : at + 3 * size] = nan * 3 if blank else expected[at : at + 3 * size]
    assert bytes(cloud.data) == expected
    assert wider.data == content, "the input must not change"
    assert replace(cloud, data=content, dense=wider.dense) == wider.cloud()
    assert not cloud.dense


@pytest.mark.parametrize("axis", ["i4", None, ("f4", (2,))])
def test_coordinates_that_cannot_be_nan(axis):
    layout = [("x", "f4"), ("y", "f4"), *([("z", axis)] if isinstance(axis, str) else [])]
    layout += [("z", *axis)] if isinstance(axis, tuple) else []
    with pytest.raises(FieldError, match="field 'z' is not a floating-point number"):
        from_array(np.zeros(4, layout), height=2).blank(np.ones(4, np.bool_))


@pytest.mark.parametrize(("given", "stored"), [("i8", "f8"), ("u8", "f8"), ("f2", "f4"), ("?", "u1"), (">u2", "u2")])
@pytest.mark.parametrize("big_endian", [False, True])
def test_types_that_are_converted(given, stored, big_endian):
    values = np.array([0, 1, 1], given)
    cloud = replace(from_array(np.zeros(3, [("x", "u1")])), big_endian=big_endian).with_field("v", values)
    assert cloud.points["v"].tolist() == [0, 1, 1]
    assert cloud.fields[1] == PointField("v", 1, stored)
    array = np.zeros(3, [("v", given)])
    array["v"] = values
    made = from_array(array)
    assert (made.fields, made.points["v"].tolist()) == ((PointField("v", 0, stored),), [0, 1, 1])


@pytest.mark.parametrize("kind", ["U3", "O", "c8", "M8[ns]", "S2"])
def test_types_that_cannot_be_stored(kind):
    with pytest.raises(FieldError, match="a point field cannot have the type"):
        from_array(np.zeros(2, [("v", kind)]))
    with pytest.raises(FieldError, match="a point field cannot have the type"):
        from_array(np.zeros(2, [("x", "f4")])).with_field("v", np.zeros(2, kind))


def test_an_existing_name_gets_an_underscore():
    cloud = from_array(np.zeros(2, [("reason", "u1"), ("reason_", "u1")])).with_field("reason", np.array([1, 2], "u1"))
    assert [field.name for field in cloud.fields] == ["reason", "reason_", "reason__"]
    assert cloud.points["reason__"].tolist() == [1, 2]


def test_an_array_round_trip_with_gaps_subarrays_and_other_byte_orders():
    layout = np.dtype(
        {"names": ["n", "v", "t"], "formats": [">u2", ("<f4", (3,)), ">f8"], "offsets": [3, 16, 6], "itemsize": 40}
    )
    array = np.zeros(5, layout)
    array["n"], array["v"], array["t"] = np.arange(5), np.arange(15).reshape(5, 3), np.arange(5) / 3
    cloud = from_array(array[::-1], stamp_ns=7, frame_id="map")
    assert [(f.name, f.offset, f.type, f.count) for f in cloud.fields] == [
        ("n", 0, "u2", 1),
        ("v", 2, "f4", 3),
        ("t", 14, "f8", 1),
    ]
    for name in layout.names:
        assert np.array_equal(cloud.points[name], array[::-1][name])


def test_an_array_without_copying():
    array = np.zeros(4, [("x", "<f4"), ("ring", "<u2")])
    assert np.shares_memory(from_array(array).points, array)
    organised = from_array(array, height=2)
    assert (organised.height, organised.width, organised.row_step, organised.size) == (2, 2, 12, 4)
    assert from_array(array[:0]).size == from_array(array[:0], height=0).size == 0
    assert (organised.stamp_ns, organised.big_endian, organised.dense) == (0, False, False)


def test_a_dtype_with_many_equal_names_is_fast():
    fields = tuple(PointField("", k, "u1") for k in range(1024))
    assert len(set(point_dtype(fields, 1024, False).names)) == 1024


@pytest.mark.parametrize("kind", FIELD_TYPES)
def test_end_of_a_field(kind):
    assert PointField("v", 3, kind).end == 3 + SIZES[kind]
    assert PointField("v", 3, kind, 0).end == 3 + SIZES[kind]
    assert PointField("v", 3, kind, 4).end == 3 + 4 * SIZES[kind]


def test_maximum_size_of_a_point():
    assert point_dtype((), 10_000_000, False).itemsize == 10_000_000
    with pytest.raises(CloudError, match="a point must have 0 to 10000000 bytes, got 10000001"):
        point_dtype((), 10_000_001, False)


@pytest.mark.parametrize("offset", [-1, 1, 2**31, 2**70])
@pytest.mark.parametrize("width", [0, 1])
def test_fields_outside_the_point(offset, width):
    field = PointField("v", offset, "f4")
    if width == 0 and offset == 1:  # valid, since there is no point
        assert Cloud(0, "", 1, 0, (field,), 4, 0, False, True, b"").dtype.itemsize == 5
        return
    with pytest.raises(CloudError):
        Cloud(0, "", 1, width, (field,), 4, 4, False, True, bytes(4 * width))


def test_bytes_after_the_last_point_are_left_out():
    cloud = Plain(2, 2, (Field("v", 0, "u1"),), 1, 3, False, b"ab.cd......").cloud()
    assert bytes(cloud.select(np.ones(4, np.bool_)).data) == b"abcd"
    last_row_cut_short = Plain(2, 2, (Field("v", 0, "u1"),), 1, 3, False, b"ab.cd").cloud()
    assert bytes(last_row_cut_short.points) == b"abcd"
    with pytest.raises(CloudError, match="the points occupy 5 bytes, but the message has 3"):
        Plain(2, 2, (Field("v", 0, "u1"),), 1, 3, False, b"ab.").cloud()


@pytest.mark.parametrize(
    ("fields", "stamp_ns", "problem"),
    [
        ([PointField("x", 0, "f4")] * 1025, 0, "1,025 fields, at most 1,024"),
        ([PointField(f"v{k}", 0, "f4", 4) for k in range(40)], 0, "fields overlap"),
        ([PointField("x", 0, "f4")], 2**63, "1677 and 2262"),
        ([PointField("x", 0, "f4")], -(2**63) - 1, "1677 and 2262"),
    ],
)
def test_clouds_of_absurd_sizes_are_refused(fields, stamp_ns, problem):
    with pytest.raises(CloudError, match=problem):
        Cloud(stamp_ns, "lidar", 1, 1, tuple(fields), 16, 16, False, False, bytes(16))


def test_repeated_names_get_underscores():
    cloud = Cloud(
        0, "lidar", 1, 1, (PointField("a", 0, "u1"),) * 5 + (PointField("a__", 0, "u1"),), 1, 1, False, False, b"1"
    )
    assert cloud.dtype.names == ("a", "a_", "a__", "a___", "a____", "a_____")
