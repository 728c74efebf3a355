"""Scene updates: read by independent libraries, and compared with the published schemas."""

import json
import math

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from seaclutter_cli.messages import scene as scenes
from seaclutter_cli.messages.scene import SceneBox, SceneUpdate, scene_format

STAMP_NS = 1_700_000_000_123_456_789
BUOY = SceneBox((40.0, -5.0, 1.0), (2.0, 3.0, 4.0), math.pi / 2, "#0b6b50", "buoy <1> é")
WAVE = SceneBox((20.0, 0.0, -1.0), (1.0, 1.0, 0.5), 0.0, "#c2410c")
SCENE = SceneUpdate(STAMP_NS, "lidar", {"/points labels": [BUOY], "/points clusters": [BUOY, WAVE], "empty": []})


def decoded(encoding):
    """Return the message, decoded with its own schema only."""
    kind, schema, serialise = scene_format(encoding)
    data = serialise(SCENE.content)
    if kind == "json":
        return json.loads(data)
    store = get_typestore(Stores.EMPTY)
    name = "foxglove_msgs/msg/SceneUpdate"
    store.register(get_types_from_msg(schema.data.decode(), name))
    read = store.deserialize_cdr if kind == "cdr" else store.deserialize_ros1
    return plain(read(data, name))


def plain(value):
    if hasattr(value, "__dataclass_fields__"):
        return {name: plain(getattr(value, name)) for name in value.__dataclass_fields__ if name != "__msgtype__"}
    return [plain(item) for item in value] if isinstance(value, list) else value


@pytest.mark.parametrize("encoding", ["cdr", "ros1", "json", "protobuf"])
def test_round_trip_of_boxes(encoding):
    entities = {entity["id"]: entity for entity in decoded(encoding)["entities"]}
    assert list(entities) == list(SCENE.groups)
    labels = entities["/points labels"]
    nanoseconds = labels["timestamp"].get("nanosec", labels["timestamp"].get("nsec"))
    assert labels["timestamp"]["sec"] * 10**9 + nanoseconds == STAMP_NS
    assert (labels["frame_id"], labels["frame_locked"]) == ("lidar", True)
    (cube,), (text,) = labels["cubes"], labels["texts"]
    assert cube["pose"]["position"] == {"x": 40, "y": -5, "z": 1}
    assert cube["size"] == {"x": 2, "y": 3, "z": 4}
    rotation = cube["pose"]["orientation"]
    assert 2 * math.atan2(rotation["z"], rotation["w"]) == pytest.approx(math.pi / 2)
    assert [round(255 * cube["color"][part]) for part in "rgb"] == [0x0B, 0x6B, 0x50]
    assert text["text"] == "buoy <1> é"
    assert text["pose"]["position"]["z"] > 3
    assert len(entities["/points clusters"]["cubes"]) == 2
    assert len(entities["/points clusters"]["texts"]) == 1
    assert entities["empty"]["cubes"] == []


@pytest.mark.parametrize(
    ("encoding", "name", "form"),
    [
        ("cdr", "foxglove_msgs/msg/SceneUpdate", "ros2msg"),
        ("ros1", "foxglove_msgs/SceneUpdate", "ros1msg"),
        ("protobuf", "foxglove.SceneUpdate", "jsonschema"),
    ],
)
def test_names_of_schemas(encoding, name, form):
    _, schema, _ = scene_format(encoding)
    assert (schema.name, schema.encoding) == (name, form)


def test_fields_match_the_published_schemas():
    update = pytest.importorskip(
        "foxglove_schemas_protobuf.SceneUpdate_pb2", reason="foxglove-schemas-protobuf is not installed"
    )
    compare(update.SceneUpdate.DESCRIPTOR)
    found = json.loads(scene_format("json")[1].data)
    entity = update.SceneUpdate.DESCRIPTOR.fields_by_name["entities"].message_type
    assert set(found["properties"]["entities"]["items"]["properties"]) == {field.name for field in entity.fields}


def compare(descriptor):
    """Compare the names and order of fields with the published ones, message by message."""
    if descriptor.name not in scenes._DEFINITIONS:
        return
    ours = [line.split()[-1] for line in scenes._DEFINITIONS[descriptor.name].splitlines()]
    assert ours == [field.name for field in descriptor.fields], descriptor.name
    for field in descriptor.fields:
        if field.message_type is not None:
            compare(field.message_type)


@pytest.mark.parametrize("stamp_ns", [-(10**19), 10**19])
def test_stamps_of_a_faulty_clock(stamp_ns):
    for encoding in ("cdr", "ros1", "json"):
        assert scene_format(encoding)[2](SceneUpdate(stamp_ns, "\udcff", {"\udcff": [WAVE]}).content)
