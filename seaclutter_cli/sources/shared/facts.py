"""Sensor facts of logs without packets."""

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from seaclutter_cli.documents import DocumentError, load_json
from seaclutter_cli.records import Attachment, Metadata, SensorFacts
from seaclutter_cli.sensors.catalog import SENSORS

NO_FACTS: Mapping[str, SensorFacts] = MappingProxyType({})
"""Sensor facts of a log without packets."""


def simulated_facts(extras: Iterable[Attachment | Metadata]) -> Mapping[str, SensorFacts]:
    """Return the lidar that a log by `simulate` names in its metadata record ``scene``; empty for other logs."""
    for record in extras:
        if isinstance(record, Metadata) and record.name == "scene":
            try:
                model = load_json(record.entries["scene"])["recording"]["lidar"]
            except (DocumentError, KeyError, TypeError):
                continue
            if isinstance(model, str) and model in SENSORS:
                return {"/points": SensorFacts(model, {"origin": "simulated"}, from_packets=False)}
    return NO_FACTS
