"""Filter methods: each assigns a `Reason` to every point of a frame."""

from collections.abc import Mapping

from seaclutter_cli.given import class_of
from seaclutter_cli.interfaces import Filter
from seaclutter_cli.registry import Registry


class _Methods(Registry[str, type[Filter]]):
    """Methods by their names; a `Method`, which a caller gives, has its own class."""

    def __getitem__(self, name: str) -> type[Filter]:
        kind: type[Filter] | None = getattr(name, "kind", None)
        return kind or super().__getitem__(name)

    def __contains__(self, name: object) -> bool:
        return hasattr(name, "kind") or super().__contains__(name)


_BUILT_IN: Mapping[str, type[Filter] | str] = {
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
"""Module and class of each filter method by its name in a configuration. A new method takes one line here."""

FILTERS = _Methods("filters", _BUILT_IN, lambda name, given: {name: class_of(given, name)})
"""Classes of the methods by name."""

OPTIONAL: Mapping[str, str] = {"patchwork": "pypatchworkpp"}
"""Package, part of the extra ``peers``, that a method needs."""
