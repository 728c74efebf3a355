"""The evidence that an object is a target: one curve for each feature of its shape and its track."""

from collections import deque
from functools import cache
from importlib.resources import files

import numpy as np

from seaclutter_cli.arrays import Floats, Ints
from seaclutter_cli.documents import load_json

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
where the water has no echoes, or no rows as long, logarithm of the number of echoes beside each other in one beam;
logarithm of the share of the other directions in which the water has echoes at that range. With intensities: the share
of echoes that reach their thresholds, and the logarithm of the intensity in thresholds.
"""
OF_SHAPE = 8
"""Number of the features that need no intensities; without any, these have curves of their own."""
OF_TRACKS = ("error", "arrivals")
"""Names of the features of a track: logarithm of the distance from where it was expected, in metres, and of the number
of objects like it that appear in a second."""
_LEAST_ERROR_M, _LEAST_RATE_HZ = 0.05, 0.1
LEAST, MOST = -3.0, 3.0
OF_VOLUME = -100.0
_ARRIVALS_S, _LEAST_S = 3.0, 0.5
_MOST_ARRIVALS = 1024
_KIND = (*(FEATURES.index(name) for name in ("height_m", "density", "brightness")), -1)
_SPREAD = (0.1, 1.5, 0.7, 1.0)
_SPREAD_OF_HEIGHT = 0.25


def log_odds(features: Floats) -> Floats:
    """Return the logarithm of the odds that objects are targets, shape (K,), from their features, shape (F, K).

    The odds are those of the frames from which the curves were learned, in which targets and clutter have equal weight.
    """
    offset, curves = _curves(len(features) == len(FEATURES))
    pairs = zip(features, (curves[name] for name in FEATURES), strict=False)
    odds: Floats = offset + np.sum([np.interp(values, *curve) for values, curve in pairs], axis=0)
    return odds


def with_tracks(evidence: Floats, features: Floats, *, intensities: bool) -> Floats:
    """Return the log-odds of K objects from those of their shapes and the features of their tracks (`track_features`).

    They are at least 1 to 20 and at most 20 to 1: what was not among these frames must not outweigh what others say.
    """
    _, curves = _curves(intensities)
    said = [np.interp(values, *curves[name]) for name, values in zip(OF_TRACKS, features, strict=True)]
    return np.asarray(np.clip(evidence + np.nansum(said, axis=0), LEAST, MOST))


def track_features(errors_m: Floats, rates_hz: Floats) -> Floats:
    """Return the features of tracks, shape (2, K), in the order of `OF_TRACKS`; the first is NaN for new tracks."""
    return np.log2((errors_m + _LEAST_ERROR_M, rates_hz + _LEAST_RATE_HZ))


@cache
def _curves(intensities: bool) -> tuple[float, dict[str, tuple[Floats, Floats]]]:
    """Return the offset, and values of each feature with the log-odds that belong to them."""
    tables = load_json((files("seaclutter_cli.filters.confirmation") / "evidence.json").read_bytes())
    stored = tables["all" if intensities else "shape"]
    return stored["offset"], {
        name: (np.array(curve["value"]), np.array(curve["log_odds"])) for name, curve in stored["curves"].items()
    }


class Arrivals:
    """The objects that appeared in the last three seconds, at most 1,024.

    Trackers compare the density of new targets with that of false ones [1]_. The second differs from sea to sea and
    from one kind of object to another, so it is counted: foam, spray and crests appear again and again, targets do not.

    References
    ----------
    .. [1] Blackman, Popoli (1999). "Design and Analysis of Modern Tracking Systems". Artech House, section 6.2.
    """

    def __init__(self) -> None:
        self._seen: deque[tuple[float, Floats]] = deque(maxlen=_MOST_ARRIVALS)
        self._count = 0

    def add(self, kind: Floats, time_s: float) -> int:
        """Note an object that appears, of a kind as in `rates_hz`, shape (F + 1,), and return its number."""
        self._seen.append((time_s, kind))
        self._count += 1
        return self._count - 1

    def rates_hz(self, kinds: Floats, own: Ints, time_s: float, since_s: float) -> Floats:
        """Return how many objects like each of K appeared in a second, shape (K,), not counting itself.

        ``kinds`` are the features of their shapes and the logarithm of their range to base 2, shape (K, F + 1);
        ``own`` are their numbers, shape (K,), -1 for none; ``since_s`` is when the first could have appeared.
        """
        while self._seen and self._seen[0][0] < time_s - _ARRIVALS_S:
            self._seen.popleft()
        if not self._seen or not len(kinds):
            return np.zeros(len(kinds))
        seen = np.array([one for _, one in self._seen])
        distance = np.zeros((len(kinds), len(seen)))
        for k, spread in zip(_KIND, _SPREAD, strict=True):
            if k < seen.shape[1]:  # no brightness without intensities
                scale = spread + (_SPREAD_OF_HEIGHT * np.abs(kinds[:, k]) if k == _KIND[0] else 0)
                distance += ((kinds[:, k, None] - seen[:, k]) / np.reshape(scale, (-1, 1))) ** 2
        alike = np.exp(-distance / 2)
        first = self._count - len(seen)
        (rows,) = np.nonzero(own >= first)
        alike[rows, own[rows] - first] = 0
        return np.asarray(alike.sum(axis=1) / min(max(time_s - since_s, _LEAST_S), _ARRIVALS_S))
