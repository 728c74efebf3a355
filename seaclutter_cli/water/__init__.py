"""The water surface around a lidar, estimated from its own echoes."""

from seaclutter_cli.water.faces import Faces
from seaclutter_cli.water.mounting import Mounting
from seaclutter_cli.water.mounting_search import MountingSearch
from seaclutter_cli.water.surface import WaterSurface
from seaclutter_cli.water.tracker import WaterTracker

__all__ = ["Faces", "Mounting", "MountingSearch", "WaterSurface", "WaterTracker"]
