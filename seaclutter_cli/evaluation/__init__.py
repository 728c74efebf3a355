"""Evaluation of filters by false alarms and missed targets; this module defines its parameters."""

from dataclasses import dataclass
from typing import Literal

from seaclutter_cli.params import Count, NotNegative, Positive, key

IDEAL = "ideal"
"""Name of an imagined method that keeps exactly the points of targets: what it misses, no filter could find."""


@dataclass(frozen=True, kw_only=True)
class EvaluationParams:
    """Parameters of clustering and matching."""

    cluster_tolerance_m: Positive = key(
        1.5, "Distance below which two points are connected, in metres; with clustering dbscan, bound included."
    )
    min_cluster_points: Count = key(5, "Minimum number of points in a cluster.")
    clustering: Literal["euclidean", "dbscan"] = key(
        "euclidean", "Clustering method: euclidean (all points connect) or dbscan (only core points connect)."
    )
    dbscan_min_points: Count = key(
        5,
        "Minimum number of points within cluster_tolerance_m of a core point, including itself; for clustering dbscan.",
    )
    box_margin_m: NotNegative = key(0.5, "Margin by which labelled boxes are enlarged on every side, in metres.")
    min_visible_points: Count = key(5, "Minimum number of raw points in its inflated box for a target to be visible.")
