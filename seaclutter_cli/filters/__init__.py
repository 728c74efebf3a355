"""Filter methods: each assigns a `Reason` to every point of a frame."""

from collections import UserDict
from collections.abc import Mapping
from importlib import import_module
from typing import Any

from seaclutter_cli.interfaces import Filter


class _Methods(UserDict[str, Any]):
    """Filter methods by their names; the module of a method is imported when the method is looked up."""

    def __getitem__(self, name: str) -> type[Filter]:
        module, kind = self.data[name].split(".")
        method: type[Filter] = getattr(import_module(f"seaclutter_cli.filters.{module}"), kind)
        return method


FILTERS: Mapping[str, type[Filter]] = _Methods(
    {
        "joint": "joint.Joint",
        "confirmed": "confirmed.Confirmed",
        "ring_intensity": "joint.RingIntensity",
        "ring_intensity_outlier": "joint.RingIntensityOutlier",
        "global_intensity": "baselines.GlobalIntensity",
        "sor": "statistical.StatisticalOutlierRemoval",
        "ror": "radius.RadiusOutlierRemoval",
        "dror": "radius.DynamicRadiusOutlierRemoval",
        "adaptive_radius": "radius.AdaptiveRadius",
        "dsor": "statistical.DynamicStatisticalOutlierRemoval",
        "lior": "radius.LowIntensityOutlierRemoval",
        "lidsor": "statistical.LowIntensityDynamicStatisticalOutlierRemoval",
        "naive": "baselines.Naive",
        "sea_surface": "sea_surface.SeaSurface",
        "patchwork": "patchwork.Patchwork",
        "none": "baselines.Nothing",
    }
)
"""Module and class of each filter method by its name in a configuration. A new method takes one line here."""

OPTIONAL: Mapping[str, str] = {"patchwork": "pypatchworkpp"}
"""Package, part of the extra ``peers``, that a method needs."""
