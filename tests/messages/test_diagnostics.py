"""Diagnostics in every encoding, read by independent libraries."""

import json

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from seaclutter_cli.cloud import from_array
from seaclutter_cli.frame import WATER_COLUMNS, FilterResult, Frame, Reason, Rings, WaterState
from seaclutter_cli.messages.diagnostics import PLAIN, WATER, Diagnostics, diagnostics_format, read_diagnostics
from seaclutter_cli.records import Channel, Message

NUMBERS = {
    "frame": 12,
    "points_in": 28,
    "points_out": 7,
    "invalid": 1,
    "near": 2,
    "low_intensity": 3,
    "outlier": 4,
    "far": 5,
    "excluded": 6,
}
WATER_NUMBERS = {**NUMBERS, "unconfirmed": 7, "mirrored": 8, "points_in": 43}
MEASURES = dict(zip(WATER_COLUMNS, (-2.5, 0.25, -1 / 3, 0.5, 0.04), strict=True))
ARRAYS = {
    "thresholds": [30.0, 16.1],
    "corrections": [0.0, 1 / 3],
    "ring_points": [9, 2**32 - 1],
    "ring_low_intensity": [3, 0],
    "ring_outliers": [2, 2],
}


def result_of(stamp_ns, *, rings=True, log_time_ns=5, topic="/points", scene=None, water=None, of_water=(0, 0)):
    """Return a result with 7 kept points and 1, 2, … 6 points removed for each reason but the last two."""
    reason = np.repeat(np.arange(9), [7, 1, 2, 3, 4, 5, 6, *of_water]).astype(np.uint8)
    cloud = from_array(np.zeros(len(reason), [("x", "f4")]), stamp_ns=stamp_ns)
    frame = Frame.of_message(Message(Channel(1, topic, "cdr", None), log_time_ns, 0, 0, b""), cloud, 12)
    values = (np.array(ARRAYS[name]) for name in ARRAYS)
    return FilterResult(frame, reason, Rings(*values) if rings else None, scene, water)


def decode(encoding, schema, data, numbers=tuple(NUMBERS)):
    """Return the message, decoded with its own definition only."""
    if encoding == "json":
        return json.loads(data)
    store = get_typestore(Stores.EMPTY)
    name = f"seaclutter_msgs/msg/{schema.name.rpartition('/')[2]}"
    types = get_types_from_msg(schema.data.decode(), name)
    if encoding == "ros1":
        types = {**get_typestore(Stores.ROS1_NOETIC).fielddefs, **types}
    store.register(types)
    message = (store.deserialize_cdr if encoding == "cdr" else store.deserialize_ros1)(data, name)
    stamp = {"sec": message.stamp.sec, "nsec": message.stamp.nanosec}
    arrays = {name: getattr(message, name).tolist() for name in ARRAYS}
    return {
        "stamp": stamp,
        "topic": message.topic,
        "scene": message.scene,
        **{name: getattr(message, name) for name in numbers},
        **arrays,
    }


ENCODINGS = pytest.mark.parametrize(
    ("cloud_encoding", "encoding", "name", "schema_encoding"),
    [
        ("cdr", "cdr", "seaclutter_msgs/msg/Diagnostics", "ros2msg"),
        ("ros1", "ros1", "seaclutter_msgs/Diagnostics", "ros1msg"),
        ("protobuf", "json", "seaclutter.Diagnostics", "jsonschema"),
        ("json", "json", "seaclutter.Diagnostics", "jsonschema"),
    ],
)


@ENCODINGS
def test_numbers(cloud_encoding, encoding, name, schema_encoding):
    made, schema, serialise = diagnostics_format(cloud_encoding)
    assert (made, schema.name, schema.encoding) == (encoding, name, schema_encoding)
    message = decode(encoding, schema, serialise(Diagnostics.of(result_of(3_000_000_004, scene="confined")).content()))
    texts = {"topic": "/points", "scene": "confined"}
    assert message == {"stamp": {"sec": 3, "nsec": 4}, **texts, **NUMBERS, **ARRAYS}


@ENCODINGS
def test_methods_without_rings_and_scenes(cloud_encoding, encoding, name, schema_encoding):
    _, schema, serialise = diagnostics_format(cloud_encoding)
    message = decode(encoding, schema, serialise(Diagnostics.of(result_of(1, rings=False, topic="/låser")).content()))
    assert [message[name] for name in ARRAYS] == [[]] * 5
    assert (message["topic"], message["scene"]) == ("/låser", "")
    assert {key: message[key] for key in NUMBERS} == NUMBERS


@ENCODINGS
def test_without_a_header_stamp_the_log_time_is_used(cloud_encoding, encoding, name, schema_encoding):
    _, schema, serialise = diagnostics_format(cloud_encoding)
    result = result_of(0, log_time_ns=7 * 10**9 + 8)
    assert decode(encoding, schema, serialise(Diagnostics.of(result).content()))["stamp"] == {"sec": 7, "nsec": 8}


