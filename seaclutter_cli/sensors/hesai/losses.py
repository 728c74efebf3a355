"""Counting the packets of a Hesai sensor that never came."""

import numpy as np
from numpy.typing import NDArray

_LARGEST_GAP = 100_000


class LossCounter:
    """Counts missing packets by something that grows by the same amount from each packet to the next.

    Packets that come late are not missing, and a jump by more than 100,000 packets is a new beginning.

    Parameters
    ----------
    wrap : int, optional
        Where the numbers begin again at 0.

    Attributes
    ----------
    lost : int
        Packets that never came, so far.
    """

    def __init__(self, wrap: int = 1 << 62) -> None:
        self.lost = 0
        self._wrap = wrap
        self._last: int | None = None
        self._place = self._top = self._received = 0

    def add(self, numbers: NDArray[np.int64], period: float = 1.0) -> None:
        """Take the numbers of the next packets, shape (P,), and how much they grow from packet to packet."""
        first = int(numbers[0]) if self._last is None else self._last
        half = self._wrap // 2
        steps = np.rint(((np.diff(numbers, prepend=first) + half) % self._wrap - half) / period)
        if self._last is None:
            steps[0] = 1
        places = self._place + np.cumsum(np.where(abs(steps) > _LARGEST_GAP, 1, steps))
        self._top = max(self._top, int(places.max()))
        self._place, self._last = int(places[-1]), int(numbers[-1])
        self._received += len(numbers)
        self.lost = max(self._top - self._received, 0)
