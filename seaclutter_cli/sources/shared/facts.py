"""Sensor facts of logs without packets."""

from collections.abc import Mapping
from types import MappingProxyType

from seaclutter_cli.records import SensorFacts

NO_FACTS: Mapping[str, SensorFacts] = MappingProxyType({})
"""Sensor facts of a log without packets."""
