"""Filter sea clutter out of recorded marine lidar logs."""

__version__ = "0.1.0"
