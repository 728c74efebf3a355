"""Parameters of the joint filter, and of the two of its stages that are also separate methods."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Interval, Len
from numpy.typing import NDArray

from seaclutter_cli.filters.adaptive_radius import Preset
from seaclutter_cli.filters.zones import ZoneParams, ring_edges


@dataclass(frozen=True, kw_only=True)
class RingIntensityParams(ZoneParams):
    """Parameters of the thresholds of the range rings.

    Parameters
    ----------
    ring_width_m : float
        Width of a range ring, :math:`d`, in metres.
    initial_thresholds : tuple of float
        Initial intensity threshold of each range ring, :math:`I_0`, in the sensor's unit; the default is for the
        RS-LiDAR-32 (Table 2 of [Li2023]).
    """

    ring_width_m: Annotated[float, Gt(0)] = 15.0
    initial_thresholds: Annotated[tuple[float, ...], Len(1)] = (30, 16, 7, 4)

    @property
    def edges(self) -> NDArray[np.float64]:
        """Edges of the range rings in metres, shape (K + 1,)."""
        return ring_edges(self.start_m, self.end_m, self.ring_width_m)

    def __post_init__(self) -> None:
        """Check that there is one threshold for each range ring."""
        super().__post_init__()
        rings = len(self.edges) - 1
        if len(self.initial_thresholds) != rings:
            span = f"{self.start_m:g} to {self.end_m:g} m in range rings of {self.ring_width_m:g} m"
            raise ValueError(f"initial_thresholds: expected {rings} ({span}), got {len(self.initial_thresholds)}")


@dataclass(frozen=True, kw_only=True)
class RingIntensityOutlierParams(RingIntensityParams):
    """Parameters of the thresholds of the range rings and of the outlier stage.

    Parameters
    ----------
    max_neighbors : int
        Maximum number of neighbours in a point's mean distance, n; for outlier_stage sor.
    neighbor_fraction : float
        Share of a range ring's remaining points that count as neighbours, up to max_neighbors; for outlier_stage sor.
    std_ratio : float
        Standard deviations above the mean distance beyond which a point is an outlier; for outlier_stage sor.
    outlier_stage : {"sor", "adaptive_radius"}
        Outlier rule: sor (mean distance to neighbours) or adaptive_radius (neighbours within a share of the range).
    outlier_radius_ratio : float or None
        Search radius divided by range, K; 0.025 if null; for outlier_stage adaptive_radius.
    outlier_min_neighbors : int or None
        Minimum number of other points within the search radius, N; 7 if null; for outlier_stage adaptive_radius.
    """

    max_neighbors: Annotated[int, Ge(1)] = 30
    neighbor_fraction: Annotated[float, Interval(gt=0, le=1)] = 0.1
    std_ratio: Annotated[float, Ge(0)] = 1.0
    outlier_stage: Literal["sor", "adaptive_radius"] = "sor"
    outlier_radius_ratio: Annotated[float, Gt(0)] | None = None
    outlier_min_neighbors: Annotated[int, Ge(1)] | None = None

    def __post_init__(self) -> None:
        """Reject keys that belong to the other outlier rule, and set the defaults of this one."""
        super().__post_init__()
        if self.outlier_preset is not None:
            for name, value in vars(self.outlier_preset).items():
                object.__setattr__(self, f"outlier_{name}", value)
            return
        for name in ("outlier_radius_ratio", "outlier_min_neighbors"):
            if getattr(self, name) is not None:
                raise ValueError(f"{name}: valid only with outlier_stage adaptive_radius")

    @property
    def outlier_preset(self) -> Preset | None:
        """K and N for outlier_stage ``adaptive_radius``; None for ``sor``."""
        if self.outlier_stage == "sor":
            return None
        # More permissive than the adaptive radius filter, because the thresholds have already thinned out the points.
        ratio, needed = self.outlier_radius_ratio, self.outlier_min_neighbors
        return Preset(radius_ratio=0.025 if ratio is None else ratio, min_neighbors=7 if needed is None else needed)


@dataclass(frozen=True, kw_only=True)
class JointParams(RingIntensityOutlierParams):
    """Parameters of the joint filter.

    Parameters
    ----------
    update_weight : float
        Weight of the initial threshold against the correction, u, from 0 to 1; 1 disables the correction.
    """

    update_weight: Annotated[float, Interval(ge=0, le=1)] = 0.6
