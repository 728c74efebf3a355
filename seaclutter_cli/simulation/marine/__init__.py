"""Simulated scenes at sea and on land, with a lidar on a vessel or vehicle."""
