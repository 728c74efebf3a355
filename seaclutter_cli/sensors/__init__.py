"""Placeholder of the sensors package."""
