"""Consumers of filtered frames: the filtered log and the CSV table of frames."""

from seaclutter_cli.sinks.csv import CsvSink
from seaclutter_cli.sinks.log import LogSink, McapOptions

__all__ = ["CsvSink", "LogSink", "McapOptions"]
