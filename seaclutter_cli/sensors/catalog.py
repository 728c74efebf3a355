"""Known lidars: models, recognition of the one that made a cloud, and those whose packets are not decoded."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from seaclutter_cli.arrays import Bytes
from seaclutter_cli.records import SensorFacts
from seaclutter_cli.text import suggestion


@dataclass(frozen=True)
class SensorModel:
    """A lidar: its maker, its number of lasers or rings, and its firings per revolution at 10 Hz in its usual mode.

    ``intensity`` is the unit that its driver writes, ``fields`` are those that it adds to x, y, z and intensity. If
    scans do not repeat, frames have any number of points.
    """

    maker: str
    beams: int
    columns: int
    intensity: str
    fields: frozenset[str]
    repeats: bool = True

    @property
    def max_intensity(self) -> float | None:
        """Highest intensity that its driver writes; None if there is no fixed limit."""
        return 255.0 if self.intensity == _BYTE else None


_BYTE = "0 to 255"
_ROBOSENSE = frozenset({"ring", "timestamp"})
_VELODYNE = frozenset({"ring", "time"})
_OUSTER = frozenset({"t", "reflectivity", "ring", "range"})
_PHOTONS = "photon counts; reflectivity 0 to 255"
_HESAI = frozenset({"ring", "timestamp"})
_LIVOX = frozenset({"tag", "line"})
_MOST_RETURNS = 2.2  # two for each shot, and a rotor that is slower than usual

SENSORS: Mapping[str, SensorModel] = {
    "RS-LiDAR-32": SensorModel("RoboSense", 32, 1800, _BYTE, _ROBOSENSE),
    "RS-LiDAR-16": SensorModel("RoboSense", 16, 1800, _BYTE, _ROBOSENSE),
    "RS-Helios": SensorModel("RoboSense", 32, 1800, _BYTE, _ROBOSENSE),
    "RS-Helios-16P": SensorModel("RoboSense", 16, 1800, _BYTE, _ROBOSENSE),
    "RS-Bpearl": SensorModel("RoboSense", 32, 1800, _BYTE, _ROBOSENSE),
    "RS-Ruby": SensorModel("RoboSense", 128, 1800, _BYTE, _ROBOSENSE),
    "RS-Ruby-80": SensorModel("RoboSense", 80, 1800, _BYTE, _ROBOSENSE),
    "RS-Ruby-48": SensorModel("RoboSense", 48, 1800, _BYTE, _ROBOSENSE),
    "RS-Ruby-Plus": SensorModel("RoboSense", 128, 1800, _BYTE, _ROBOSENSE),
    "RS-Ruby-Plus-80": SensorModel("RoboSense", 80, 1800, _BYTE, _ROBOSENSE),
    "RS-Ruby-Plus-48": SensorModel("RoboSense", 48, 1800, _BYTE, _ROBOSENSE),
    "RS-Airy": SensorModel("RoboSense", 96, 900, _BYTE, _ROBOSENSE),
    "RS-Airy-48": SensorModel("RoboSense", 48, 900, _BYTE, _ROBOSENSE),
    "RS-M1": SensorModel("RoboSense", 5, 15000, _BYTE, _ROBOSENSE),
    "RS-E1": SensorModel("RoboSense", 1, 26000, _BYTE, _ROBOSENSE),
    "VLP-16": SensorModel("Velodyne", 16, 1800, _BYTE, _VELODYNE),
    "Puck Hi-Res": SensorModel("Velodyne", 16, 1800, _BYTE, _VELODYNE),
    "VLP-32A": SensorModel("Velodyne", 32, 1800, _BYTE, _VELODYNE),
    "VLP-32B": SensorModel("Velodyne", 32, 1800, _BYTE, _VELODYNE),
    "VLP-32C": SensorModel("Velodyne", 32, 1800, _BYTE, _VELODYNE),
    "HDL-32E": SensorModel("Velodyne", 32, 2170, _BYTE, _VELODYNE),
    "Alpha Prime": SensorModel("Velodyne", 128, 1800, _BYTE, _VELODYNE),
    "HDL-64E": SensorModel("Velodyne", 64, 2083, _BYTE, _VELODYNE),
    **{
        f"OS{series}-{rows}": SensorModel("Ouster", rows, 1024, _PHOTONS, _OUSTER)
        for series in range(3)
        for rows in (32, 64, 128)
    },
    "Pandar40P": SensorModel("Hesai", 40, 1800, _BYTE, _HESAI),
    "Pandar64": SensorModel("Hesai", 64, 1800, _BYTE, _HESAI),
    "PandarQT": SensorModel("Hesai", 64, 600, _BYTE, _HESAI),
    "PandarQT128": SensorModel("Hesai", 128, 900, _BYTE, _HESAI),
    "PandarXT-16": SensorModel("Hesai", 16, 2000, _BYTE, _HESAI),
    "PandarXT-32": SensorModel("Hesai", 32, 2000, _BYTE, _HESAI),
    "PandarXT-32M2X": SensorModel("Hesai", 32, 2000, _BYTE, _HESAI),
    "Pandar128": SensorModel("Hesai", 128, 1800, _BYTE, _HESAI),
    "OT128": SensorModel("Hesai", 128, 1800, _BYTE, _HESAI),
    "AT128": SensorModel("Hesai", 128, 1200, _BYTE, _HESAI),
    "Mid-70": SensorModel("Livox", 1, 10000, _BYTE, _LIVOX, repeats=False),
    "Mid-360": SensorModel("Livox", 4, 5000, _BYTE, _LIVOX, repeats=False),
    "Avia": SensorModel("Livox", 6, 4000, _BYTE, _LIVOX, repeats=False),
    "HAP": SensorModel("Livox", 6, 7500, _BYTE, _LIVOX, repeats=False),
}
"""Sensors by name. Register new ones here."""


@dataclass(frozen=True)
class RecognisedSensor:
    """The sensor of a cloud topic, as far as the recording shows it.

    ``models`` are the model that packets or metadata state (``is_stated``), or else those that the clouds resemble,
    most likely first; ``possible`` are all that the clouds can be of. The intensity mode is known only from packets.
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


