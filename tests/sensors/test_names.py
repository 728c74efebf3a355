"""Whatever a decoder names can be named on the command line."""

import pytest

from seaclutter_cli.sensors import SENSORS, hesai_models, robosense_models, velodyne_packets

NAMES = [
    *robosense_models.MODELS,
    *(model.name for model in hesai_models.MODELS),
    *(model.name for model in velodyne_packets.MODELS.values()),
    velodyne_packets.VLP32B.name,
]


@pytest.mark.parametrize("name", NAMES)
def test_a_decoder_s_model_is_a_known_sensor(name):
    assert name in SENSORS
