"""Comparison of the sensor of a recording with the sensor that the thresholds of a configuration are for."""

from collections.abc import Mapping

from seaclutter_cli.config import SensorParams
from seaclutter_cli.frame import FilterResult
from seaclutter_cli.records import SensorFacts
from seaclutter_cli.sensors.catalog import RecognisedSensor
from seaclutter_cli.survey import TopicSurvey

_FRAMES = 20


class SensorCheck:
    """Check whether the thresholds are for the sensor of a topic, with at most one warning.

    Parameters
    ----------
    given : SensorParams
        Sensor that the thresholds are for.
    facts : mapping of str to SensorFacts
        Facts about the sensors of the recording; may grow while it is read.
    """

    def __init__(self, given: SensorParams, facts: Mapping[str, SensorFacts]) -> None:
        self._given, self._facts = given, facts
        self._survey, self._topic = TopicSurvey(), ""
        self._done = False

    def add(self, result: FilterResult) -> str | None:
        """Add a frame; return a warning once the sensor is known to be another one."""
        if self._done:
            return None
        self._topic = result.frame.topic
        self._survey.add(result.frame)
        return self.warning() if self._survey.frames >= _FRAMES else None

    def warning(self) -> str | None:
        """Return a warning if the sensor is known to be another one; None once the check is complete."""
        if self._done or not self._survey.frames:
            return None
        self._done = True
        return _difference(self._given, self._survey.sensor(self._facts.get(self._topic)))


def _difference(given: SensorParams, found: RecognisedSensor) -> str | None:
    """Return a warning if thresholds are not for a sensor; None if they are, or if that is unknown."""
    remedy = "find thresholds for it with: seaclutter calibrate"
    if found.is_other_than(given.model):
        seen = f"the log is from {found}" if found.is_stated else f"the log {found}"
        return f"the thresholds are for {given.model}, but {seen}; {remedy}"
    if found.is_other_than(None, given.intensity):
        return (
            f"the thresholds are for intensities of the kind '{given.intensity}', but the log has "
            f"'{found.intensity}'; {remedy}"
        )
    return None
