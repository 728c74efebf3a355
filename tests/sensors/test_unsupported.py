"""Packets of known sensors without a decoder are named wherever they occur."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from seaclutter_cli.commands import cli
from seaclutter_cli.errors import InputError
from seaclutter_cli.sensors.families import PACKET_FAMILIES
from seaclutter_cli.sensors.unsupported import name_unsupported
from seaclutter_cli.sources.formats import open_source
from tests.sources.pcap import captures
from tests.sources.shared.driver_topics import DRIVERS, write_topic

PACKETS = {
    "RoboSense RS-M2": bytes.fromhex("55aa5aa5").ljust(1342, b"\0"),
    "Hesai ATX (protocol 4.7)": b"\xee\xff\x04\x07".ljust(1127, b"\0"),
    "Hesai AT128 (protocol 4.1)": b"\xee\xff\x04\x01".ljust(1118, b"\0"),
    "Hesai JT128, or another with protocol 1.4 that is not a Pandar128 or OT128": b"\xee\xff\x01\x04".ljust(893, b"\0"),
}
START_NS = 1_760_000_000 * 10**9


def array(payload):
    return np.frombuffer(payload, np.uint8)


@pytest.mark.parametrize("name", PACKETS)
def test_names(name):
    assert name_unsupported(array(PACKETS[name])) == name


def test_packets_with_a_decoder_are_not_unsupported():
    for driver in DRIVERS.values():
        for _, payload in driver.packets()[:3]:
            assert name_unsupported(array(payload)) is None
            assert any(family.recognises(array(payload)) for family in PACKET_FAMILIES.values())


@pytest.mark.parametrize("name", PACKETS)
def test_captures(name, tmp_path):
    rows = [(START_NS + n * 10**6, PACKETS[name], 2368) for n in range(200)]
    path = tmp_path / "log.pcap"
    path.write_bytes(captures.pcap(captures.frames(rows)))
    with pytest.raises(InputError, match="not supported; record the sensor_msgs/PointCloud2") as error:
        open_source(path)
    assert name in str(error.value)


@pytest.mark.parametrize("name", PACKETS)
def test_topics(name, tmp_path):
    packets = [(START_NS + n * 10**6, PACKETS[name]) for n in range(300)]
    source = open_source(write_topic(DRIVERS["nebula"], "mcap", tmp_path, packets))
    assert any(f"packets of a {name} are not supported; record the" in text for text in source.warnings)
    source.close()


def test_info_names_it_beside_a_supported_sensor(tmp_path):
    rows = captures.sensor_packets(75)
    rows += [(time_ns, PACKETS["Hesai ATX (protocol 4.7)"], 2368) for time_ns, _, _ in rows]
    path = tmp_path / "log.pcap"
    path.write_bytes(captures.pcap(captures.frames(sorted(rows, key=lambda row: row[0]))))
    result = CliRunner().invoke(cli, ["info", str(path)])
    assert result.exit_code == 0
    assert "(Hesai ATX (protocol 4.7): not supported; record the" in result.output
    assert json.loads(CliRunner().invoke(cli, ["info", str(path), "--json"]).stdout)
