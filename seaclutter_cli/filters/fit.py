"""Check of a log's intensities against the thresholds: a threshold of 30 is useless for intensities up to 1."""

import numpy as np

from seaclutter_cli.frame import FilterResult

_FRAMES = 20
_MIN_POINTS = 200


class ThresholdCheck:
    """Check of the first frames of a topic, with at most one warning about unsuitable thresholds.

    Parameters
    ----------
    needs_water : bool, optional
        Whether the method compares a point with its threshold only where it sees water; other frames do not count.
    """

    def __init__(self, *, needs_water: bool = False) -> None:
        self._needs_water = needs_water
        self._frames = self._points = self._low = 0
        self._least, self._most = np.inf, -np.inf
        self._warned = False

    def add(self, result: FilterResult) -> str | None:
        """Add a frame; return a warning once enough frames show that the thresholds do not fit."""
        if self._warned or result.rings is None or not result.rings.points.any():
            return None
        if self._needs_water and result.water is None:
            return None
        intensity = result.frame.intensity[result.frame.valid]
        self._least, self._most = min(self._least, intensity.min()), max(self._most, intensity.max())
        given = result.rings.corrections == 0  # corrected thresholds already fit the log
        self._points += int(result.rings.points[given].sum())
        self._low += int(result.rings.low_intensity[given].sum())
        if self._frames == 0:
            self._thresholds = result.rings.thresholds
        self._frames += 1
        return self.warning() if self._frames >= _FRAMES else None

    def warning(self) -> str | None:
        """Return a warning if the thresholds do not fit the frames so far; None once the check is complete."""
        if self._warned or not self._frames:
            return None
        self._warned = self._frames >= _FRAMES
        least, most = float(self._thresholds.min()), float(self._thresholds.max())
        ranges = f"intensities are {self._least:g} to {self._most:g}, thresholds {least:g} to {most:g}"
        if self._most < least:
            return f"no point can pass: {ranges}; find thresholds for this sensor with: seaclutter calibrate"
        if self._low == 0 and self._points >= _MIN_POINTS:
            return f"no point is below its threshold: {ranges}; find suitable thresholds with: seaclutter calibrate"
        return None
