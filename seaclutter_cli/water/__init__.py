"""The water surface around a lidar, estimated from its own echoes."""

from seaclutter_cli.water.mounting import Mounting
from seaclutter_cli.water.mounting_search import MountingSearch
from seaclutter_cli.water.surface import WaterSurface
from seaclutter_cli.water.tracker import WaterTracker

__all__ = ["Mounting", "MountingSearch", "WaterSurface", "WaterTracker"]
