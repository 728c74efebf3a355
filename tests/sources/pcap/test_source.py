"""Frames of the sensors in captures of every format."""

import struct
from contextlib import closing

import numpy as np
import pytest

from seaclutter_cli.errors import InputError
from seaclutter_cli.messages import find_codec
from seaclutter_cli.sensors.packets import DecoderOptions
from seaclutter_cli.simulation.marine.recording import ethernet_udp, pcap_header, pcap_record
from seaclutter_cli.sources.formats import open_source
from seaclutter_cli.sources.pcap.records import PcapngReader, PcapReader
from seaclutter_cli.sources.shared.log_file import LogFile
from tests.sources.pcap import captures
from tests.sources.pcap.captures import LINKS, START_NS, enhanced, frames, interface, ipv4, ipv6, pcap, section, udp

ROWS = captures.sensor_packets()


def read(path, data=None, **options):
    """Return the source, and the clouds by topic."""
    if data is not None:
        path.write_bytes(data)
    with closing(open_source(path, decoding=DecoderOptions(**options))) as source:
        messages = list(source.records())
    clouds = {channel.topic: [] for channel in source.channels}
    for message in messages:
        clouds[message.channel.topic].append(find_codec(message.channel).decode(message.data))
    assert [m.log_time_ns for m in messages] == sorted(m.log_time_ns for m in messages)
    return source, clouds


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    """Return the clouds of the simplest capture."""
    source, clouds = read(tmp_path_factory.mktemp("capture") / "log.pcap", pcap(frames(ROWS), nano=True))
    assert source.format == "PCAP of RS-LiDAR-32"
    assert not source.damage + source.warnings
    assert list(clouds) == ["/points"]
    assert len(clouds["/points"]) == 3
    assert sum(cloud.size for cloud in clouds["/points"]) == 75 * 12 * 32
    return [(cloud.stamp_ns, bytes(cloud.data)) for cloud in clouds["/points"]]


def contents(clouds):
    return [(cloud.stamp_ns, bytes(cloud.data)) for cloud in clouds]


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("nano", [False, True])
def test_classic_captures(tmp_path, expected, order, nano):
    source, clouds = read(tmp_path / "log.cap", pcap(frames(ROWS), order=order, nano=nano))
    assert contents(clouds["/points"]) == expected
    assert not source.damage


@pytest.mark.parametrize("link", LINKS)
@pytest.mark.parametrize("options", [b"", bytes(24)], ids=["", "IP options"])
def test_links(tmp_path, expected, link, options):
    data = pcap(frames(ROWS, link, options=options), link=LINKS[link][0])
    assert contents(read(tmp_path / "log.pcap", data)[1]["/points"]) == expected


