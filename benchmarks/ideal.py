"""What a filter that keeps exactly the echoes of bodies would miss; simulated worlds ignore such targets."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.cloud import from_array
from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.evaluation.matching import FrameTargets, finder_of, match_clusters, targets_of
from seaclutter_cli.frame import Frame
from seaclutter_cli.truth import CLUTTER, Boxes, Truth

EVALUATION = EvaluationParams()


def detected(frame: Frame, targets: FrameTargets, keep: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which targets are detected if only some points are kept, shape (N,)."""
    clusters = finder_of(frame, [keep], EVALUATION).clusters(keep & frame.valid, EVALUATION.min_cluster_points)
    return match_clusters(clusters, targets, EVALUATION).detected


def unseen(points: NDArray[Any], boxes: Boxes) -> set[str]:
    """Return the tracks of the targets that are missed if exactly the echoes of bodies are kept."""
    frame = Frame(from_array(np.ascontiguousarray(points[["x", "y", "z", "intensity"]]), stamp_ns=0), stamp_ns=0)
    boxes = boxes.chosen(np.flatnonzero(np.array(boxes.classes) != "ignore"))
    keep = points["label"] != CLUTTER
    found = detected(frame, targets_of(frame, Truth(boxes), EVALUATION), keep)
    return {track for track, one in zip(boxes.tracks, found, strict=True) if not one}
