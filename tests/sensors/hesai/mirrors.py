"""Packets, angle correction files and points of a Hesai AT128, written value by value from their description."""

import math
import struct
from functools import cache
from hashlib import sha256

import numpy as np

from seaclutter_cli.sensors.packets import Packets

START_NS = 1_709_251_199 * 10**9
UTC = bytes((124, 2, 29, 23, 59, 59))
UNIT = 2
STARTS = (298_639, 1_833_026, 3_368_302)  # as in files of sensors: 23.3, 143.2 and 263.1 degrees
FULL = 360 * 25_600
BLOCK_NS = 41_666
PERIOD = 150  # packets after which the channels measure the same again
STEP = 1_280  # a twentieth of a degree of the motor between blocks
SINGLE, DUAL = 0x38, 0x39
FIRED_NS = {0: 0, 2: 8240, 3: 4112, 31: 848, 59: 13280, 127: 8264}
"""Firing times of some channels."""


def offset(kind, channel, node):
    """Return an entry of the tables of offsets."""
    return (7 * channel + 3 * node + (40 if kind == "azimuth" else 0)) % 81 - 40


def angle(kind, channel):
    return 165_316 - 2_550 * channel if kind == "elevation" else (-30_720, 8_320)[channel % 2]


def correction_file(version=5, channels=128, mirrors=STARTS, unit=UNIT):
    """Return the content of an angle correction file."""
    data = bytes((0xEE, 0xFF, 1, version, channels, len(mirrors), len(mirrors), *(1, 2, 4, 0, 0, 0, 0, 0), unit))
    data += struct.pack(f"<{len(mirrors)}I", *mirrors)
    data += struct.pack(f"<{len(mirrors)}I", *mirrors[1:], mirrors[0])
    for kind in ("azimuth", "elevation"):
        data += b"".join(struct.pack("<i", angle(kind, channel)) for channel in range(channels))
    for kind in ("azimuth", "elevation"):
        for channel in range(channels):
            data += struct.pack("<180b", *(offset(kind, channel, node) for node in range(180)))
    return data + sha256(data).digest()


def measured(number, channel, block, *, dual):
    """Return distance and intensity of a channel of a block of a packet."""
    firing = number if dual else 2 * number + block
    if (firing + channel) % 3 == 0:
        return 0, 0
    distance = 500 + 10 * channel + firing % 50
    return (distance + 300, 9) if dual and block and channel % 2 else (distance, channel)


@cache
def measured_by_all(number, block, *, dual):
    """Return the bytes of all channels of a block of a packet."""
    return b"".join(struct.pack("<HBB", *measured(number, k, block, dual=dual), 7) for k in range(128))


def make_packets(packets=3000, first=15.0, mode=SINGLE, signature=b"", *, numbered=True):
    """Return packets of a motor that begins a number of degrees after the start of the first field."""
    dual = mode == DUAL
    made, times, paused_ns = [], [], 0
    position = round(STARTS[0] * UNIT + first * 25_600)
    for number in range(packets):
        time_ns = START_NS + (number + 1) * BLOCK_NS * (1 if dual else 2) + paused_ns
        data = bytes((0xEE, 0xFF, 4, 3, 0, 0, 128, 2, 0, 4, 1 + dual, 1))
        for block in range(2):
            data += struct.pack("<HB", position % FULL // 256, position % 256)
            data += measured_by_all(number % PERIOD, block, dual=dual)
            position += STEP if block or not dual else 0
        micros = (time_ns - START_NS) // 1000
        data += bytes(4 + 18) + struct.pack("<HIBB6s", 2000, micros, mode, 0x42, UTC)
        data += struct.pack("<I", number + 1) if numbered else b""
        made.append(np.frombuffer(data + bytes(4) + signature, np.uint8))
        times.append(time_ns + 500_000)
        if (position - UNIT * STARTS[0]) % (120 * 25_600) >= 75 * 25_600:  # nothing is measured up to the next field
            position, paused_ns = position + 60 * 25_600, paused_ns + 50_000_000
    return Packets(np.array(times), np.stack(made))


def slow_points(packets, mode=SINGLE):
    """Yield field, channel, x, y, z, intensity, time in ns or None, and return number of all points in order."""
    for payload in packets.payloads:
        data = payload.tobytes()
        micros = struct.unpack_from("<I", data, 12 + 2 * 515 + 4 + 18 + 2)[0]
        sent_ns = START_NS + micros * 1000 - 9_249 - BLOCK_NS
        firings = [(0, 1)] if mode == DUAL else [(0,), (1,)]
        for late, blocks in enumerate(firings):
            start_ns = sent_ns - (len(firings) - 1 - late) * BLOCK_NS
            for channel in range(128):
                yield from _slow_channel(data, blocks, channel, start_ns)


def _slow_channel(data, blocks, channel, start_ns):
    seen = []
    for number, block in enumerate(blocks, 1):
        at = 12 + 515 * block
        azimuth, fine = struct.unpack_from("<HB", data, at)
        distance, intensity = struct.unpack_from("<HB", data, at + 3 + 4 * channel)
        if distance == 0 or (distance, intensity) in seen:
            continue
        seen.append((distance, intensity))
        position = azimuth * 256 + fine
        turned = {field: (position - UNIT * start) % FULL for field, start in enumerate(STARTS)}
        field = min(turned, key=turned.get)
        heading = 2 * turned[field] - UNIT * angle("azimuth", channel) + 256 * _between("azimuth", channel, position)
        height = UNIT * angle("elevation", channel) + 256 * _between("elevation", channel, position)
        phi, theta = math.radians(heading / 25_600), math.radians(height / 25_600)
        length = distance * 0.004
        x, y = length * math.cos(theta) * math.sin(phi), length * math.cos(theta) * math.cos(phi)
        fired_ns = start_ns + FIRED_NS[channel] if channel in FIRED_NS else None
        yield field, channel, x, y, length * math.sin(theta), intensity, fired_ns, number


def _between(kind, channel, position):
    """Return the interpolated offset at a position, rounded half away from 0."""
    node, rest = divmod(position, 2 * 25_600)
    one, other = (UNIT * offset(kind, channel, number % 180) for number in (node, node + 1))
    value = one + (other - one) * rest / (2 * 25_600)
    return int(math.copysign(math.floor(abs(value) + 0.5), value))
