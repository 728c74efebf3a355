"""Logs in every supported format, each opened as a `Source`."""
