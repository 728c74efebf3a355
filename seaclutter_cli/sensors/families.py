"""Packet decoders by lidar maker."""

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.sensors.hesai.decoder import Hesai
from seaclutter_cli.sensors.ouster.decoder import Ouster
from seaclutter_cli.sensors.packets import PacketFamily
from seaclutter_cli.sensors.robosense.decoder import RoboSense
from seaclutter_cli.sensors.robosense.solid import RoboSenseSolid
from seaclutter_cli.sensors.velodyne.decoder import VELODYNE

PACKET_FAMILIES: Mapping[str, PacketFamily] = {
    "robosense": RoboSense(),
    "robosense_solid": RoboSenseSolid(),
    "velodyne": VELODYNE,
    "hesai": Hesai(),
    "ouster": Ouster(),
}
"""Families by name, tried in this order. Register new ones here."""

CALIBRATION_SUFFIXES: Mapping[str, str] = {"ouster": ".json"}
"""Suffix of the calibration file that usually accompanies a capture, by family."""


@runtime_checkable
class SelfCalibrating(Protocol):
    """A family whose sensors send their calibration in packets."""

    def is_calibration(self, payloads: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Return which UDP payloads, shape (P, L), contain a calibration."""
        ...
