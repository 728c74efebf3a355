"""Lost packets of a Hesai sensor."""

import numpy as np
from numpy.typing import NDArray

_MAX_GAP = 100_000


class LossCounter:
    """Counter of missing packets, based on a number that grows by a constant from packet to packet.

    Late packets are not missing. A jump of more than 100,000 packets restarts the count.

    Parameters
    ----------
    wrap : int, optional
        Number at which counting wraps to 0.

    Attributes
    ----------
    lost : int
        Packets lost so far.
    """

    def __init__(self, wrap: int = 1 << 62) -> None:
        self.lost = 0
        self._wrap = wrap
        self._last: int | None = None
        self._position = self._top = self._received = 0

    def add(self, numbers: NDArray[np.int64], period: float = 1.0) -> None:
        """Add the numbers of the next packets, shape (P,), which grow by ``period`` from packet to packet."""
        first = int(numbers[0]) if self._last is None else self._last
        half = self._wrap // 2
        steps = np.rint(((np.diff(numbers, prepend=first) + half) % self._wrap - half) / period)
        if self._last is None:
            steps[0] = 1
        positions = self._position + np.cumsum(np.where(abs(steps) > _MAX_GAP, 1, steps))
        self._top = max(self._top, int(positions.max()))
        self._position, self._last = int(positions[-1]), int(numbers[-1])
        self._received += len(numbers)
        self.lost = max(self._top - self._received, 0)
