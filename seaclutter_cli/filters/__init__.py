"""Filter methods: each assigns a `Reason` to every point of a frame."""

from collections.abc import Mapping

from seaclutter_cli.filters.adaptive_radius import AdaptiveRadius
from seaclutter_cli.filters.baselines import GlobalIntensity, Naive, Nothing
from seaclutter_cli.filters.confirmed import Confirmed
from seaclutter_cli.filters.joint import Joint, RingIntensity, RingIntensityOutlier
from seaclutter_cli.filters.radius import DynamicRadiusOutlierRemoval, LowIntensityOutlierRemoval, RadiusOutlierRemoval
from seaclutter_cli.filters.sea_surface import SeaSurface
from seaclutter_cli.filters.statistical import (
    DynamicStatisticalOutlierRemoval,
    LowIntensityDynamicStatisticalOutlierRemoval,
    StatisticalOutlierRemoval,
)
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
