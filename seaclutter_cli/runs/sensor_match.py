"""Comparison of the sensor in a log with the sensor that a configuration is for."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from seaclutter_cli.config import SensorParams
    from seaclutter_cli.interfaces import Source


def mismatches(sensor: "SensorParams", source: "Source") -> list[str]:
    """Return a warning for each sensor of a recording that the thresholds are not for."""
    warnings = []
    for topic, facts in source.facts.items():
        mode = facts.details.get("intensity")
        if sensor.model and sensor.model != facts.model:
            warnings.append(
                f"{topic}: the configuration is for {sensor.model}, but the log is from {facts.model}; find thresholds "
                "for it with: seaclutter calibrate"
            )
        elif sensor.intensity and mode and sensor.intensity != mode:
            warnings.append(
                f"{topic}: the thresholds are for intensities of the kind '{sensor.intensity}', but the log has "
                f"'{mode}'; find thresholds for it with: seaclutter calibrate"
            )
    return warnings
