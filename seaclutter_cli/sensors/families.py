"""Packet decoders by lidar maker."""

from collections.abc import Mapping

from seaclutter_cli.sensors.hesai.decoder import Hesai
from seaclutter_cli.sensors.ouster.decoder import Ouster
from seaclutter_cli.sensors.packets import PacketFamily
from seaclutter_cli.sensors.robosense.decoder import RoboSense
from seaclutter_cli.sensors.robosense.solid import RoboSenseSolid
from seaclutter_cli.sensors.velodyne.decoder import Velodyne

PACKET_FAMILIES: Mapping[str, PacketFamily] = {
    "robosense": RoboSense(),
    "robosense_solid": RoboSenseSolid(),
    "velodyne": Velodyne(),
    "hesai": Hesai(),
    "ouster": Ouster(),
}
"""Families by name, tried in this order. Register new ones here."""
