"""Placeholder of the commands package."""
