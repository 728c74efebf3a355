"""Packet decoders by lidar maker."""

from collections.abc import Mapping

from seaclutter_cli.registry import Registry
from seaclutter_cli.sensors.hesai.decoder import Hesai
from seaclutter_cli.sensors.ouster.decoder import Ouster
from seaclutter_cli.sensors.packets import PacketFamily
from seaclutter_cli.sensors.robosense.decoder import RoboSense
from seaclutter_cli.sensors.velodyne.decoder import Velodyne

_BUILT_IN: Mapping[str, PacketFamily] = {
    "robosense": RoboSense(),
    "velodyne": Velodyne(),
    "hesai": Hesai(),
    "ouster": Ouster(),
}
"""Families by name, tried in this order. Register new ones here."""


def _of_plugin(name: str, kind: type[PacketFamily]) -> Mapping[str, PacketFamily]:
    if not issubclass(kind, PacketFamily):
        raise TypeError("must be a class based on PacketFamily")
    return {name: kind()}


PACKET_FAMILIES = Registry("sensors", _BUILT_IN, _of_plugin)
"""Families by name, those of plug-ins last."""
