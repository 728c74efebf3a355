"""Velodyne, decoded by the library ``velodyne-decoder``."""