def known_sensor(name: str) -> str:
    """Return the name of a sensor in its usual spelling; raise `ValueError` if no sensor has it."""
    names = {known.casefold(): known for known in SENSORS}
    if name.casefold() not in names:
        raise ValueError(f"unknown sensor {name}; {suggestion(name, SENSORS)}choose from: {', '.join(SENSORS)}")
    return names[name.casefold()]


def recognise(
    fields: Collection[str], rings: int | None, points: int, facts: SensorFacts | None = None
) -> RecognisedSensor:
    """Return the sensor of a topic, from the facts about it or, without any, from fields and points of its clouds.

    ``rings`` counts those up to the last one seen; None without such a field.
    """
    if facts:
        return RecognisedSensor((facts.model,), frozenset({facts.model}), facts.details.get("intensity"), True)
    names, seen = {name.lower() for name in fields}, math.inf if rings is None else rings
    possible = {name: one for name, one in SENSORS.items() if seen <= one.beams and one.fields <= names}
    fitting = sorted(
        (sensor.beams, abs(sensor.beams * sensor.columns - points), name)
        for name, sensor in possible.items()
        if not sensor.repeats or points <= _MOST_RETURNS * sensor.beams * sensor.columns
    )
    models = tuple(name for beams, _, name in fitting if beams == fitting[0][0])
    return RecognisedSensor(models, frozenset(possible if models else ()))


ADVICE = "record the sensor_msgs/PointCloud2 of the maker's driver"
"""What to do with a sensor whose packets are not decoded."""

_MEMS_ID = bytes.fromhex("55aa5aa5")
_HESAI_MARK = b"\xee\xff"

_KINDS: Sequence[tuple[str, bytes, int | None]] = (
    ("RoboSense RS-M1", _MEMS_ID, 1210),
    ("RoboSense RS-E1", _MEMS_ID, 1200),
    ("RoboSense RS-M2", _MEMS_ID, 1342),
    ("RoboSense RS-M3", _MEMS_ID, 1448),
    ("RoboSense RS-MX", _MEMS_ID, 1404),
    ("RoboSense RS-EMX", _MEMS_ID, 812),
    ("RoboSense RS-M1 Jumbo", _MEMS_ID, 62152),
    ("Hesai JT128, or another with protocol 1.4 that is not a Pandar128 or OT128", _HESAI_MARK + bytes((1, 4)), None),
    ("Hesai JT16 (protocol 1.8)", _HESAI_MARK + bytes((1, 8)), None),
    ("Hesai PandarQT with 32 lasers (protocol 3.1)", _HESAI_MARK + bytes((3, 1, 0, 0, 32)), None),
    ("Hesai AT128 (protocol 4.1)", _HESAI_MARK + bytes((4, 1)), None),
    ("Hesai ATX (protocol 4.7)", _HESAI_MARK + bytes((4, 7)), None),
    ("Hesai FT120 (protocol 7.2)", _HESAI_MARK + bytes((7, 2)), None),
)
"""Sensors, first bytes of their packets, and lengths (None for any), the most particular first."""


def name_unsupported(payload: Bytes) -> str | None:
    """Return the name of a known sensor without a decoder that sent a UDP payload, shape (L,); None if unknown."""
    start = payload[:8].tobytes()
    kinds = (name for name, begins, length in _KINDS if start.startswith(begins) and length in (None, len(payload)))
    return next(kinds, None)
