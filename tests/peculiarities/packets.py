"""Peculiarities of packets of sensors, in captures and packet topics."""

from functools import partial

import numpy as np

from seaclutter_cli.sensors.packets import DecoderOptions, Packets
from seaclutter_cli.sensors.robosense.decoder import RoboSense
from tests.peculiarities.case import Case
from tests.sources.pcap.captures import frames, pcap, sensor_packets

ROWS = sensor_packets(64, step=100)


def decoded():
    """Return the points of each revolution of the packets as they were sent."""
    times, payloads = zip(*((time_ns, np.frombuffer(data, np.uint8)) for time_ns, data, _ in ROWS), strict=True)
    packets = Packets(np.array(times), np.array(payloads))
    decoder = RoboSense().decoder(packets, DecoderOptions())
    found = [frame.points for frame in (*decoder.add(packets), *decoder.finish())]
    return [np.column_stack([points[name] for name in ("x", "y", "z", "intensity")]) for points in found]


def doubled(folder, **options):
    copies = [(time_ns + 2_000, packet) for time_ns, packet in frames(ROWS, "VLAN", **options)]
    return written(folder, sorted([*frames(ROWS), *copies], key=lambda one: one[0]))


def swapped(folder):
    """Each fifth packet comes after the next one, also those at the end of a revolution."""
    times, order = [time_ns for time_ns, _ in frames(ROWS)], list(range(len(ROWS)))
    for at in range(4, len(order) - 1, 5):
        order[at], order[at + 1] = order[at + 1], order[at]
    packets = [packet for _, packet in frames(ROWS)]
    return written(folder, [(time_ns, packets[row]) for time_ns, row in zip(times, order, strict=True)])


def written(folder, packets):
    path = folder / "log.pcap"
    path.write_bytes(pcap(packets))
    return path


CASES = [
    Case(
        name="packets twice",
        source="https://wiki.wireshark.org/CaptureSetup/Ethernet: packets of bonded interfaces twice",
        build=doubled,
        frames=decoded(),
        says={"filter": "64 packets received again, left out", "info": "received again"},
    ),
    Case(
        name="packets twice, from two addresses",
        source="A mirrored port behind a router that translates addresses shows each packet before and after it.",
        build=partial(doubled, source="10.0.0.7"),
        frames=decoded(),
        says={"filter": "64 packets received again, left out", "info": "received again"},
    ),
    Case(
        name="packets swapped",
        source="UDP promises no order; network cards with several queues deliver neighbouring packets swapped.",
        build=swapped,
        frames=decoded(),
        says={"filter": "packets received late, put in order"},
    ),
]
