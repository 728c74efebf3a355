"""Velodyne sensors, decoded by the library ``velodyne-decoder``."""
