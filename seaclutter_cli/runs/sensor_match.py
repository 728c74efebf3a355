"""What packets tell of a sensor, and whether a configuration was made for it."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from seaclutter_cli.config import SensorParams
    from seaclutter_cli.interfaces import Source
    from seaclutter_cli.records import SensorFacts


def facts_of(source: "Source") -> "Mapping[str, SensorFacts]":
    """Return what is known of the sensor behind each cloud topic; complete once the records have been read."""
    found: Mapping[str, SensorFacts] = getattr(source, "facts", {})
    return found


def mismatches(sensor: "SensorParams", source: "Source") -> list[str]:
    """Return a warning for each sensor of a recording that the thresholds were not made for."""
    said = []
    for topic, facts in facts_of(source).items():
        mode = facts.details.get("intensity")
        if sensor.model and sensor.model != facts.model:
            said.append(
                f"{topic}: the configuration was made for {sensor.model}, the log is of {facts.model}: calibrate"
            )
        elif sensor.intensity and mode and sensor.intensity != mode:
            said.append(
                f"{topic}: thresholds were found where intensities are {sensor.intensity}, in the log they are {mode}: "
                "calibrate"
            )
    return said
