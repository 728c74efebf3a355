"""Parameters of the joint method and of the two stages of it that are methods of their own."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Interval, Len
from numpy.typing import NDArray

from seaclutter_cli.filters.adaptive_radius import Preset
from seaclutter_cli.filters.zones import ZoneParams, ring_edges


@dataclass(frozen=True, kw_only=True)
class RingIntensityParams(ZoneParams):
    """Ring thresholds.

    Parameters
    ----------
    ring_width_m : float
        Width of a ring, :math:`d`.
    initial_thresholds : tuple of float
        :math:`I_0`, one per ring, in the sensor's own intensity unit. The default is Table 2, for RS-LiDAR-32.
    """

    ring_width_m: Annotated[float, Gt(0)] = 15.0
    initial_thresholds: Annotated[tuple[float, ...], Len(1)] = (30, 16, 7, 4)

    @property
    def edges(self) -> NDArray[np.float64]:
        """Edges of the rings in metres, shape (K + 1,)."""
        return ring_edges(self.start_m, self.end_m, self.ring_width_m)

    def __post_init__(self) -> None:
        """Check that there is a threshold for each ring."""
        super().__post_init__()
        rings = len(self.edges) - 1
        if len(self.initial_thresholds) != rings:
            span = f"{self.start_m:g} to {self.end_m:g} m in rings of {self.ring_width_m:g} m"
            raise ValueError(f"initial_thresholds has {len(self.initial_thresholds)} values, {span} need {rings}")


@dataclass(frozen=True, kw_only=True)
class RingIntensityOutlierParams(RingIntensityParams):
    """Ring thresholds and the search for outliers.

    Parameters
    ----------
    max_neighbors : int
        Upper bound of n, the neighbours that count.
    neighbor_fraction : float
        Share of a ring's points that count as neighbours below that bound.
    std_ratio : float
        Standard deviations above the mean at which a point is an outlier.
    outlier_stage : {"sor", "adaptive_radius"}
        Rule for outliers: the three keys above, or a radius that grows with range: the two keys below.
    outlier_radius_ratio : float or None
        Search radius by range, K; 0.025 if nothing is said.
    outlier_min_neighbors : int or None
        Other points that are needed within it, N; 7 if nothing is said.
    """

    max_neighbors: Annotated[int, Ge(1)] = 30
    neighbor_fraction: Annotated[float, Interval(gt=0, le=1)] = 0.1
    std_ratio: Annotated[float, Ge(0)] = 1.0
    outlier_stage: Literal["sor", "adaptive_radius"] = "sor"
    outlier_radius_ratio: Annotated[float, Gt(0)] | None = None
    outlier_min_neighbors: Annotated[int, Ge(1)] | None = None

    def __post_init__(self) -> None:
        """Check that what goes with one rule is not given for the other, and fill in what is not given."""
        super().__post_init__()
        if self.outlier_preset is not None:
            for name, value in vars(self.outlier_preset).items():
                object.__setattr__(self, f"outlier_{name}", value)
            return
        for name in ("outlier_radius_ratio", "outlier_min_neighbors"):
            if getattr(self, name) is not None:
                raise ValueError(f"{name}: belongs to outlier_stage adaptive_radius, not to sor")

    @property
    def outlier_preset(self) -> Preset | None:
        """K and N of the stage ``adaptive_radius``; None for the other one."""
        if self.outlier_stage == "sor":
            return None
        # A wider net than the adaptive radius filter has: thresholds have thinned the points out.
        ratio, needed = self.outlier_radius_ratio, self.outlier_min_neighbors
        return Preset(radius_ratio=0.025 if ratio is None else ratio, min_neighbors=7 if needed is None else needed)


@dataclass(frozen=True, kw_only=True)
class JointParams(RingIntensityOutlierParams):
    """All of the joint method.

    Parameters
    ----------
    update_weight : float
        Weight u of the initial threshold against the correction; 1 means no correction.
    """

    update_weight: Annotated[float, Interval(ge=0, le=1)] = 0.6
