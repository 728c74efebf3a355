"""Boxes and clusters of a filtered frame as a scene update, for players such as Foxglove."""

from collections.abc import Callable

from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.frame import FilterResult, Reason
from seaclutter_cli.interfaces import Labels
from seaclutter_cli.messages.scene import SceneBox, SceneUpdate
from seaclutter_cli.reporting import palette
from seaclutter_cli.reporting.objects import Described, find_objects
from seaclutter_cli.truth import Truth

_CLUSTERS = {
    "target": palette.STATES["detected"],
    "false": palette.STATES["false alarm"],
    "unknown": palette.TRUTH["clutter"],
    "unconfirmed": palette.REASONS[Reason.UNCONFIRMED],
}
_TEXTS = {"false": "false alarm", "unconfirmed": "unconfirmed"}
_BOXES = {
    "detected": palette.STATES["detected"],
    "missed": palette.STATES["missed target"],
    "hidden": palette.TRUTH["unknown"],
    "ignored": palette.TRUTH["unknown"],
}


def scene_maker(params: EvaluationParams, labels: Labels | None) -> Callable[[FilterResult], SceneUpdate]:
    """Return a function that makes the scene update of a filtered frame: clusters and, with labels, boxes."""

    def make(result: FilterResult) -> SceneUpdate:
        frame = result.frame
        found = boxes_of(result, labels.truth(frame) if labels else None, params)
        groups = {f"{frame.topic} {name}": boxes for name, boxes in found.items() if labels or name != "labels"}
        return SceneUpdate(frame.stamp_ns, frame.cloud.frame_id, groups)

    return make


def boxes_of(result: FilterResult, truth: Truth | None, params: EvaluationParams) -> dict[str, list[SceneBox]]:
    """Return the boxes of a filtered frame, those of its ``clusters`` and those of its ``labels``."""
    boxes, clusters = find_objects(result.frame, [result], truth, params)
    return {"clusters": [_cluster(one) for one in clusters[0]], "labels": [_box(one) for one in boxes]}


def _cluster(one: Described) -> SceneBox:
    sides = list(zip(one["low"], one["high"], strict=True))
    center, size = [(low + high) / 2 for low, high in sides], [high - low for low, high in sides]
    return SceneBox(center, size, 0.0, _CLUSTERS[one["kind"]], _TEXTS.get(one["kind"], ""))


def _box(one: Described) -> SceneBox:
    state = one["state"][0] if isinstance(one["state"], list) else one["state"]
    text = {"detected": one["class"], "missed": f"{one['class']} (missed)", "hidden": f"{one['class']} (not visible)"}
    return SceneBox(one["center"], one["size"], one["yaw"], _BOXES[state], text.get(state, ""))
