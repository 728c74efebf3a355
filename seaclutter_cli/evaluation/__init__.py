"""Evaluation of filters by false alarms and missed targets; this module defines its parameters."""

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Gt


@dataclass(frozen=True, kw_only=True)
class EvaluationParams:
    """Parameters of clustering and matching.

    Parameters
    ----------
    cluster_tolerance_m : float
        Distance below which two points are connected, in metres; with clustering dbscan, bound included.
    min_cluster_points : int
        Minimum number of points in a cluster.
    clustering : {"euclidean", "dbscan"}
        Clustering method: euclidean (all points connect) or dbscan (only core points connect).
    dbscan_min_points : int
        Minimum number of points within cluster_tolerance_m of a core point, including itself; for clustering dbscan.
    box_margin_m : float
        Margin by which labelled boxes are enlarged on every side, in metres.
    min_visible_points : int
        Minimum number of raw points in its inflated box for a target to be visible.
    """

    cluster_tolerance_m: Annotated[float, Gt(0)] = 1.5
    min_cluster_points: Annotated[int, Ge(1)] = 5
    clustering: Literal["euclidean", "dbscan"] = "euclidean"
    dbscan_min_points: Annotated[int, Ge(1)] = 5
    box_margin_m: Annotated[float, Ge(0)] = 0.5
    min_visible_points: Annotated[int, Ge(1)] = 5
