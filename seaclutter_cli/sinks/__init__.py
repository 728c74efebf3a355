"""Consumers of filtered frames: the filtered MCAP file and the CSV table of frames."""

from seaclutter_cli.sinks.csv import CsvSink
from seaclutter_cli.sinks.mcap import McapOptions, McapSink

__all__ = ["CsvSink", "McapOptions", "McapSink"]
