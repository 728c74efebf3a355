"""What most sources have in common."""

from collections.abc import Mapping
from types import MappingProxyType

from seaclutter_cli.records import SensorFacts

NO_FACTS: Mapping[str, SensorFacts] = MappingProxyType({})
"""What a log without packets reveals of its sensors."""
