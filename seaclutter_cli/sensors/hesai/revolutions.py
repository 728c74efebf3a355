"""Revolutions of a Hesai sensor, counted from the azimuths of its firings."""

import numpy as np
from numpy.typing import NDArray

FULL_CIRCLE = 36_000
"""Hundredths of a degree in a revolution."""
_EDGE = 100
_MAX_GAP_NS = 10_000_000_000


class RevolutionCounter:
    """Counter of the revolutions of a rotor, from the azimuths of its firings.

    Azimuths are unwrapped with the clock and the motor speed, so jitter, late packets and gaps longer than a revolution
    do not disturb the count. The first packet determines the direction of rotation, or the first two firings.

    Parameters
    ----------
    offsets : ndarray, shape (C,), float64
        Azimuth offset of each channel from its firing, in hundredths of a degree. A channel enters the next revolution
        when it crosses azimuth 0 itself.
    """

    def __init__(self, offsets: NDArray[np.float64]) -> None:
        self._offsets = offsets
        self._sign = 0
        self._knows_direction = False
        self._azimuth = self._time_ns = self._first = self._angle = self._top = 0

    def count(
        self, azimuths: NDArray[np.int64], times_ns: NDArray[np.int64], rpm: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        """Return the revolution number of each firing and channel, shape (P, F, C), at least `done`.

        Parameters
        ----------
        azimuths : ndarray, shape (P, F), int64
            Azimuth of the F firings in each packet, in hundredths of a degree.
        times_ns : ndarray, shape (P, F), int64
            Time of each firing in nanoseconds.
        rpm : ndarray, shape (P,), int64
            Motor speed in revolutions per minute; 0 if unknown.
        """
        if not self._knows_direction:
            self._begin(azimuths, int(times_ns[0, 0]))
        waits_ns = np.clip(np.diff(times_ns.ravel(), prepend=self._time_ns), 0, _MAX_GAP_NS)
        speeds = np.repeat(np.where(rpm > 0, rpm, 600) * (FULL_CIRCLE / 60e9), azimuths.shape[1])
        steps = self._sign * np.diff(azimuths.ravel(), prepend=self._azimuth) % FULL_CIRCLE
        steps += FULL_CIRCLE * np.rint((waits_ns * speeds - steps) / FULL_CIRCLE).astype(np.int64)
        angles = self._angle + np.cumsum(steps)
        tops = np.maximum(np.maximum.accumulate(angles), self._top)
        self._azimuth, self._time_ns = int(azimuths[-1, -1]), int(times_ns[-1, -1])
        self._angle, self._top = int(angles[-1]), int(tops[-1])
        revolutions = np.floor((angles[:, None] + self._sign * self._offsets) / FULL_CIRCLE).astype(np.int64)
        completed = np.floor((tops + (self._sign * self._offsets).min()) / FULL_CIRCLE).astype(np.int64)
        return np.asarray(np.maximum(revolutions, completed[:, None]).reshape(*azimuths.shape, -1))

    @property
    def done(self) -> int:
        """Number of the first incomplete revolution."""
        return int((self._top + (self._sign * self._offsets).min()) // FULL_CIRCLE)

    def is_partial(self, revolution: int) -> bool:
        """Return whether the firings so far begin or end within a revolution, by more than 1° in any channel."""
        late = self._first + (self._sign * self._offsets).max() > revolution * FULL_CIRCLE + _EDGE
        early = self._top + (self._sign * self._offsets).min() < (revolution + 1) * FULL_CIRCLE - _EDGE
        return bool(late or early)

    def skip(self) -> None:
        """Start a new revolution although the rotor has not reached it."""
        self._angle += FULL_CIRCLE
        self._top = max(self._top, self._angle)

    def _begin(self, azimuths: NDArray[np.int64], time_ns: int) -> None:
        """Set the direction and the start azimuth from the first packets, shape (P, F)."""
        first = azimuths[0]
        if self._sign or len(first) == 1:  # packets with one firing show no direction by themselves
            flat = azimuths.ravel() if self._sign == 0 else np.append(self._azimuth, azimuths)
            first = np.append(flat[0], flat[flat != flat[0]][:1])
        steps = (np.diff(first) + FULL_CIRCLE // 2) % FULL_CIRCLE - FULL_CIRCLE // 2
        self._knows_direction = len(first) > 1
        self._sign, before = -1 if steps.sum() < 0 else 1, self._sign
        if before == 0:
            self._azimuth, self._time_ns = int(first[0]), time_ns
        if before != self._sign:
            self._first = self._angle = self._top = self._sign * self._azimuth % FULL_CIRCLE
