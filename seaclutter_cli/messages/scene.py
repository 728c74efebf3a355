"""Boxes of objects: ``foxglove.SceneUpdate`` shows them in a 3D panel, ``vision_msgs/Detection3DArray`` rates them."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np

from seaclutter_cli.messages.definitions import Content, Time, companion_format, make_typestore
from seaclutter_cli.records import Schema

SCENE_TOPIC, OBJECTS_TOPIC = "/seaclutter/scene", "/seaclutter/objects"
_DEFINITIONS = {
    "Color": "float64 r\nfloat64 g\nfloat64 b\nfloat64 a",
    "KeyValuePair": "string key\nstring value",
    "SceneEntityDeletion": "builtin_interfaces/Time timestamp\nuint8 type\nstring id",
    "ArrowPrimitive": "geometry_msgs/Pose pose\nfloat64 shaft_length\nfloat64 shaft_diameter\nfloat64 head_length\n"
    "float64 head_diameter\nfoxglove_msgs/Color color",
    "CubePrimitive": "geometry_msgs/Pose pose\ngeometry_msgs/Vector3 size\nfoxglove_msgs/Color color",
    "SpherePrimitive": "geometry_msgs/Pose pose\ngeometry_msgs/Vector3 size\nfoxglove_msgs/Color color",
    "CylinderPrimitive": "geometry_msgs/Pose pose\ngeometry_msgs/Vector3 size\nfloat64 bottom_scale\n"
    "float64 top_scale\nfoxglove_msgs/Color color",
    "LinePrimitive": "uint8 type\ngeometry_msgs/Pose pose\nfloat64 thickness\nbool scale_invariant\n"
    "geometry_msgs/Point[] points\nfoxglove_msgs/Color color\nfoxglove_msgs/Color[] colors\nuint32[] indices",
    "TriangleListPrimitive": "geometry_msgs/Pose pose\ngeometry_msgs/Point[] points\nfoxglove_msgs/Color color\n"
    "foxglove_msgs/Color[] colors\nuint32[] indices",
    "TextPrimitive": "geometry_msgs/Pose pose\nbool billboard\nfloat64 font_size\nbool scale_invariant\n"
    "foxglove_msgs/Color color\nstring text",
    "ModelPrimitive": "geometry_msgs/Pose pose\ngeometry_msgs/Vector3 scale\nfoxglove_msgs/Color color\n"
    "bool override_color\nstring url\nstring media_type\nuint8[] data",
    "SceneEntity": "builtin_interfaces/Time timestamp\nstring frame_id\nstring id\n"
    "builtin_interfaces/Duration lifetime\nbool frame_locked\nfoxglove_msgs/KeyValuePair[] metadata\n"
    "foxglove_msgs/ArrowPrimitive[] arrows\nfoxglove_msgs/CubePrimitive[] cubes\n"
    "foxglove_msgs/SpherePrimitive[] spheres\nfoxglove_msgs/CylinderPrimitive[] cylinders\n"
    "foxglove_msgs/LinePrimitive[] lines\nfoxglove_msgs/TriangleListPrimitive[] triangles\n"
    "foxglove_msgs/TextPrimitive[] texts\nfoxglove_msgs/ModelPrimitive[] models",
    "SceneUpdate": "foxglove_msgs/SceneEntityDeletion[] deletions\nfoxglove_msgs/SceneEntity[] entities",
}
_VISION_DEFINITIONS = {
    "ObjectHypothesis": "string class_id\nfloat64 score",
    "ObjectHypothesisWithPose": "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose",
    "BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size",
    "Detection3D": "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
    "vision_msgs/BoundingBox3D bbox\nstring id",
    "Detection3DArray": "std_msgs/Header header\nvision_msgs/Detection3D[] detections",
}
"""Of version 4 of vision_msgs; that of ROS 1 has other fields."""
_MATCHING_ID = 0
_PRIMITIVES = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")


@dataclass(frozen=True)
class SceneBox:
    """A box: centre, size along its own axes in metres, yaw around +z in radians, colour such as ``#14213d``, label."""

    center: Sequence[float]
    size: Sequence[float]
    yaw: float
    color: str
    text: str = ""


@dataclass(frozen=True)
class SceneTrack:
    """An object with its name, state, score, box, and velocity along x and y in metres per second."""

    name: str
    state: str
    score: float
    box: SceneBox
    velocity: tuple[float, float]


@dataclass(frozen=True)
class SceneUpdate:
    """Boxes of one frame by groups, which replace those of the previous frame; an empty group removes its boxes.

    ``tracks`` by the id of their entities replace those of these ids; ``gone`` are ids of entities to delete.
    """

    stamp_ns: int
    frame_id: str
    groups: Mapping[str, Sequence[SceneBox]]
    tracks: Mapping[str, SceneTrack] = field(default_factory=dict)
    gone: Sequence[str] = ()

    @property
    def content(self) -> Content:
        """Values of the fields of the message."""
        boxes = [self._entity(name, boxes) for name, boxes in self.groups.items()]
        tracks = [self._entity(name, [track.box], track) for name, track in self.tracks.items()]
        gone = [{"timestamp": Time(self.stamp_ns), "type": _MATCHING_ID, "id": name} for name in self.gone]
        return {"deletions": gone, "entities": boxes + tracks}

    def _entity(self, name: str, boxes: Sequence[SceneBox], track: SceneTrack | None = None) -> dict[str, Any]:
        return {
            "timestamp": Time(self.stamp_ns),
            "frame_id": self.frame_id.encode(errors="replace").decode(),
            "id": name.encode(errors="replace").decode(),
            "lifetime": Time(0),
            "frame_locked": True,
            "metadata": _metadata(track) if track else [],
            **{kind: [] for kind in _PRIMITIVES},
            "arrows": [_arrow(track)] if track and any(track.velocity) else [],
            "cubes": [{"pose": _pose(box), "size": _xyz(box.size), "color": _color(box.color, 0.3)} for box in boxes],
            "texts": [_text(box) for box in boxes if box.text],
        }


