"""Captures on the command line: information about them, and filtering."""

import json
import shutil
from contextlib import closing

import pytest

from seaclutter_cli.errors import InputError
from seaclutter_cli.sources.formats import open_source
from seaclutter_cli.sources.recordings import find_recordings
from tests.pairs import covering
from tests.paths import SHARED_DATA
from tests.running import execute as run
from tests.sources.pcap import captures
from tests.sources.pcap.captures import frames, pcap

ROWS = captures.sensor_packets()
OUSTER = SHARED_DATA / "ouster" / "OS-1-128_v2.3.0_1024x10_lb_n3.pcap"


@pytest.fixture
def capture(tmp_path):
    path = tmp_path / "log.pcap"
    path.write_bytes(pcap(frames(ROWS)))
    return path


def test_info_names_the_sensor_and_its_firmware(capture):
    result = run("info", capture)
    assert not result.exit_code
    words = " ".join(result.stdout.split())
    assert "PCAP of RS-LiDAR-32" in words
    assert "sensor RS-LiDAR-32; serial number: 5ea000000001; firmware: top board 0602090000" in words
    assert "partial revolutions: 1" in words
    assert "0 missing, 0 not decodable" in words
    (content,) = json.loads(run("info", capture, "--json", "-q").stdout)
    facts = content["sensors"]["/points"]
    assert (facts["model"], facts["lost_packets"], facts["bad_packets"]) == ("RS-LiDAR-32", 0, 0)
    assert facts["details"]["return mode"] == "single (strongest)"


def test_losses_are_reported(tmp_path):
    rows = [row for number, row in enumerate(ROWS) if number != 20]
    rows[30] = (rows[30][0], b"\1" * 1248, 6699)
    path = tmp_path / "log.pcap"
    path.write_bytes(pcap(frames(rows))[:-5])
    result = run("filter", path, "-o", tmp_path / "out.mcap", code=3)
    assert "the capture ends within a packet; left out: 1,301 bytes" in result.stderr
    assert "1 packet that cannot be decoded" in result.stderr
    assert "/points: 2 packets missing" in result.stderr


def test_several_sensors_need_a_choice(tmp_path):
    path = tmp_path / "log.pcap"
    path.write_bytes(pcap(sorted(frames(ROWS) + frames(captures.sensor_packets(seed=1), source="192.168.1.201"))))
    result = run("filter", path, "-o", tmp_path / "out.mcap", code=2)
    assert "-t /points/192.168.1.200 -t /points/192.168.1.201" in result.stderr
    result = run("filter", path, "-o", tmp_path / "out.mcap", "-t", "/points/192.168.1.201")
    assert not result.exit_code


def test_a_folder_of_captures(capture):
    shutil.copy(capture, capture.with_name("other.pcapng"))
    (capture.parent / "notes.txt").touch()
    assert [recording.name for recording in find_recordings([str(capture.parent)])] == ["log", "other"]


@pytest.mark.skipif(not OUSTER.is_file(), reason="the Ouster captures are missing")
class TestMetadataNextToCapture:
    def open(self, tmp_path, *metadata):
        path = tmp_path / "harbour_3.pcap"
        shutil.copy(OUSTER, path)
        for name in metadata:
            shutil.copy(OUSTER.with_name("OS-1-128_v2.3.0_1024x10.json"), tmp_path / name)
        with closing(open_source(path)) as source:
            return source.format, len(list(source.records()))

    @pytest.mark.parametrize("name", ["harbour_3.json", "harbour.json", "harbour_3_0.json"])
    def test_found(self, tmp_path, name):
        assert self.open(tmp_path, name, "other.json") == ("PCAP of OS1-128", 3)

    def test_not_found(self, tmp_path):
        with pytest.raises(InputError, match="--calibration"):
            self.open(tmp_path, "other.json")
        with pytest.raises(InputError, match="--calibration"):
            self.open(tmp_path, "harbour.json", "harbour_3_1.json")


def damaged(packet, offset, value):
    return packet[:offset] + bytes((value,)) + packet[offset + 1 :]


@pytest.mark.parametrize(
    ("link", "place"),
    covering(("ethernet", "ethernet, padded", "VLAN", "raw"), ("version", "protocol", "sender's header length")),
)
def test_packets_with_damaged_headers_are_damage(tmp_path, link, place):
    number, _ = captures.LINKS[link]
    packets = frames(ROWS, link)
    network = packets[0][1].index(b"\x45\x00")
    offset, value = {"version": (0, 0x05), "protocol": (9, 0x91), "sender's header length": (0, 0x41)}[place]
    packets[20] = packets[20][0], damaged(packets[20][1], network + offset, value)
    path = tmp_path / "log.pcap"
    path.write_bytes(pcap(packets, link=number))
    result = run("filter", path, "-o", tmp_path / "out.mcap", "--csv", tmp_path / "f.csv", code=3)
    assert "1 packet like those from 192.168.1.200:6699 to port 6699, with damaged headers" in result.stderr
    assert "left out: 1,248 bytes" in result.stderr


def test_other_traffic_of_the_same_length_is_no_damage(tmp_path):
    packets = frames(ROWS)
    size = len(packets[0][1])
    other = [(time + 1, bytes(12) + b"\x88\xcc" + bytes(size - 14)) for time, _ in packets[::7]]
    tcp = [(time + 2, damaged(captures.ETHERNET + captures.ipv4(bytes(size - 34)), 23, 6)) for time, _ in packets[::9]]
    path = tmp_path / "log.pcap"
    path.write_bytes(pcap(sorted([*packets, *other, *tcp])))
    run("filter", path, "-o", tmp_path / "out.mcap", code=0)
