"""Filter methods: each assigns a `Reason` to every point of a frame."""

from collections.abc import Mapping

from seaclutter_cli.filters.adaptive_radius import AdaptiveRadius
from seaclutter_cli.filters.confirmed import Confirmed
from seaclutter_cli.filters.dynamic_radius import DynamicRadiusOutlierRemoval
from seaclutter_cli.filters.dynamic_statistical import (
    DynamicStatisticalOutlierRemoval,
    LowIntensityDynamicStatisticalOutlierRemoval,
)
from seaclutter_cli.filters.global_intensity import GlobalIntensity
from seaclutter_cli.filters.joint import Joint, RingIntensity, RingIntensityOutlier
from seaclutter_cli.filters.low_intensity import LowIntensityOutlierRemoval, Naive
from seaclutter_cli.filters.nothing import Nothing
from seaclutter_cli.filters.radius import RadiusOutlierRemoval
from seaclutter_cli.filters.sea_surface import SeaSurface
from seaclutter_cli.filters.statistical import StatisticalOutlierRemoval
from seaclutter_cli.interfaces import Filter

FILTERS: Mapping[str, type[Filter]] = {
    "joint": Joint,
    "confirmed": Confirmed,
    "ring_intensity": RingIntensity,
    "ring_intensity_outlier": RingIntensityOutlier,
    "global_intensity": GlobalIntensity,
    "sor": StatisticalOutlierRemoval,
    "ror": RadiusOutlierRemoval,
    "dror": DynamicRadiusOutlierRemoval,
    "adaptive_radius": AdaptiveRadius,
    "dsor": DynamicStatisticalOutlierRemoval,
    "lior": LowIntensityOutlierRemoval,
    "lidsor": LowIntensityDynamicStatisticalOutlierRemoval,
    "naive": Naive,
    "sea_surface": SeaSurface,
    "none": Nothing,
}
"""Filter methods by their name in a configuration. A new method takes one line here."""
