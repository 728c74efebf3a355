"""Makers of lidars whose packets are decoded."""

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.sensors.hesai.decoder import Hesai
from seaclutter_cli.sensors.ouster.decoder import Ouster
from seaclutter_cli.sensors.packets import PacketFamily
from seaclutter_cli.sensors.robosense.decoder import RoboSense
from seaclutter_cli.sensors.velodyne.decoder import VELODYNE

PACKET_FAMILIES: Mapping[str, PacketFamily] = {
    "robosense": RoboSense(),
    "velodyne": VELODYNE,
    "hesai": Hesai(),
    "ouster": Ouster(),
}
"""Families by name, asked in this order. A new one is one line here."""

CALIBRATIONS_BESIDE: Mapping[str, str] = {"ouster": ".json"}
"""Families whose calibration usually lies beside a capture, and the ending of its name."""


@runtime_checkable
class SelfCalibrating(Protocol):
    """A family whose sensors send their calibration among their packets."""

    def is_calibration(self, payloads: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Tell which UDP payloads, shape (P, L), hold a calibration."""
        ...