def detections(stamp_ns: int, frame_id: str, objects: Sequence[SceneTrack]) -> Content:
    """Return values of the fields of a ``vision_msgs/Detection3DArray`` with the objects of one frame."""
    head = {"stamp": Time(stamp_ns), "frame_id": frame_id.encode(errors="replace").decode()}
    return {"header": head, "detections": [_detection(one, head) for one in objects]}


def scene_format(cloud_encoding: str) -> tuple[str, Schema, Callable[[Content], bytes]]:
    """Return the message encoding, schema and serialiser for a log, given the encoding of its clouds."""
    return companion_format(cloud_encoding, "foxglove_msgs/msg/SceneUpdate", _typestore, _scene_schema)


def detections_format(cloud_encoding: str) -> tuple[str, Schema, Callable[[Content], bytes]]:
    """Return what `scene_format` returns, for the objects of a frame."""
    return companion_format(cloud_encoding, "vision_msgs/msg/Detection3DArray", _typestore, _detections_schema)


@cache
def _typestore() -> Any:
    packages = ("foxglove_msgs", _DEFINITIONS), ("vision_msgs", _VISION_DEFINITIONS)
    return make_typestore({f"{name}/msg/{kind}": f"{text}\n" for name, own in packages for kind, text in own.items()})


def _pose(box: SceneBox) -> dict[str, Any]:
    rotation = {"x": 0.0, "y": 0.0, "z": math.sin(box.yaw / 2), "w": math.cos(box.yaw / 2)}
    return {"position": _xyz(box.center), "orientation": rotation}


def _arrow(track: SceneTrack) -> dict[str, Any]:
    """Return an arrow as long as the way of one second."""
    speed = math.hypot(*track.velocity)
    course = SceneBox(track.box.center, (), math.atan2(track.velocity[1], track.velocity[0]), track.box.color)
    shape = {"shaft_length": 0.8 * speed, "shaft_diameter": 0.2, "head_length": 0.2 * speed, "head_diameter": 0.4}
    return {"pose": _pose(course), **shape, "color": _color(track.box.color, 1.0)}


def _metadata(track: SceneTrack) -> list[dict[str, str]]:
    values = {
        "id": track.name,
        "state": track.state,
        "score": f"{track.score:.3f}",
        "vx_ms": f"{track.velocity[0]:.3f}",
        "vy_ms": f"{track.velocity[1]:.3f}",
    }
    return [{"key": key, "value": value} for key, value in values.items()]


def _text(box: SceneBox) -> dict[str, Any]:
    x, y, z = box.center
    above = replace(box, center=(x, y, z + box.size[2] / 2 + 1), yaw=0.0)
    style = {"billboard": True, "font_size": 14.0, "scale_invariant": True, "color": _color(box.color, 1.0)}
    return {"pose": _pose(above), **style, "text": box.text.encode(errors="replace").decode()}


def _xyz(values: Sequence[float]) -> dict[str, float]:
    return dict(zip("xyz", map(float, values), strict=True))


def _detection(one: SceneTrack, head: Mapping[str, Any]) -> dict[str, Any]:
    pose = _pose(one.box)
    hypothesis = {"class_id": one.state, "score": float(one.score)}
    result = {"hypothesis": hypothesis, "pose": {"pose": pose, "covariance": np.zeros(36)}}
    return {"header": head, "results": [result], "bbox": {"center": pose, "size": _xyz(one.box.size)}, "id": one.name}


def _color(color: str, opacity: float) -> dict[str, float]:
    parts = (int(color[start : start + 2], 16) / 255 for start in (1, 3, 5))
    return dict(zip("rgba", (*parts, opacity), strict=True))


def _scene_schema() -> Content:
    """Return the JSON schema of the fields in use; players know the others by the name of the schema."""
    number, text = {"type": "number"}, {"type": "string"}
    vector = {"type": "object", "properties": dict.fromkeys("xyz", number)}
    rotation = {"type": "object", "properties": dict.fromkeys("xyzw", number)}
    pose = {"type": "object", "properties": {"position": vector, "orientation": rotation}}
    color = {"type": "object", "properties": dict.fromkeys("rgba", number)}
    time = {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
    style = {"billboard": {"type": "boolean"}, "font_size": number, "scale_invariant": {"type": "boolean"}}
    cube = {"type": "object", "properties": {"pose": pose, "size": vector, "color": color}}
    label = {"type": "object", "properties": {"pose": pose, **style, "color": color, "text": text}}
    anything = {"type": "array", "items": {"type": "object"}}
    lists = {**dict.fromkeys(_PRIMITIVES, anything), "cubes": _list_of(cube), "texts": _list_of(label)}
    heads = {"timestamp": {**time, "title": "time"}, "frame_id": text, "id": text}
    rest = {"lifetime": {**time, "title": "duration"}, "frame_locked": {"type": "boolean"}, "metadata": anything}
    entity = {"type": "object", "properties": {**heads, **rest, **lists}}
    properties = {"deletions": anything, "entities": _list_of(entity)}
    return {"title": "foxglove.SceneUpdate", "type": "object", "properties": properties}


def _list_of(items: dict[str, Any]) -> dict[str, Any]:
    return {"type": "array", "items": items}


def _detections_schema() -> Content:
    anything = {"type": "array", "items": {"type": "object"}}
    properties = {"header": {"type": "object"}, "detections": anything}
    return {"title": "vision_msgs.Detection3DArray", "type": "object", "properties": properties}
