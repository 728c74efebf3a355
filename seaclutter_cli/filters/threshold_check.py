"""Check of a log's intensities against the thresholds: a threshold of 30 is useless for intensities up to 1."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.frame import FilterResult
from seaclutter_cli.text import count

_FRAMES = 20
_MIN_POINTS = 200
_MIN_RING_POINTS = 500
_REMEDY = "find suitable thresholds with: seaclutter calibrate"


class ThresholdCheck:
    """Check of the first frames of a topic, with at most one warning about unsuitable thresholds.

    The thresholds are those of the range rings between ``edges``, shape (K + 1,), for a sensor and its highest
    intensity, if they are known. With ``needs_water``, the method compares a point with its threshold only where it
    sees water, and other frames do not count.
    """

    def __init__(
        self,
        edges: Sequence[float],
        *,
        sensor: str | None = None,
        max_intensity: float | None = None,
        needs_water: bool = False,
    ) -> None:
        self._edges, self._needs_water = np.asarray(edges, np.float64), needs_water
        self._sensor, self._top = sensor, np.inf if max_intensity is None else max_intensity
        rings = max(0, len(self._edges) - 1)
        self._frames = 0
        self._points, self._low = np.zeros(rings, np.int64), np.zeros(rings, np.int64)
        self._ring_least, self._ring_most = np.full(rings, np.inf), np.full(rings, -np.inf)
        self._least, self._most = np.inf, -np.inf
        self._warned = False

    def add(self, result: FilterResult) -> str | None:
        """Add a frame; return a warning once enough frames show that the thresholds do not fit."""
        if self._warned or result.rings is None or not result.rings.points.any():
            return None
        if self._needs_water and result.water is None:
            return None
        if self._frames == 0:
            self._thresholds = result.rings.thresholds  # later ones are corrected, and fit the log
        self._frames += 1
        frame = result.frame
        intensity = frame.intensity[frame.valid]
        self._least, self._most = min(self._least, intensity.min()), max(self._most, intensity.max())
        ring = np.searchsorted(self._edges, frame.range_m[frame.valid], side="right") - 1
        inside = (ring >= 0) & (ring < len(self._points))
        ring, intensity = ring[inside], intensity[inside]
        self._points += np.bincount(ring, minlength=len(self._points))
        self._low += np.bincount(ring[intensity < self._thresholds[ring]], minlength=len(self._points))
        np.minimum.at(self._ring_least, ring, intensity)
        np.maximum.at(self._ring_most, ring, intensity)
        return self.warning() if self._frames >= _FRAMES else None

    def warning(self) -> str | None:
        """Return a warning if the thresholds do not fit the frames so far; None once the check is complete."""
        if self._warned or not self._frames:
            return None
        self._warned = self._frames >= _FRAMES
        least, most = float(self._thresholds.min()), float(self._thresholds.max())
        ranges = f"intensities are {self._least:g} to {self._most:g}, thresholds {least:g} to {most:g}"
        if self._most > self._top:
            return (
                f"the thresholds are for {self._sensor}, whose intensities end at {self._top:g}, but those of the log "
                f"reach {self._most:g}; find thresholds for this sensor with: seaclutter calibrate"
            )
        if self._most < least:
            return f"no point can pass: {ranges}; find thresholds for this sensor with: seaclutter calibrate"
        if not self._low.any() and self._points.sum() >= _MIN_POINTS:
            return f"no point is below its threshold: {ranges}; {_REMEDY}"
        many = self._points >= _MIN_RING_POINTS
        useless = many & (self._low == 0)
        blind = many & (2 * self._ring_most < self._thresholds)
        if useless.any():
            return self._in_ring(useless, "is below the threshold")
        return self._in_ring(blind, "can pass") if blind.any() else None

    def _in_ring(self, rings: NDArray[np.bool_], problem: str) -> str:
        """Return a warning about the first of some range rings."""
        k = int(np.flatnonzero(rings)[0])
        others = int(np.count_nonzero(rings)) - 1
        more = f" (and {count(others, 'other range ring')})" if others else ""
        start, end, threshold = self._edges[k], self._edges[k + 1], self._thresholds[k]
        ranges = f"intensities are {self._ring_least[k]:g} to {self._ring_most[k]:g}, the threshold {threshold:g}"
        return f"no point from {start:g} to {end:g} m{more} {problem}: {ranges}; {_REMEDY}"
