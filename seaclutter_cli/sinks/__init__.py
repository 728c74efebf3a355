"""Consumers of filtered frames: the filtered log, frames as files, and the CSV table of frames."""
