"""The evidence that an object is a target: one curve for each feature of its shape, and of its track."""

import math
from functools import cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.documents import load_json

Floats = NDArray[np.float64]

FEATURES = (
    "height_m",
    "extent_m",
    "density",
    "echoes_beside",
    "face_share",
    "slenderness",
    "row",
    "background",
    "bright_share",
    "brightness",
)
"""Names of the features, in the order of `features_of`; logarithms are to base 2.

Height of the top in metres; metres from the 10th percentile of the heights to the highest; logarithm of the number of
echoes times the square of the range in tens of metres, and of the neighbours of each that stand out; the upright face
in heights of the top; logarithm of the width across the line of sight by the extent and the distance to the next beam;
where the water has no echoes, logarithm of the number of echoes beside each other in one beam; logarithm of the share
of the other directions in which the water has echoes at that range. With intensities: the share of echoes that reach
their thresholds, and the logarithm of the intensity in thresholds.
"""
OF_SHAPE = 8
"""Number of the features that need no intensities; without any, these have curves of their own."""
OF_TRACKS = "error"
"""Name of the feature of a track: the logarithm of the distance from where it was expected, in metres."""
_LEAST_ERROR_M = 0.05
LEAST, MOST = -3.0, 3.0


def log_odds(features: Floats) -> Floats:
    """Return the logarithm of the odds that objects are targets, shape (K,), from their features, shape (F, K).

    The odds are those of the frames from which the curves were learned, in which targets and clutter have equal weight.
    They are at least 1 to 20 and at most 20 to 1: what was not among these frames must not outweigh what others say.
    """
    offset, curves = _curves(len(features) == len(FEATURES))
    pairs = zip(features, (curves[name] for name in FEATURES), strict=False)
    odds: Floats = offset + np.sum([np.interp(values, *curve) for values, curve in pairs], axis=0)
    return np.clip(odds, LEAST, MOST)


def with_course(evidence: float, error_m: float, *, intensities: bool) -> float:
    """Return the log-odds of an object from those of its shape and how far it was from where its track expected it."""
    if evidence <= LEAST:
        return LEAST
    _, curves = _curves(intensities)
    return min(max(evidence + float(np.interp(log_error(error_m), *curves[OF_TRACKS])), LEAST), MOST)


def log_error(error_m: float) -> float:
    """Return the feature of an object at some distance from where its track expected it; NaN if it is new."""
    return math.log2(error_m + _LEAST_ERROR_M)


@cache
def _curves(intensities: bool) -> tuple[float, dict[str, tuple[Floats, Floats]]]:
    """Return the offset, and values of each feature with the log-odds that belong to them."""
    tables = load_json((files("seaclutter_cli.filters.confirmation") / "evidence.json").read_bytes())
    stored = tables["all" if intensities else "shape"]
    return stored["offset"], {
        name: (np.array(curve["value"]), np.array(curve["log_odds"])) for name, curve in stored["curves"].items()
    }
