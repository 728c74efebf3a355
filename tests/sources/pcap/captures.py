"""Captures of every link layer and file format, made without the program's own writer."""

import ipaddress
import struct

import numpy as np

from seaclutter_cli.sensors.robosense.models import MODELS
from seaclutter_cli.sensors.robosense.packets import Columns, make_angles, write_data, write_info

START_NS = 1_760_000_000 * 10**9
MODEL = MODELS["RS-LiDAR-32"]
ANGLES = make_angles(np.arange(32) * 100 - 2500, np.arange(32) % 4 * 300 - 450)
PERIOD_NS = MODEL.packet_ns


def sensor_packets(packets=75, step=100, seed=0, start_ns=START_NS):
    """Return (time, payload, port) of a sensor with few packets per revolution; device information is in the middle."""
    random = np.random.default_rng(seed)
    blocks = packets * 12
    times = start_ns + np.arange(packets) * PERIOD_NS
    columns = Columns(
        np.arange(blocks) * step % 36000,
        random.uniform(1, 100, (blocks, 32)),
        random.integers(0, 256, (blocks, 32)),
        times,
    )
    rows = [
        (int(time) + 700_000, payload.tobytes(), 6699)
        for time, payload in zip(times, write_data(MODEL, columns), strict=True)
    ]
    rows.insert(packets // 2, (rows[packets // 2][0] - 1000, write_info(MODEL, ANGLES).tobytes(), 7788))
    return rows


def udp(payload, source_port=6699, port=6699):
    return struct.pack(">HHHH", source_port, port, 8 + len(payload), 0) + payload


def ipv4(data, source="192.168.1.200", *, options=b"", number=0, flags=0, protocol=17):
    head = struct.pack(
        ">BBHHHBBH", 0x40 | 5 + len(options) // 4, 0, 20 + len(options) + len(data), number, flags, 64, protocol, 0
    )
    return head + ipaddress.ip_address(source).packed + bytes((192, 168, 1, 102)) + options + data


def ipv6(data, source="fe80::12"):
    addresses = ipaddress.ip_address(source).packed + ipaddress.ip_address("fe80::1").packed
    return struct.pack(">IHBB", 6 << 28, len(data), 17, 64) + addresses + data


def fragments(data, number, size=504):
    """Return the fragments of an IPv4 packet."""
    offsets = range(0, len(data), size)
    return [
        ipv4(data[offset : offset + size], number=number, flags=offset // 8 | 0x2000 * (offset + size < len(data)))
        for offset in offsets
    ]


ETHERNET = bytes(12) + b"\x08\x00"
LINKS = {
    "ethernet": (1, lambda ip: ETHERNET + ip),
    "ethernet, padded": (1, lambda ip: ETHERNET + ip + bytes(6)),
    "VLAN": (1, lambda ip: bytes(12) + b"\x81\x00\x00\x07\x08\x00" + ip),
    "stacked VLAN": (1, lambda ip: bytes(12) + b"\x88\xa8\x00\x02\x81\x00\x00\x07\x08\x00" + ip),
    "cooked": (113, lambda ip: bytes(14) + b"\x08\x00" + ip),
    "cooked, VLAN": (113, lambda ip: bytes(14) + b"\x81\x00\x00\x07\x08\x00" + ip),
    "cooked 2": (276, lambda ip: b"\x08\x00" + bytes(18) + ip),
    "raw": (101, lambda ip: ip),
    "raw IPv4": (228, lambda ip: ip),
    "null": (0, lambda ip: b"\x02\0\0\0" + ip),
    "loop": (108, lambda ip: b"\0\0\0\x02" + ip),
}


def pcap(records, *, order="<", nano=False, link=1, snap=262144):
    """Return a classic capture of (time, packet)."""
    magic, tick = (0xA1B23C4D, 1) if nano else (0xA1B2C3D4, 1000)
    parts = [struct.pack(order + "IHHiIII", magic, 2, 4, 0, 0, snap, link)]
    for time_ns, packet in records:
        seconds, rest = divmod(time_ns, 10**9)
        kept = packet[:snap]
        parts.append(struct.pack(order + "IIII", seconds, rest // tick, len(kept), len(packet)) + kept)
    return b"".join(parts)


def block(kind, body, order="<"):
    size = 12 + (len(body) + 3) // 4 * 4
    return struct.pack(order + "II", kind, size) + body.ljust(size - 12, b"\0") + struct.pack(order + "I", size)


def section(order="<"):
    return block(0x0A0D0D0A, struct.pack(order + "IHHq", 0x1A2B3C4D, 1, 0, -1), order)


def interface(order="<", link=1, resolution=None, offset_s=None):
    body = struct.pack(order + "HHI", link, 0, 0)
    if resolution is not None:
        body += struct.pack(order + "HHB3x", 9, 1, resolution)
    if offset_s is not None:
        body += struct.pack(order + "HHq", 14, 8, offset_s)
    return block(1, body + bytes(4), order)


def enhanced(time_ticks, packet, order="<", number=0, kind=6):
    ids = struct.pack(order + "I", number) if kind == 6 else struct.pack(order + "HH", number, 0)
    sizes = (time_ticks >> 32, time_ticks & 0xFFFFFFFF, len(packet), len(packet))
    return block(kind, ids + struct.pack(order + "IIII", *sizes) + packet, order)


def frames(rows, link="ethernet", **options):
    """Return (time, packet) of a sensor's rows."""
    wrap = LINKS[link][1]
    return [(time, wrap(ipv4(udp(payload, port, port), **options))) for time, payload, port in rows]
