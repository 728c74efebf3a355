"""Scenes seen by an airborne lidar: tiles."""
