"""How well a filter does: false and omitted alarms. The parameters of it, which configurations hold."""

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Gt


@dataclass(frozen=True, kw_only=True)
class EvaluationParams:
    """Clustering and matching.

    Parameters
    ----------
    cluster_tolerance_m : float
        Points closer than this belong to one cluster.
    min_cluster_points : int
        Points that make a cluster.
    clustering : {"euclidean", "dbscan"}
        Kind of clusters: whatever hangs together, or what hangs together by core points.
    dbscan_min_points : int
        Points up to the tolerance away, itself included, that make a core point; of dbscan only.
    box_margin_m : float
        Growth of label boxes on every side.
    min_visible_points : int
        Raw points in its grown box that make a target visible.
    """

    cluster_tolerance_m: Annotated[float, Gt(0)] = 1.5
    min_cluster_points: Annotated[int, Ge(1)] = 5
    clustering: Literal["euclidean", "dbscan"] = "euclidean"
    dbscan_min_points: Annotated[int, Ge(1)] = 5
    box_margin_m: Annotated[float, Ge(0)] = 0.5
    min_visible_points: Annotated[int, Ge(1)] = 5
