"""Placeholder of the sinks package."""
