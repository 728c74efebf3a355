"""Sensor names: every model of a decoder is a known sensor."""

import pytest

from seaclutter_cli.sensors.catalog import SENSORS
from seaclutter_cli.sensors.hesai import models as hesai_models
from seaclutter_cli.sensors.robosense import models as robosense_models
from seaclutter_cli.sensors.velodyne import packets as velodyne_packets

NAMES = [
    *robosense_models.MODELS,
    *(model.name for model in hesai_models.MODELS),
    *(model.name for model in velodyne_packets.MODELS.values()),
    velodyne_packets.VLP32B.name,
]


@pytest.mark.parametrize("name", NAMES)
def test_every_model_of_a_decoder_is_a_known_sensor(name):
    assert name in SENSORS
