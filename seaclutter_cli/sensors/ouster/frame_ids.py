"""Damaged frame ids, which would end a revolution too early."""

import numpy as np
from numpy.typing import NDArray


class FrameIdCheck:
    """Check of the frame ids of packets in order of arrival.

    A frame id is damaged if it differs from those of both neighbours, and its packet does not belong between them,
    although they are at most a revolution apart.

    Parameters
    ----------
    per_revolution : int
        Packets per revolution.

    Notes
    -----
    State: the last two packets. The last one is judged when its successor is known.
    """

    def __init__(self, per_revolution: int) -> None:
        self._size = per_revolution
        self._last = np.empty(0, np.int64)
        self._is_damaged = False

    def add(self, frame_ids: NDArray[np.int64], positions: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which packets are intact.

        Parameters
        ----------
        frame_ids, positions : ndarray, shape (P,)
            16-bit frame ids, and the numbers of the packets in their revolutions; one or more.

        Returns
        -------
        ndarray, shape (P,) or (P - 1,)
            For the packet that waited for its successor, if there was one, and all of these but the last.
        """
        known = np.concatenate([self._last, frame_ids * self._size + positions])
        before, these, after = known[:-2], known[1:-1], known[2:]
        total = 0x10000 * self._size
        gap, step = (after - before) % total, (these - before) % total
        ids = known // self._size
        differs = (ids[1:-1] != ids[:-2]) & (ids[1:-1] != ids[2:])
        damaged = np.zeros(len(known), np.bool_)
        damaged[0] = self._is_damaged and len(self._last) == 2
        for at in (np.flatnonzero(differs & (gap <= self._size) & (step > gap)) + 1).tolist():
            damaged[at] = not damaged[at - 1]  # beside a damaged id, an intact one differs too
        self._is_damaged = len(known) > 1 and bool(damaged[-2])
        judged = ~damaged[max(len(self._last) - 1, 0) : -1]
        self._last = known[-2:].copy()
        return judged
