"""Parts of the method ``confirmed``: objects of a frame, their evidence, and tracks that collect it; its parameters."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Interval

from seaclutter_cli.filters.joint import RingIntensityParams
from seaclutter_cli.filters.zones import Auto
from seaclutter_cli.params import Count, NotNegative, Positive, key
from seaclutter_cli.water import Mounting


@dataclass(frozen=True, kw_only=True)
class ConfirmedParams(RingIntensityParams):
    """Parameters of confirmed objects. The range rings only provide thresholds.

    Points beyond ``end_m`` have no threshold. With far keep, they are filtered like the others.
    """

    start_m: NotNegative | Auto = key("auto")
    mounting_roll_deg: Annotated[float, Interval(ge=-180, le=180)] = key(
        0.0, "Roll of the mounted lidar in degrees; positive if its left side (+y) is up. 180 is upside down."
    )
    mounting_pitch_deg: Annotated[float, Interval(ge=-90, le=90)] = key(
        0.0, "Pitch of the mounted lidar in degrees, after the roll; positive if its front (+x) is down."
    )
    use_intensity: bool = key(
        True, "Use the thresholds; false: only shape and persistence count, and the log needs no intensities."
    )
    look_ahead_s: Annotated[float, Interval(ge=0, le=5)] = key(
        1.0,
        "Time after a frame whose evidence counts for its objects, in seconds; less where more than 1.5 million points "
        "would wait.",
    )
    causal: bool = key(
        False,
        "Confirm objects without later frames. Objects of clear shape are then kept at once, even if they do not stay; "
        "others are kept later.",
    )
    min_rise_m: Positive = key(0.2, "Minimum height above the water at which points stand out, in metres.")
    rise_sigmas: NotNegative = key(
        4.0, "Height above the water at which points stand out, in standard deviations of the water."
    )
    cluster_tolerance_m: Positive = key(1.5, "Distance below which points belong to one object, in metres.")
    min_cluster_points: Count = key(3, "Minimum number of points of an object.")
    score_threshold: Annotated[float, Interval(ge=-4, le=6)] = key(
        0.0, "Score above which an object is confirmed: the logarithm of the odds that it is a target."
    )
    memory_s: Positive = key(5.0, "Time in which the evidence of earlier frames decays to 1/e, in seconds.")
    growth_m: NotNegative = key(
        1.0,
        "Distance within which points above the water return to a confirmed object, in metres; 1 % of the range is "
        "added.",
    )
    growth_height_m: NotNegative = key(0.15, "Minimum height above the water of points that return, in metres.")

    @property
    def mounting(self) -> Mounting:
        """Attitude in which the lidar is mounted."""
        return Mounting(self.mounting_roll_deg, self.mounting_pitch_deg)
