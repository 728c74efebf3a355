"""Packets of every driver that are received twice, late, or both give the frames of those that were sent."""

import numpy as np
import pytest

from tests.sources.pcap import captures
from tests.sources.pcap.captures import frames, pcap, udp
from tests.sources.shared.driver_topics import DRIVERS, write_capture, write_topic
from tests.sources.shared.test_robosense_topics import clouds

SENSORS = {driver.packets: name for name, driver in DRIVERS.items()}.values()
"""A driver of each sensor."""


def disordered(packets, spread=8):
    """Return packets of which each comes up to some packets late, but those at the beginning; times are in order."""
    late = np.arange(len(packets)) + np.random.default_rng(1).uniform(0, spread, len(packets))
    late[:2] = -1
    times = sorted(time_ns for time_ns, _ in packets)
    return [(time_ns, packets[row][1]) for time_ns, row in zip(times, np.argsort(late).tolist(), strict=True)]


def copied(packets, *delays_ns):
    return sorted(((time_ns + delay_ns, data) for time_ns, data in packets for delay_ns in delays_ns), key=by_time)


def by_time(packet):
    return packet[0]


def assert_equal(found, expected, *texts):
    (clouds_, warnings, damage, _) = found
    assert list(clouds_.values()) == list(expected[0].values())
    assert damage == expected[2]
    for text in texts:
        assert any(text in warning for warning in warnings), warnings
    assert not any("missing" in warning for warning in warnings)


@pytest.mark.parametrize("name", SENSORS)
def test_a_capture(name, tmp_path):
    """Each packet three times: twice at once, and once 50 ms later, in disorder."""
    driver = DRIVERS[name]
    options = {**driver.files(tmp_path), **driver.options}
    sent = driver.packets()
    expected = clouds(write_capture(driver, tmp_path / "sent.pcap", sent), **options)
    received = copied(disordered(sent), 0, 2_000, 50_000_000)
    found = clouds(write_capture(driver, tmp_path / "log.pcap", received), **options)
    assert_equal(found, expected, "packets received again, left out", "packets received late, put in order")


@pytest.mark.parametrize("name", ["rslidar_sdk", "rslidar", "velodyne", "pandar", "ouster_ros"])
def test_a_topic(name, tmp_path):
    """Each packet twice, and those after the first scan or messages in disorder."""
    driver = DRIVERS[name]
    sent = driver.packets()
    (tmp_path / "sent").mkdir()
    expected = clouds(write_topic(driver, "mcap", tmp_path / "sent", sent), **driver.options)
    received = copied(disordered(sent, 3), 0, 2_000)
    found = clouds(write_topic(driver, "mcap", tmp_path, received), **driver.options)
    assert_equal(found, expected, "received again, left out", "received late, put in order")


def test_bonded_interfaces(tmp_path):
    """Copies that a switch has routed or tagged have other headers, and may come in fragments."""
    rows = captures.sensor_packets()
    (tmp_path / "sent.pcap").write_bytes(pcap(frames(rows)))
    expected = clouds(tmp_path / "sent.pcap")
    routed = [(time_ns + 3_000, packet[:22] + b"\x3f" + packet[23:]) for time_ns, packet in frames(rows)]
    tagged = [(time_ns + 5_000, packet) for time_ns, packet in frames(rows, "VLAN")]
    parts = [captures.fragments(udp(data, port, port), number) for number, (_, data, port) in enumerate(rows)]
    pieces = [
        (row[0] + 7_000 + at, captures.ETHERNET + one)
        for row, part in zip(rows, parts, strict=True)
        for at, one in enumerate(part * 2)
    ]
    (tmp_path / "log.pcap").write_bytes(pcap(sorted([*frames(rows), *routed, *tagged, *pieces], key=by_time)))
    found = clouds(tmp_path / "log.pcap")
    assert_equal(found, expected, f"{3 * 75} packets received again, left out")
    assert not any("fragment" in warning for warning in found[1])


@pytest.mark.parametrize("name", ["rslidar_sdk", "velodyne", "pandar", "ouster_ros"])
def test_losses_are_counted_as_without_disorder(name, tmp_path):
    driver = DRIVERS[name]
    options = {**driver.files(tmp_path), **driver.options}
    sent = [packet for number, packet in enumerate(driver.packets()) if number % 5 != 3]
    expected = clouds(write_capture(driver, tmp_path / "sent.pcap", sent), **options)
    found = clouds(write_capture(driver, tmp_path / "log.pcap", copied(disordered(sent), 0, 9_000)), **options)
    assert list(found[0].values()) == list(expected[0].values())
    assert [text for text in expected[1] if "missing" in text] == [text for text in found[1] if "missing" in text] != []
