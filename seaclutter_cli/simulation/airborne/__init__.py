"""Simulated tiles of an airborne lidar."""
