"""Known lidar models, which `info` compares with a log."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class SensorModel:
    """A lidar.

    Parameters
    ----------
    maker : str
        Manufacturer.
    beams : int
        Number of lasers, which is the number of rings in its clouds.
    columns : int
        Firings per revolution at 10 Hz in its usual mode.
    intensity : str
        Unit of the intensity that its driver writes.
    fields : frozenset of str
        Field names that its driver uses in addition to x, y, z and intensity.
    repeats : bool, optional
        Whether its scans repeat; otherwise frames have any number of points.
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
    "OS0-32": SensorModel("Ouster", 32, 1024, _PHOTONS, _OUSTER),
    "OS0-64": SensorModel("Ouster", 64, 1024, _PHOTONS, _OUSTER),
    "OS0-128": SensorModel("Ouster", 128, 1024, _PHOTONS, _OUSTER),
    "OS1-32": SensorModel("Ouster", 32, 1024, _PHOTONS, _OUSTER),
    "OS1-64": SensorModel("Ouster", 64, 1024, _PHOTONS, _OUSTER),
    "OS1-128": SensorModel("Ouster", 128, 1024, _PHOTONS, _OUSTER),
    "OS2-32": SensorModel("Ouster", 32, 1024, _PHOTONS, _OUSTER),
    "OS2-64": SensorModel("Ouster", 64, 1024, _PHOTONS, _OUSTER),
    "OS2-128": SensorModel("Ouster", 128, 1024, _PHOTONS, _OUSTER),
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


def guess_sensors(fields: Collection[str], rings: int | None, points: int) -> list[str]:
    """Return the names of the sensors that match a cloud, most likely first; several sensors share a layout.

    Beams that look at the sky or at calm water return nothing, so a cloud may lack rings: the sensors with the fewest
    beams that suffice match.

    Parameters
    ----------
    fields : collection of str
        Field names of the cloud.
    rings : int or None
        Number of rings up to the last one seen; None without such a field.
    points : int
        Points per frame.

    Examples
    --------
    >>> guess_sensors(["x", "y", "z", "intensity", "ring", "time"], 16, 28000)
    ['Puck Hi-Res', 'VLP-16']
    >>> guess_sensors(["x", "y", "z", "intensity", "tag", "line", "timestamp"], 4, 20000)
    ['Mid-360']
    >>> guess_sensors(["x", "y", "z", "intensity"], None, 28000)
    []
    """
    fitting = [
        (sensor.beams, abs(sensor.beams * sensor.columns - points), name)
        for name, sensor in SENSORS.items()
        if can_be(name, fields, rings)
        and (not sensor.repeats or points <= _MOST_RETURNS * sensor.beams * sensor.columns)
    ]
    return [name for beams, _, name in sorted(fitting) if beams == min(fitting)[0]]


def can_be(model: str, fields: Collection[str], rings: int | None) -> bool:
    """Return whether a cloud with these fields and rings can be of a sensor in the catalogue; see `guess_sensors`."""
    sensor = SENSORS[model]
    return rings is not None and rings <= sensor.beams and sensor.fields <= {name.lower() for name in fields}
