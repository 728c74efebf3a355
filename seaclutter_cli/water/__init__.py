"""The water surface around a lidar, estimated from its own echoes."""

from seaclutter_cli.water.surface import WaterSurface
from seaclutter_cli.water.tracker import WaterTracker

__all__ = ["WaterSurface", "WaterTracker"]
