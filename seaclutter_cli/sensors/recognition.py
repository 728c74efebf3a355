"""Recognition of the sensor of a cloud topic."""

from collections.abc import Collection
from dataclasses import dataclass

from seaclutter_cli.records import SensorFacts
from seaclutter_cli.sensors.catalog import SENSORS, can_be, guess_sensors


@dataclass(frozen=True)
class RecognisedSensor:
    """The sensor of a cloud topic, as far as the recording shows it.

    Parameters
    ----------
    models : tuple of str
        The model that packets or metadata state, or else those that the clouds resemble, most likely first.
    possible : frozenset of str
        All models in the catalogue that the clouds can be of; includes ``models``.
    intensity : str or None
        Intensity mode, if packets state it.
    is_stated : bool
        Whether packets or metadata state the model.
    """

    models: tuple[str, ...] = ()
    possible: frozenset[str] = frozenset()
    intensity: str | None = None
    is_stated: bool = False

    def __str__(self) -> str:
        """Return the sensor in a few words."""
        if not self.models:
            return "not recognised"
        return self.models[0] if self.is_stated else f"resembles {' or '.join(self.models)}"

    @property
    def described(self) -> str:
        """The sensor with its intensity mode, if that is known."""
        return f"{self} ({self.intensity})" if self.intensity else str(self)

    def is_other_than(self, model: str | None, intensity: str | None = None) -> bool:
        """Return whether this sensor is known not to be of a model, or not to have an intensity mode."""
        other_model = model is not None and bool(self.models) and model not in self.possible
        other_mode = None not in (self.intensity, intensity) and self.intensity != intensity
        return other_model or other_mode

    def differs_from(self, other: "RecognisedSensor") -> bool:
        """Return whether two topics are known to be of different sensors, or to have different intensity modes."""
        known = bool(self.models and other.models)
        return (known and not self.possible & other.possible) or self.is_other_than(None, other.intensity)


def recognise(
    fields: Collection[str], rings: int | None, points: int, facts: SensorFacts | None = None
) -> RecognisedSensor:
    """Return the sensor of a topic, from the facts about it or, without any, from the layout of its clouds.

    Parameters
    ----------
    fields, rings, points
        As for `guess_sensors`.
    facts : SensorFacts, optional
        Facts from packets or metadata.

    Examples
    --------
    >>> print(recognise(["x", "y", "z", "intensity", "ring", "time"], 16, 28000))
    resembles Puck Hi-Res or VLP-16
    >>> print(recognise([], None, 28000, SensorFacts("OS1-32")))
    OS1-32
    """
    if facts:
        return RecognisedSensor((facts.model,), frozenset({facts.model}), facts.details.get("intensity"), True)
    models = guess_sensors(fields, rings, points)
    possible = frozenset(model for model in SENSORS if can_be(model, fields, rings))
    return RecognisedSensor(tuple(models), possible if models else frozenset())
