"""ASPRS classes of points."""

NEVER, OTHER, GROUND, WATER = 0, 1, 2, 9
"""Never classified (points without finite coordinates), unclassified, ground, water."""
