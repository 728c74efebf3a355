"""Scenes at sea and on land, seen by a lidar on a vessel or vehicle."""
