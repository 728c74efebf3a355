"""Known lidar models, which `info` compares with a log."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class SensorModel:
    """A rotating lidar.

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
    """

    maker: str
    beams: int
    columns: int
    intensity: str
    fields: frozenset[str]


_ROBOSENSE = frozenset({"ring", "timestamp"})
_VELODYNE = frozenset({"ring", "time"})
_OUSTER = frozenset({"t", "reflectivity", "ring", "range"})
_PHOTONS = "photon counts; reflectivity 0 to 255"
_HESAI = frozenset({"ring", "timestamp"})

SENSORS: Mapping[str, SensorModel] = {
    "RS-LiDAR-32": SensorModel("RoboSense", 32, 1800, "0 to 255", _ROBOSENSE),
    "RS-LiDAR-16": SensorModel("RoboSense", 16, 1800, "0 to 255", _ROBOSENSE),
    "RS-Helios": SensorModel("RoboSense", 32, 1800, "0 to 255", _ROBOSENSE),
    "VLP-16": SensorModel("Velodyne", 16, 1800, "0 to 255", _VELODYNE),
    "Puck Hi-Res": SensorModel("Velodyne", 16, 1800, "0 to 255", _VELODYNE),
    "VLP-32A": SensorModel("Velodyne", 32, 1800, "0 to 255", _VELODYNE),
    "VLP-32B": SensorModel("Velodyne", 32, 1800, "0 to 255", _VELODYNE),
    "VLP-32C": SensorModel("Velodyne", 32, 1800, "0 to 255", _VELODYNE),
    "HDL-32E": SensorModel("Velodyne", 32, 2170, "0 to 255", _VELODYNE),
    "Alpha Prime": SensorModel("Velodyne", 128, 1800, "0 to 255", _VELODYNE),
    "HDL-64E": SensorModel("Velodyne", 64, 2083, "0 to 255", _VELODYNE),
    "OS0-32": SensorModel("Ouster", 32, 1024, _PHOTONS, _OUSTER),
    "OS0-64": SensorModel("Ouster", 64, 1024, _PHOTONS, _OUSTER),
    "OS0-128": SensorModel("Ouster", 128, 1024, _PHOTONS, _OUSTER),
    "OS1-32": SensorModel("Ouster", 32, 1024, _PHOTONS, _OUSTER),
    "OS1-64": SensorModel("Ouster", 64, 1024, _PHOTONS, _OUSTER),
    "OS1-128": SensorModel("Ouster", 128, 1024, _PHOTONS, _OUSTER),
    "OS2-32": SensorModel("Ouster", 32, 1024, _PHOTONS, _OUSTER),
    "OS2-64": SensorModel("Ouster", 64, 1024, _PHOTONS, _OUSTER),
    "OS2-128": SensorModel("Ouster", 128, 1024, _PHOTONS, _OUSTER),
    "Pandar40P": SensorModel("Hesai", 40, 1800, "0 to 255", _HESAI),
    "PandarXT-32": SensorModel("Hesai", 32, 2000, "0 to 255", _HESAI),
}
"""Sensors by name. Register new ones here."""


def guess_sensors(fields: Collection[str], rings: int | None, points: int) -> list[str]:
    """Return the names of the sensors that match a cloud, most likely first; several sensors share a layout.

    Parameters
    ----------
    fields : collection of str
        Field names of the cloud.
    rings : int or None
        Number of distinct values in its ring field; None without such a field.
    points : int
        Points per frame.

    Examples
    --------
    >>> guess_sensors(["x", "y", "z", "intensity", "ring", "time"], 16, 28000)
    ['Puck Hi-Res', 'VLP-16']
    >>> guess_sensors(["x", "y", "z", "intensity"], None, 28000)
    []
    """
    if rings is None:
        return []
    names = {name.lower() for name in fields}
    fitting = [
        (abs(sensor.beams * sensor.columns - points), name)
        for name, sensor in SENSORS.items()
        if sensor.beams == rings and sensor.fields <= names and points <= 1.2 * sensor.beams * sensor.columns
    ]
    return [name for _, name in sorted(fitting)]
