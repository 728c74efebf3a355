"""Cutting the firings of a Hesai sensor into turns."""

import numpy as np
from numpy.typing import NDArray

TURN = 36_000
"""Hundredths of a degree in a turn."""
_EDGE = 100
_LONGEST_GAP_NS = 10_000_000_000


class Turns:
    """Counts the turns of a rotor by the azimuths of its firings.

    The azimuth is made continuous with the help of the clock and the motor's speed, so that jitter, packets that come
    late and gaps longer than a turn do not upset the count. The rotor may go either way; the first packet tells.

    Parameters
    ----------
    offsets : ndarray, shape (C,), float64
        Azimuth of each channel less that of the firing, in hundredths of a degree. A channel changes to the next turn
        where it itself crosses azimuth 0.
    """

    def __init__(self, offsets: NDArray[np.float64]) -> None:
        self._offsets = offsets
        self._sign = 0
        self._azimuth = self._time_ns = self._first = self._angle = self._top = 0

    def count(
        self, azimuths: NDArray[np.int64], times_ns: NDArray[np.int64], rpm: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        """Return the number of the turn of each firing and channel, shape (P, F, C); never one that is `done`.

        Parameters
        ----------
        azimuths : ndarray, shape (P, F), int64
            Azimuth of the F firings in each packet, in hundredths of a degree.
        times_ns : ndarray, shape (P, F), int64
            Time of each firing in nanoseconds.
        rpm : ndarray, shape (P,), int64
            Speed of the motor in turns a minute; 0 if unknown.
        """
        if self._sign == 0:
            self._begin(azimuths[0], int(times_ns[0, 0]))
        waits_ns = np.clip(np.diff(times_ns.ravel(), prepend=self._time_ns), 0, _LONGEST_GAP_NS)
        speeds = np.repeat(np.where(rpm > 0, rpm, 600) * (TURN / 60e9), azimuths.shape[1])
        steps = self._sign * np.diff(azimuths.ravel(), prepend=self._azimuth) % TURN
        steps += TURN * np.rint((waits_ns * speeds - steps) / TURN).astype(np.int64)
        angles = self._angle + np.cumsum(steps)
        tops = np.maximum(np.maximum.accumulate(angles), self._top)
        self._azimuth, self._time_ns = int(azimuths[-1, -1]), int(times_ns[-1, -1])
        self._angle, self._top = int(angles[-1]), int(tops[-1])
        turns = np.floor((angles[:, None] + self._sign * self._offsets) / TURN).astype(np.int64)
        completed = np.floor((tops + (self._sign * self._offsets).min()) / TURN).astype(np.int64)
        return np.asarray(np.maximum(turns, completed[:, None]).reshape(*azimuths.shape, -1))

    @property
    def done(self) -> int:
        """All turns before this one are complete."""
        return int((self._top + (self._sign * self._offsets).min()) // TURN)

    def is_partial(self, turn: int) -> bool:
        """Tell whether the firings so far begin or end within a turn, by more than a degree in any channel."""
        late = self._first + (self._sign * self._offsets).max() > turn * TURN + _EDGE
        early = self._top + (self._sign * self._offsets).min() < (turn + 1) * TURN - _EDGE
        return bool(late or early)

    def skip(self) -> None:
        """Begin a new turn where the rotor does not get to one."""
        self._angle += TURN
        self._top = max(self._top, self._angle)

    def _begin(self, azimuths: NDArray[np.int64], time_ns: int) -> None:
        """Take the direction and the place where the recording begins from its first packet."""
        steps = (np.diff(azimuths) + TURN // 2) % TURN - TURN // 2
        self._sign = -1 if steps.sum() < 0 else 1
        self._azimuth, self._time_ns = int(azimuths[0]), time_ns
        self._first = self._angle = self._top = self._sign * int(azimuths[0]) % TURN