def test_ipv6(tmp_path, expected):
    records = [(time, bytes(12) + b"\x86\xdd" + ipv6(udp(payload, port, port))) for time, payload, port in ROWS]
    assert contents(read(tmp_path / "log.pcap", pcap(records))[1]["/points"]) == expected


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("kind", [2, 6])
@pytest.mark.parametrize(("resolution", "ticks"), [(None, 10**6), (9, 10**9), (0x80 | 20, 2**20), (3, 1000)])
def test_pcapng(tmp_path, expected, order, kind, resolution, ticks):
    records = [enhanced(time * ticks // 10**9, packet, order, kind=kind) for time, packet in frames(ROWS)]
    data = section(order) + interface(order, resolution=resolution) + b"".join(records)
    assert contents(read(tmp_path / "log.pcapng", data)[1]["/points"]) == expected


def test_pcapng_with_several_sections_and_interfaces(tmp_path, expected):
    """Each section has its own byte order and interfaces; unknown blocks are skipped."""
    data = b""
    for number, (time, packet) in enumerate(frames(ROWS)):
        if number % 10 == 0:
            order = "<>"[number // 10 % 2]
            data += section(order) + captures.block(5, bytes(11), order) + interface(order, link=113)
            data += interface(order, offset_s=1_000_000_000)
        packet = packet if number % 3 else bytes(14) + packet[12:]  # noqa: PLW2901
        ticks = time // 1000 - (10**15 if number % 3 else 0)
        data += enhanced(ticks, packet, order, number=1 if number % 3 else 0)
    assert contents(read(tmp_path / "log.pcapng", data)[1]["/points"]) == expected


def test_simple_packets_have_no_time(tmp_path):
    blocks = [captures.block(3, struct.pack("<I", len(packet)) + packet) for _, packet in frames(ROWS)]
    _, clouds = read(tmp_path / "log.pcapng", section() + interface() + b"".join(blocks))
    assert sum(cloud.size for cloud in clouds["/points"]) == 75 * 12 * 32


@pytest.mark.parametrize("backwards", [False, True])
def test_fragments(tmp_path, expected, backwards):
    records = []
    for number, (time, payload, port) in enumerate(ROWS):
        parts = captures.fragments(udp(payload, port, port), number)
        records += [(time, captures.ETHERNET + part) for part in (parts[::-1] if backwards else parts)]
    source, clouds = read(tmp_path / "log.pcap", pcap(records))
    assert contents(clouds["/points"]) == expected
    del records[7]
    source, _ = read(tmp_path / "log.pcap", pcap(records))
    assert source.warnings[0] == "fragments of 1 datagram are missing"
    assert "1 packet missing" in source.warnings[1]


def test_other_traffic_is_ignored(tmp_path, expected):
    records = []
    for number, (time, packet) in enumerate(frames(ROWS)):
        others = [
            bytes(12) + b"\x08\x06" + bytes(28),
            captures.ETHERNET + ipv4(bytes(40), protocol=6),
            captures.ETHERNET + ipv4(udp(b"$GPRMC," * number, 10110, 10110)),
            captures.ETHERNET + ipv4(udp(bytes(1248), 9, 9), source="10.0.0.7"),
            bytes(number),
            captures.ETHERNET + bytes((0x4F, 0)),
        ]
        records += [(time, packet), *((time + 1, other) for other in others if other)]
    source, clouds = read(tmp_path / "log.pcap", pcap(records))
    assert contents(clouds["/points"]) == expected
    assert not source.damage


def test_several_sensors(tmp_path, expected):
    second = captures.sensor_packets(seed=1, start_ns=START_NS + 10**6)
    records = sorted(frames(ROWS) + frames(second, source="192.168.1.201"))
    _, clouds = read(tmp_path / "log.pcap", pcap(records))
    assert list(clouds) == ["/points/192.168.1.200", "/points/192.168.1.201"]
    assert contents(clouds["/points/192.168.1.200"]) == expected


def test_several_sensors_at_one_address(tmp_path, expected):
    second = [(time, data, port + 10) for time, data, port in captures.sensor_packets(seed=1)]
    _, clouds = read(tmp_path / "log.pcap", pcap(sorted(frames(ROWS) + frames(second))))
    assert list(clouds) == ["/points/192.168.1.200/6699", "/points/192.168.1.200/6709"]
    assert contents(clouds["/points/192.168.1.200/6699"]) == expected


def test_data_and_information_on_one_port(tmp_path, expected):
    rows = [(time, payload, 2368) for time, payload, _ in ROWS]
    assert contents(read(tmp_path / "log.pcap", pcap(frames(rows)))[1]["/points"]) == expected


def test_information_after_thousands_of_packets(tmp_path):
    rows = captures.sensor_packets(2000)
    rows.append(rows.pop(1000))
    assert rows[-1][2] == 7788
    _, clouds = read(tmp_path / "log.pcap", pcap(frames(rows)))
    assert sum(cloud.size for cloud in clouds["/points"]) == 2000 * 12 * 32


def test_captures_of_the_writer(tmp_path, expected):
    path = tmp_path / "log.pcap"
    packets = ((time, ethernet_udp(port, data)) for time, data, port in ROWS)
    path.write_bytes(b"".join((pcap_header(), *(pcap_record(*packet) for packet in packets))))
    assert contents(read(path)[1]["/points"]) == expected


def test_without_information(tmp_path):
    path, angles = tmp_path / "log.pcap", tmp_path / "angle.csv"
    path.write_bytes(pcap(frames([row for row in ROWS if row[2] == 6699])))
    with pytest.raises(InputError, match=r"192\.168\.1\.200: RoboSense.*--sensor.*--calibration"):
        open_source(path)
    pairs = zip(captures.ANGLES.vertical / 100, captures.ANGLES.horizontal / 100, strict=True)
    angles.write_text("\n".join(f"{vertical},{horizontal}" for vertical, horizontal in pairs))
    _, clouds = read(path, calibration=angles, model="RS-LiDAR-32")
    assert sum(cloud.size for cloud in clouds["/points"]) == 75 * 12 * 32


def test_captures_without_known_sensors(tmp_path):
    path = tmp_path / "log.pcap"
    path.write_bytes(pcap(frames([(time, payload[:900], port) for time, payload, port in ROWS])))
    with pytest.raises(
        InputError, match=r"75 UDP datagrams of 900 bytes from 192\.168\.1\.200:6699 to port 6699.*RoboSense"
    ):
        open_source(path)
    path.write_bytes(pcap(frames(ROWS), snap=96))
    with pytest.raises(InputError, match="76 truncated datagrams"):
        open_source(path)
    path.write_bytes(pcap([]))
    with pytest.raises(InputError, match="no complete UDP datagrams"):
        open_source(path)
    for size in (1, 4, 23):
        path.write_bytes(pcap(frames(ROWS))[:size])
        with pytest.raises(InputError):
            open_source(path)


class TestDamage:
    def test_truncated_packets_are_counted(self, tmp_path):
        records = frames(ROWS)
        data = pcap(records[:71]) + pcap(records[71:], snap=200)[24:]
        source, clouds = read(tmp_path / "log.pcap", data)
        assert [str(item).partition("/points: ")[2] for item in source.damage] == [
            "5 packets truncated by the capture; left out: 6,240 bytes"
        ]
        assert sum(cloud.size for cloud in clouds["/points"]) == 70 * 12 * 32

    def test_a_hole_is_skipped(self, tmp_path):
        data = bytearray(pcap(frames(ROWS)))
        at = 24 + 5 * (16 + 42 + 1248)
        data[at + 4 : at + 16] = b"\xff" * 12
        source, clouds = read(tmp_path / "log.pcap", bytes(data))
        assert [(item.offset, item.lost_bytes) for item in source.damage] == [(at, 1306)]
        assert sum(cloud.size for cloud in clouds["/points"]) == 74 * 12 * 32

    def test_zeros_in_the_middle(self, tmp_path):
        data = pcap(frames(ROWS))
        at = 24 + 7 * 1306
        source, clouds = read(tmp_path / "log.pcap", data[:at] + bytes(50_001) + data[at:])
        assert [(item.offset, item.lost_bytes) for item in source.damage] == [(at, 50_001)]
        assert sum(cloud.size for cloud in clouds["/points"]) == 75 * 12 * 32

    def test_a_hole_in_pcapng(self, tmp_path):
        blocks = [enhanced(time // 1000, packet) for time, packet in frames(ROWS)]
        head = section() + interface()
        data = head + b"".join(blocks[:5]) + bytes(99) + b"".join(blocks[5:])
        source, clouds = read(tmp_path / "log.pcapng", data)
        at = len(head) + sum(map(len, blocks[:5]))
        assert [(item.offset, item.lost_bytes) for item in source.damage] == [(at, 99)]
        assert sum(cloud.size for cloud in clouds["/points"]) == 75 * 12 * 32

    @pytest.mark.parametrize("kind", [7 << 24 | 6, 12, 0x106])
    def test_a_damaged_kind_in_pcapng(self, tmp_path, kind):
        blocks = [enhanced(time // 1000, packet) for time, packet in frames(ROWS)]
        head = section() + interface()
        blocks[5] = struct.pack("<I", kind) + blocks[5][4:]
        source, clouds = read(tmp_path / "log.pcapng", head + b"".join(blocks))
        at = len(head) + sum(map(len, blocks[:5]))
        assert [(item.offset, item.lost_bytes) for item in source.damage] == [(at, len(blocks[5]))]
        assert sum(cloud.size for cloud in clouds["/points"]) == 74 * 12 * 32

    @pytest.mark.parametrize("kind", [4, 5, 10, 0xBAD, 0x80000001])
    def test_blocks_without_packets_in_pcapng_are_no_damage(self, tmp_path, kind):
        blocks = [enhanced(time // 1000, packet) for time, packet in frames(ROWS)]
        blocks.insert(5, struct.pack("<II8xI", kind, 20, 20))
        source, _ = read(tmp_path / "log.pcapng", section() + interface() + b"".join(blocks))
        assert source.damage == []

    def test_a_damaged_length_of_a_datagram(self, tmp_path):
        rows = captures.sensor_packets(300)
        records = frames(rows)
        at = records[50][1].index(struct.pack(">HHH", 6699, 6699, 1256))
        packet = bytearray(records[50][1])
        packet[at + 4 : at + 6] = struct.pack(">H", 1000)
        records[50] = records[50][0], bytes(packet)
        source, clouds = read(tmp_path / "log.pcap", pcap(records))
        assert [item.lost_bytes for item in source.damage] == [992]
        assert sum(cloud.size for cloud in clouds["/points"]) == 299 * 12 * 32

    def test_a_time_beyond_those_of_messages(self, tmp_path):
        rows = [(time + 3_000_000_000 * 10**9, data, port) for time, data, port in captures.sensor_packets(75)]
        records = [(min(time, (2**32 - 1) * 10**9), packet) for time, packet in frames(rows)]
        _, clouds = read(tmp_path / "log.pcap", pcap(records))
        assert sum(cloud.size for cloud in clouds["/points"]) == 75 * 12 * 32

    @pytest.mark.parametrize("form", ["pcap", "pcapng"])
    def test_cut_at_every_byte_of_the_last_packets(self, tmp_path, form):
        records = frames(captures.sensor_packets(6))
        blocks = [enhanced(time // 1000, packet) for time, packet in records]
        head = section() + interface()
        data = pcap(records) if form == "pcap" else head + b"".join(blocks)
        sizes = [1306] * 7 if form == "pcap" else [len(block) for block in blocks]
        ends = np.cumsum([24 if form == "pcap" else len(head), *sizes])
        path = tmp_path / f"log.{form}"
        for size in [*range(int(ends[-3]), int(ends[-2]), 40), *range(int(ends[-2]), len(data) + 1)]:
            whole = int(np.searchsorted(ends, size, "right")) - 1
            left = int(size - ends[whole])
            path.write_bytes(data[:size])
            reader = (PcapReader if form == "pcap" else PcapngReader)(LogFile(path), path)
            assert sum(len(records.offsets) for records in reader.batches()) == whole
            assert [item.lost_bytes for item in reader.damage] == ([left] if left else [])
            if size % 41 == 0:
                source, clouds = read(path)
                assert sum(cloud.size for cloud in clouds["/points"]) == (whole - 1) * 12 * 32
                assert source.damage == reader.damage

    @pytest.mark.parametrize("address", [{"source": "192.168.1.72"}, {}])
    def test_damaged_addresses_are_not_sensors(self, tmp_path, address):
        rows = captures.sensor_packets(300)
        records = frames(rows)
        records[50:52] = frames([(time, data, 6699 if address else 99) for time, data, _ in rows[50:52]], **address)
        source, clouds = read(tmp_path / "log.pcap", pcap(records))
        assert list(clouds) == ["/points"]
        assert [(item.problem.partition(" from ")[0], item.lost_bytes) for item in source.damage] == [
            ("2 packets", 2496)
        ]
        assert sum(cloud.size for cloud in clouds["/points"]) == 298 * 12 * 32

    def test_bad_packets_are_counted(self, tmp_path):
        rows = [
            (time, b"\1" * 1248 if number in (3, 9) else data, port) for number, (time, data, port) in enumerate(ROWS)
        ]
        rows.insert(4, (rows[4][0], b"\2" * 100, 6699))
        source, clouds = read(tmp_path / "log.pcap", pcap(frames(rows)))
        assert ["2 packets that cannot be decoded" in item.problem for item in source.damage] == [True]
        assert source.facts["/points"].bad_packets == 2
        assert source.facts["/points"].lost_packets == 2
        assert sum(cloud.size for cloud in clouds["/points"]) == 73 * 12 * 32
