"""Placeholder of the filters package."""
