"""Slow decoder for RoboSense packets, written value by value from the packet description."""

import calendar
import math
from dataclasses import dataclass
from functools import cache

import numpy as np

F = np.float32


@dataclass
class Kind:
    """A model; times in microseconds."""

    lasers: int
    unit: float
    least: float
    most: float
    block_us: float
    rx: float
    firing_us: list[float]
    helios: bool = False
    old: bool = False
    rz: float = 0.0
    ruby: bool = False
    channels: int = 32
    blocks: int = 12
    airy: bool = False
    masked: bool = False


RS32_US = [2.88 * c for c in range(15)] + [44.64] + [1.44 + 2.88 * c for c in range(15)] + [46.08]
BPEARL_US = [t + 2.56 * k for t in (0, 25.68, 1.28, 26.96) for k in range(8)]
BPEARL_4_US = [
    *(0, 1.67, 3.34, 5, 6.67, 8.34, 10.01, 11.68, 13.34, 15.01, 16.68, 18.35, 20.02, 21.68, 23.35, 25.02, 26.69, 28.36),
    *(30.02, 31.69, 33.36, 35.03, 36.7, 38.36, 40.03, 41.7, 43.37, 45.04, 46.7, 48.37, 50.04, 51.71),
]
RUBY_US = [3.236 * (c % 64 // 4) for c in range(128)]
RUBY_80_SIZES = [3, 2, 4, 3, 3, 3, 3, 2, 2, 2, 2, 2, 2, 2, 2, 3], [3, 3, 3, 2, 4, 2, 3, 3, 2, 2, 2, 3, 2, 1, 2, 3]
RUBY_80_US = [3.236 * step for sizes in RUBY_80_SIZES for step, size in enumerate(sizes) for _ in range(size)]
RUBY_48_STEPS = [0, 1, 2, 3, 4, 4, 5, 5, 6, 6, 7, 7, 8, 9, 10, 11, 12, 12, 13, 13, 14, 14, 15, 15]
RUBY_48_US = [3.236 * step for step in RUBY_48_STEPS] * 2
RUBY_PLUS_48_US = [
    *(0.0, 1.217, 2.434, 3.652, 4.869, 6.086, 7.304, 8.521, 9.739, 11.323, 12.907, 14.924, 16.941, 18.959, 20.976),
    *(23.127, 25.278, 27.428, 29.579, 31.963, 34.347, 36.498, 38.648, 40.666),
]
AIRY_US = [
    us
    for us in (0, 5.712, 12.376, 19.04, 25.704, 33.32, 41.888, 50.456, 59.024, 70.448, 81.872, 93.296)
    for _ in range(8)
]
AIRY_48_US = [
    us for us in (0, 7.616, 16.184, 24.752, 33.32, 42.84, 52.36, 61.88, 71.4, 79.968, 88.536, 97.104) for _ in range(4)
]
KINDS = {
    "RS-LiDAR-32": Kind(32, 0.005, 0.4, 230, 55.52, 0.03997, RS32_US),
    "RS-LiDAR-16": Kind(16, 0.005, 0.4, 230, 55.50, 0.03825, [2.8 * c for c in range(16)]),
    "RS-Helios": Kind(32, 0.0025, 0.1, 180, 55.56, 0.03498, [1.73 * c for c in range(32)], helios=True),
    "RS-Helios-16P": Kind(16, 0.0025, 0.1, 180, 55.56, 0.03498, [1.73 * c for c in range(32)], helios=True),
    "RS-Bpearl": Kind(32, 0.005, 0.1, 150, 55.52, 0.01473, BPEARL_US, rz=0.09427),
    "fourth RS-Bpearl": Kind(32, 0.0025, 0.1, 150, 55.56, 0.01619, BPEARL_4_US, helios=True, rz=0.09571),
    "RS-Ruby": Kind(128, 0.005, 0.4, 250, 55.55, 0.03615, RUBY_US, helios=True, ruby=True, channels=128, blocks=3),
    "RS-Ruby-80": Kind(80, 0.005, 0.4, 250, 55.552, 0.03615, RUBY_80_US, helios=True, ruby=True, channels=80, blocks=4),
    "RS-Ruby-48": Kind(48, 0.005, 0.4, 250, 55.552, 0.03615, RUBY_48_US, helios=True, ruby=True, channels=48, blocks=8),
    "RS-Ruby-Plus-48": Kind(
        48,
        0.005,
        0.4,
        250,
        55.56,
        0.02892,
        [us for us in RUBY_PLUS_48_US for _ in range(2)],
        helios=True,
        ruby=True,
        channels=48,
        blocks=8,
    ),
    "RS-Airy": Kind(
        96,
        0.005,
        0.1,
        60,
        111.08,
        math.hypot(0.0075, 0.00664),
        AIRY_US,
        helios=True,
        rz=0.04532,
        channels=96,
        blocks=4,
        airy=True,
    ),
    "RS-Airy-48": Kind(
        48,
        0.005,
        0.1,
        60,
        111.08,
        math.hypot(0.0075, 0.00664),
        AIRY_48_US,
        helios=True,
        rz=0.04532,
        channels=48,
        blocks=8,
        masked=True,
    ),
    "old RS-LiDAR-32": Kind(32, 0.01, 0.4, 230, 50, 0.03997, [3.0 * (c % 16) for c in range(32)], old=True),
}


@cache
def sine(hundredths):
    return F(math.sin(angle(hundredths)))


@cache
def cosine(hundredths):
    return F(math.cos(angle(hundredths)))


def angle(hundredths):
    return (hundredths if -9000 <= hundredths < 45000 else 0) * 0.01 * math.pi / 180


def header_time(packet, kind):
    if kind.ruby:
        packet = packet[10:20].rjust(30)
    if kind.helios:
        return int.from_bytes(packet[20:26], "big") + int.from_bytes(packet[26:30], "big") * 1e-6
    year, *rest = packet[20:26]
    sub = int.from_bytes(packet[26:28], "big") * 1e-3 + int.from_bytes(packet[28:30], "big") * 1e-6
    return calendar.timegm((2000 + year, *rest)) + sub


class Reference:
    """Decoder whose frames are lists of (x, y, z, intensity, ring, time, return) and the last channel's time."""

    def __init__(self, name, vertical, horizontal, *, dual=False, rps=10, fov=(0, 36000), reverse=False):
        self.kind, self.dual, self.name, self.reversed = KINDS[name], dual, name, reverse
        self.vertical, self.horizontal = list(vertical), list(horizontal)
        lasers = self.vertical[: self.kind.lasers]
        self.rings = [sum(other < own for other in lasers) for own in lasers]
        self.az_step = round(36000 * rps * self.kind.block_us * 1e-6)
        seen = fov[1] - fov[0] if fov[0] < fov[1] else fov[1] + 36000 - fov[0]
        self.gap_us = (36000 - seen) / (36000 * rps) * 1e6
        self.before = 0
        self.last_azimuth, self.repeats = None, False
        self.frames, self.points, self.end = [], [], None

    def add(self, packet):
        kind = self.kind
        begin, size = 80 if kind.ruby else 42, 4 + 3 * kind.channels
        if kind.airy:  # two blocks of 48 channels are one of 96
            size = 296
        blocks = [packet[begin + size * b : begin + size * (b + 1)] for b in range(kind.blocks)]
        az = [int.from_bytes(block[2:4], "big") for block in blocks]
        start = header_time(packet, kind)
        for b, (us, d) in enumerate(self.steps(az)):
            if blocks[b][0] != 0xFE if kind.ruby else blocks[b][:2] != b"\xff\xee":
                break
            self.split(az[b])
            self.block(b, blocks[b], az[b], d, start + us * 1e-6)

    def steps(self, az):
        """Return time and step of each block."""
        firings = 2 if self.kind.lasers == 16 and not self.dual else 1
        if self.kind.blocks == 3 and self.dual:
            return self.steps_of_three(az)
        stride = 2 if self.dual and self.kind.lasers > 16 else 1
        us, found = 0.0, []
        for b in range(0, self.kind.blocks, stride):
            d, period = self.az_step * firings, self.kind.block_us * firings
            if b + stride < self.kind.blocks:
                step = az[b + stride] - az[b]
                step += 36000 if step < 0 else 0
                if step > 100:
                    period = self.gap_us
                else:
                    d = step
            found += [(us, d)] * stride
            us += period
        return found

    def steps_of_three(self, az):
        """Return time and step of blocks AAB or ABB, where letters are firings."""
        d, period = (az[2] - az[0]) % 36000, self.kind.block_us
        if d > 100:
            d, period = self.az_step, self.gap_us
        if az[0] == az[1]:
            return [(0.0, d), (0.0, d), (period, self.az_step)]
        return [(0.0, d), (period, self.az_step), (period, self.az_step)]

    def split(self, az):
        self.repeats = az == self.last_azimuth
        self.last_azimuth = az
        before = self.before - 36000 if az < self.before else self.before
        if before < 0 <= az and self.points is not None and self.end is not None:
            self.finish()
        self.before = az

    def finish(self):
        self.frames.append((self.points, self.end))
        self.points, self.end = [], None

    def block(self, number, block, az, d, start):
        kind = self.kind
        if kind.airy:
            assert block[148:152] == block[:4]
            block = block[:148] + block[152:]
        raw = [int.from_bytes(block[4 + 3 * c : 6 + 3 * c], "big") for c in range(kind.channels)]
        intensity = [block[6 + 3 * c] for c in range(kind.channels)]
        if kind.airy or kind.masked:
            raw = [value & 0x3FFF for value in raw]
        if kind.old:
            if raw[0] & 0x8000:
                raw, intensity = raw[16:] + raw[:16], intensity[16:] + intensity[:16]
            raw = [value & 0x7FFF for value in raw]
        for c in range(kind.channels):
            laser, second = c % kind.lasers, c // kind.lasers
            period, f = kind.block_us, kind.firing_us[laser]
            if kind.lasers == 16 and not self.dual:
                f = kind.firing_us[c] if len(kind.firing_us) == 32 else f + second * kind.block_us
                period = 2 * kind.block_us
            time = start + f * 1e-6
            self.end = time
            azimuth = az + int(F(d) * F(f / period))
            r = F(raw[c]) * F(kind.unit)
            if raw[c] == 0 or not F(kind.least) <= r <= F(kind.most):
                continue
            v, h = self.vertical[laser], self.horizontal[laser]
            x = r * cosine(v) * cosine(azimuth + h) + F(kind.rx) * cosine(azimuth)
            y = -r * cosine(v) * sine(azimuth + h) - F(kind.rx) * sine(azimuth)
            z = r * sine(v) + F(kind.rz)
            y = -y if self.reversed else y
            half = self.repeats if kind.blocks == 3 else number % 2
            returned = 1 + (half if kind.lasers > 16 else second)
            self.points.append((x, y, z, F(intensity[c]), self.rings[laser], time, returned))
