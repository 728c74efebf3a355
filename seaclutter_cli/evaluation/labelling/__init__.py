"""Checks of labels against the points: mistakes that give wrong rates without an error."""
