"""``vision_msgs/Detection3DArray`` messages: boxes of objects with their ids and scores."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from seaclutter_cli.messages.companion import Content, Time, companion_format
from seaclutter_cli.messages.definitions import make_typestore
from seaclutter_cli.messages.scene import SceneTrack, pose_of, vector
from seaclutter_cli.records import Schema

TOPIC = "/seaclutter/objects"
_TYPE = "vision_msgs/msg/Detection3DArray"
_DEFINITIONS = {
    "ObjectHypothesis": "string class_id\nfloat64 score",
    "ObjectHypothesisWithPose": "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose",
    "BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size",
    "Detection3D": "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
    "vision_msgs/BoundingBox3D bbox\nstring id",
    "Detection3DArray": "std_msgs/Header header\nvision_msgs/Detection3D[] detections",
}
"""Of version 4 of vision_msgs; that of ROS 1 has other fields."""


@dataclass(frozen=True)
class Detections3D:
    """Objects of one frame."""

    stamp_ns: int
    frame_id: str
    objects: Sequence[SceneTrack]

    @property
    def content(self) -> Content:
        """Values of the fields of the message."""
        head = {"stamp": Time(self.stamp_ns), "frame_id": self.frame_id.encode(errors="replace").decode()}
        return {"header": head, "detections": [_detection(one, head) for one in self.objects]}


def detections_format(cloud_encoding: str) -> tuple[str, Schema, Callable[[Content], bytes]]:
    """Return the message encoding, schema and serialiser for a log, given the encoding of its clouds."""
    return companion_format(cloud_encoding, _TYPE, _typestore, _json_schema)


@cache
def _typestore() -> Any:
    return make_typestore({f"vision_msgs/msg/{name}": f"{text}\n" for name, text in _DEFINITIONS.items()})


def _detection(one: SceneTrack, head: Mapping[str, Any]) -> dict[str, Any]:
    pose = pose_of(one.box)
    hypothesis = {"class_id": one.state, "score": float(one.score)}
    result = {"hypothesis": hypothesis, "pose": {"pose": pose, "covariance": np.zeros(36)}}
    return {"header": head, "results": [result], "bbox": {"center": pose, "size": vector(one.box.size)}, "id": one.name}


def _json_schema() -> Content:
    """Return the JSON schema of the outermost fields."""
    anything = {"type": "array", "items": {"type": "object"}}
    properties = {"header": {"type": "object"}, "detections": anything}
    return {"title": "vision_msgs.Detection3DArray", "type": "object", "properties": properties}
