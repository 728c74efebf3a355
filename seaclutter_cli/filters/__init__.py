"""Filter methods: each assigns a `Reason` to every point of a frame."""

from collections.abc import Iterator, Mapping
from importlib import import_module

from seaclutter_cli.interfaces import Filter


class _Methods(Mapping[str, type[Filter]]):
    """Filter methods by their names; the module of a method is imported when the method is looked up."""

    def __init__(self, classes: Mapping[str, str]) -> None:
        self._classes = classes

    def __getitem__(self, name: str) -> type[Filter]:
        module, kind = self._classes[name].split(".")
        method: type[Filter] = getattr(import_module(f"seaclutter_cli.filters.{module}"), kind)
        return method

    def __contains__(self, name: object) -> bool:
        return name in self._classes

    def __iter__(self) -> Iterator[str]:
        return iter(self._classes)

    def __len__(self) -> int:
        return len(self._classes)


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
        "none": "baselines.Nothing",
    }
)
"""Module and class of each filter method by its name in a configuration. A new method takes one line here."""
