"""Methods to compare, and ablations of the method ``confirmed``."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.config import load_config
from seaclutter_cli.evaluation import IDEAL
from seaclutter_cli.filters import FILTERS, confirmed
from seaclutter_cli.filters.confirmation.echoes import Heights, Sea
from seaclutter_cli.filters.confirmation.objects import DetectedObject, find_objects
from seaclutter_cli.filters.confirmation.tracks import Track, Tracker
from seaclutter_cli.filters.joint import RingIntensityParams
from seaclutter_cli.filters.radius import PresetParams
from seaclutter_cli.interfaces import Filter
from seaclutter_cli.water import WaterSurface

Floats = NDArray[np.float64]

PAPER, CALIBRATED, UNUSED = "paper", "calibrated", "unused"


@dataclass(frozen=True)
class Variant:
    """A method with its settings.

    Parameters
    ----------
    name : str
        Name in tables.
    method : str
        Name of the method, or `IDEAL`.
    settings : mapping of str to object
        Config keys that differ from the defaults.
    thresholds : {"paper", "calibrated", "unused"}
        Which thresholds of the range rings it uses.
    ablation : str or None
        Name of the part that is taken out of the method, a key of `ABLATIONS`.
    """

    name: str
    method: str
    settings: Mapping[str, Any] = field(default_factory=dict, hash=False)
    thresholds: str = CALIBRATED
    ablation: str | None = None

    def make_filter(self, thresholds: Sequence[float], scene_class: str | None) -> Filter:
        """Return a new filter.

        Parameters
        ----------
        thresholds : sequence of float
            Calibrated thresholds of the range rings.
        scene_class : str or None
            Class of the scene, which decides on the preset of the adaptive radius filter.
        """
        keys: dict[str, Any] = {"method": self.method, **self.settings}
        if self.thresholds == CALIBRATED:
            keys["initial_thresholds"] = list(thresholds)
        if scene_class and issubclass(FILTERS[self.method].Params, PresetParams):
            keys["scene"] = scene_class
        return load_config({"filter": keys}).make_filter()


def of_method(method: str, thresholds: str) -> Variant:
    """Return a method with its defaults and the given thresholds of the range rings, where it has any."""
    has_rings = issubclass(FILTERS[method].Params, RingIntensityParams)
    return Variant(method, method, thresholds=thresholds if has_rings else UNUSED)


def all_methods() -> tuple[Variant, ...]:
    """Return all methods with the thresholds of the paper, and those that have thresholds also with calibrated ones."""
    variants = [of_method(method, thresholds) for thresholds in (PAPER, CALIBRATED) for method in FILTERS]
    return *dict.fromkeys(variants), Variant(IDEAL, IDEAL, thresholds=UNUSED)


def some_methods(*methods: str) -> tuple[Variant, ...]:
    """Return some methods with calibrated thresholds, and the ideal one."""
    return *(of_method(method, CALIBRATED) for method in methods), Variant(IDEAL, IDEAL, thresholds=UNUSED)


def _frame_alone(_: Tracker, track: Track, time_s: float) -> float:
    """Score the evidence of the frame itself."""
    return sum(item.evidence for item in track.history if item.time_s == time_s)


_measure = Sea.measure


def _without_heights(*arguments: Any) -> Heights:
    """Measure brightness, and no heights."""
    heights = _measure(*arguments)
    nothing = np.zeros_like(heights.high)
    return replace(heights, high=nothing, upright=nothing, grows=nothing, bright=heights.brightness >= 1)


def _equal_objects(*arguments: Any, **options: Any) -> list[DetectedObject]:
    """Find objects whose shapes say nothing: each may be a target."""
    return [replace(one, evidence=1.0) for one in find_objects(*arguments, **options)]


_above = WaterSurface.above


def _above_plane(water: WaterSurface, x: Floats, y: Floats, z: Floats) -> tuple[Floats, Floats, Floats]:
    """Measure heights above the mean plane, with the deviation of the water around it."""
    return z - water.plane.height(x, y), np.full(len(z), water.sigma_m), _above(water, x, y, z)[2]


@contextmanager
def _no_persistence() -> Iterator[None]:
    with patch.object(Tracker, "score", _frame_alone):
        yield


@contextmanager
def _no_height() -> Iterator[None]:
    with patch.object(Sea, "measure", _without_heights), patch.object(confirmed, "find_objects", _equal_objects):
        yield


@contextmanager
def _plane_only() -> Iterator[None]:
    with patch.object(WaterSurface, "above", _above_plane):
        yield


ABLATIONS: Mapping[str, Callable[[], Any]] = {
    "persistence": _no_persistence,
    "height": _no_height,
    "swell": _plane_only,
}
"""Context managers in which the method ``confirmed`` lacks a part, by the name of the part."""


def ablations() -> tuple[Variant, ...]:
    """Return the method ``confirmed`` as it is and without its parts, with the thresholds of the paper."""

    def without(name: str, part: str | None = None, **settings: Any) -> Variant:
        return Variant(name, "confirmed", settings, PAPER, part)

    return (
        without("as it is"),
        without("no persistence: each frame alone", "persistence"),
        without("no persistence, threshold 0.2", "persistence", score_threshold=0.2),
        without("no persistence, threshold 0.6", "persistence", score_threshold=0.6),
        without("no memory: only ± 0.5 s", memory_s=1e-3),
        without("causal", causal=True),
        without("no height: bright clusters that persist", "height"),
        without("plane only, no swell", "swell"),
        without("no intensity", use_intensity=False),
        without("no growth", growth_height_m=1e3),
    )