@pytest.mark.parametrize(
    ("stamp_ns", "cdr", "ros1", "exact"),
    [
        (-1_500_000_000, (-2, 500_000_000), (0, 500_000_000), (-2, 500_000_000)),
        (2**31 * 10**9 + 9, (2**31 - 1, 9), (2**31, 9), (2**31, 9)),
        (2**63 - 1, (2**31 - 1, 854_775_807), (2**32 - 1, 854_775_807), (9_223_372_036, 854_775_807)),
        (-(2**63), (-(2**31), 145_224_192), (0, 145_224_192), (-9_223_372_037, 145_224_192)),
    ],
)
def test_a_stamp_out_of_range_is_clipped(stamp_ns, cdr, ros1, exact):
    for encoding, expected in (("cdr", cdr), ("ros1", ros1), ("json", exact)):
        _, schema, serialise = diagnostics_format(encoding)
        stamp = decode(encoding, schema, serialise(Diagnostics.of(result_of(stamp_ns)).content()))["stamp"]
        seconds = stamp["sec"] % 2**32 if encoding == "ros1" else stamp["sec"]
        assert (seconds, stamp["nsec"]) == expected


@pytest.mark.parametrize("layout", [PLAIN, WATER], ids=lambda layout: layout.name)
def test_the_json_schema_describes_every_key(layout):
    _, schema, serialise = diagnostics_format("protobuf", layout)
    described = json.loads(schema.data)["properties"]
    message = json.loads(serialise(Diagnostics.of(result_of(1, water=WaterState(*MEASURES.values()))).content(layout)))
    kinds = {dict: "object", str: "string", int: "integer", list: "array", float: ["number", "null"]}
    assert {key: kinds[type(value)] for key, value in message.items()} == {
        key: value["type"] for key, value in described.items()
    }
    assert described["stamp"]["title"] == "time", "the title by which Foxglove recognises a time"


def test_every_reason_has_a_count():
    assert {reason.name.lower() for reason in Reason if reason} < WATER_NUMBERS.keys()
    assert WATER_NUMBERS.keys() - NUMBERS.keys() == {"unconfirmed", "mirrored"}, "no other method estimates the water"


@pytest.mark.parametrize("state", [WaterState(*MEASURES.values()), None], ids=["water", "no water"])
@ENCODINGS
def test_messages_of_methods_that_estimate_the_water(cloud_encoding, encoding, name, schema_encoding, state):
    made, schema, serialise = diagnostics_format(cloud_encoding, WATER)
    expected_name = name.replace("Diagnostics", "WaterDiagnostics")
    assert (made, schema.name, schema.encoding) == (encoding, expected_name, schema_encoding)
    result = result_of(3_000_000_004, of_water=(7, 8), water=state)
    data = serialise(Diagnostics.of(result).content(WATER))
    message = decode(encoding, schema, data, (*WATER_NUMBERS, *MEASURES))
    missing = None if encoding == "json" else pytest.approx(np.nan, nan_ok=True)
    measures = MEASURES if state else dict.fromkeys(MEASURES, missing)
    texts = {"topic": "/points", "scene": ""}
    assert message == {"stamp": {"sec": 3, "nsec": 4}, **texts, **WATER_NUMBERS, **ARRAYS, **measures}
    found = read_diagnostics(Message(Channel(1, "", encoding, schema), 0, 0, 0, data))
    assert found.counts.tolist() == result.counts.tolist()
    assert found.water == state


@pytest.mark.parametrize("encoding", ["cdr", "ros1", "json"])
def test_both_layouts_are_read_back(encoding):
    for layout, of_water in ((PLAIN, (0, 0)), (WATER, (7, 8))):
        _, schema, serialise = diagnostics_format(encoding, layout)
        diagnostics = Diagnostics.of(result_of(1, of_water=of_water, water=WaterState(*MEASURES.values())))
        data = serialise(diagnostics.content(layout))
        found = read_diagnostics(Message(Channel(1, "", encoding, schema), 0, 0, 0, data))
        assert found.counts.tolist() == [7, 1, 2, 3, 4, 5, 6, *of_water]
        assert found.water == (diagnostics.water if layout is WATER else None)


@pytest.mark.parametrize("layout", [PLAIN, WATER], ids=lambda layout: layout.name)
def test_definitions_match_the_ros_version(layout):
    ros1, ros2 = (diagnostics_format(encoding, layout)[1].data.decode().splitlines() for encoding in ("ros1", "cdr"))
    assert ros1[0] == "time stamp"
    assert ros2[0] == "builtin_interfaces/Time stamp"
    assert "MSG: builtin_interfaces/Time" in ros2
    assert ros1[1:] == ros2[1 : len(ros1)]
