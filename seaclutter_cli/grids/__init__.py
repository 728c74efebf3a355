"""Grids of the elevations of points, and their morphological opening."""
