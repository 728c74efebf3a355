"""Whether a log's intensities can fit the thresholds: one of 30 says nothing about intensities up to 1."""

import numpy as np

from seaclutter_cli.frame import FilterResult

_FRAMES = 20
_LEAST_POINTS = 200


class IntensityFit:
    """Looks at the first frames of a topic and tells once if thresholds and intensities cannot belong together."""

    def __init__(self) -> None:
        self._frames = self._points = self._low = 0
        self._least, self._most = np.inf, -np.inf
        self._told = False

    def add(self, result: FilterResult) -> str | None:
        """Take a frame; return a warning when enough has been seen and it is wrong."""
        if self._told or result.rings is None or not result.rings.points.any():
            return None
        intensity = result.frame.intensity[result.frame.valid]
        self._least, self._most = min(self._least, intensity.min()), max(self._most, intensity.max())
        given = result.rings.corrections == 0  # a corrected threshold has been fitted to the log already
        self._points += int(result.rings.points[given].sum())
        self._low += int(result.rings.low_intensity[given].sum())
        if self._frames == 0:
            self._thresholds = result.rings.thresholds
        self._frames += 1
        return self.verdict() if self._frames >= _FRAMES else None

    def verdict(self) -> str | None:
        """Return a warning if what was seen so far is wrong; only once."""
        if self._told or not self._frames:
            return None
        self._told = self._frames >= _FRAMES
        least, most = float(self._thresholds.min()), float(self._thresholds.max())
        said = f"intensities are {self._least:g} to {self._most:g}, thresholds {least:g} to {most:g}"
        if self._most < least:
            return f"no point can pass: {said}; find thresholds for this sensor with: seaclutter calibrate"
        if self._low == 0 and self._points >= _LEAST_POINTS:
            return f"no point is weaker than its threshold: {said}; find fitting ones with: seaclutter calibrate"
        return None
