"""Own ship's attitude from a log, tried against the visible water."""

import math

import numpy as np

from seaclutter_cli.frame import Attitude
from seaclutter_cli.water.plane import Plane

_SPAN_S, _MEMORY_S = 0.5, 10.0
_LEAST, _ENOUGH = 1.5, 8.0
_SHARE, _FLOOR = 0.1, math.radians(0.5) ** 2


class Trial:
    """Comparison of how own ship turns according to attitudes with how the visible water turns.

    Over each half a second, the slopes of the water are compared with those after the turn of the attitudes, and with
    unchanged ones. Attitudes pass if the squares of the differences, summed over ten seconds, are less than a tenth
    of those of unchanged slopes, plus half a degree each; wrong axes, times or units do not pass.
    """

    def __init__(self) -> None:
        self.warnings: list[str] = []
        self._sums = np.zeros(3)
        self._last: tuple[Plane, Attitude, float] | None = None

    @property
    def passed(self) -> bool:
        """Whether attitudes agree with the water."""
        turned, unchanged, number = self._sums.tolist()
        return bool(number > _LEAST and turned < _SHARE * unchanged + _FLOOR * number)

    def add(self, plane: Plane, attitude: Attitude, time_s: float) -> None:
        """Add the plane of a frame in which water was seen."""
        old, known, since_s = self._last or (plane, attitude, -np.inf)
        turn, elapsed_s = attitude.turn_from(known), time_s - since_s
        if turn is not None and 0 <= elapsed_s < _SPAN_S:
            return
        self._last = plane, attitude, time_s
        if turn is None or not _SPAN_S <= elapsed_s < 2 * _SPAN_S:
            return
        found = plane.tilt_from(old.turned(turn)), plane.tilt_from(old), 1
        self._sums = math.exp(-elapsed_s / _MEMORY_S) * self._sums + np.square(found)
        turned, unchanged, number = self._sums.tolist()
        if number > _ENOUGH and turned > unchanged + _FLOOR * number:
            self.warnings = [f"own ship's attitude on {known.source[0]} is not used: it does not agree with the water"]
