"""How often objects like another appear: what water makes once, it makes again."""

from collections import deque

import numpy as np

from seaclutter_cli.arrays import Floats, Ints
from seaclutter_cli.filters.confirmation.evidence import FEATURES

_MEMORY_S, _LEAST_S = 3.0, 0.5
_MOST = 1024
_KIND = (*(FEATURES.index(name) for name in ("height_m", "density", "brightness")), -1)
_SPREAD = (0.1, 1.5, 0.7, 1.0)
_SPREAD_OF_HEIGHT = 0.25


class Arrivals:
    """The objects that appeared in the last three seconds, at most 1,024.

    Trackers compare the density of new targets with that of false ones [1]_. The second differs from sea to sea and
    from one kind of object to another, so it is counted: foam, spray and crests appear again and again, targets do not.

    References
    ----------
    .. [1] Blackman, Popoli (1999). "Design and Analysis of Modern Tracking Systems". Artech House, section 6.2.
    """

    def __init__(self) -> None:
        self._seen: deque[tuple[float, Floats]] = deque(maxlen=_MOST)
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
        while self._seen and self._seen[0][0] < time_s - _MEMORY_S:
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
        return np.asarray(alike.sum(axis=1) / min(max(time_s - since_s, _LEAST_S), _MEMORY_S))
