"""What a filter that keeps exactly the echoes of bodies would miss; simulated worlds ignore such targets."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.cloud import from_array
from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.evaluation.matching import finder_of, match_clusters, targets_of
from seaclutter_cli.frame import Frame
from seaclutter_cli.truth import CLUTTER, Boxes, Truth

EVALUATION = EvaluationParams()


def unseen(points: NDArray[Any], boxes: Boxes) -> set[str]:
    """Return the tracks of the targets that are missed if exactly the echoes of bodies are kept."""
    frame = Frame(from_array(np.ascontiguousarray(points[["x", "y", "z", "intensity"]]), stamp_ns=0), stamp_ns=0)
    boxes = boxes.chosen(np.flatnonzero(np.array(boxes.classes) != "ignore"))
    keep = points["label"] != CLUTTER
    targets = targets_of(frame, Truth(boxes), EVALUATION)
    clusters = finder_of(frame, [keep], EVALUATION).clusters(keep & frame.valid, EVALUATION.min_cluster_points)
    detected = match_clusters(clusters, targets, EVALUATION).detected
    return {track for track, found in zip(boxes.tracks, detected, strict=True) if not found}
