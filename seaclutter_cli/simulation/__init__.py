"""Simulated lidar recordings and airborne tiles, with labels."""
