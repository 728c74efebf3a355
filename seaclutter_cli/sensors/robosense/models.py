"""Lasers, units and timing of RoboSense's rotating lidars."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import hypot

import numpy as np

from seaclutter_cli.arrays import Ints

CHANNELS = 32
BLOCKS = 12
INFO_BYTES = 1248
"""Size of a device information packet, and of the data packets of most models."""


@dataclass(frozen=True)
class PacketFormat:
    """Layout of the packets of several models; offsets are in bytes.

    A data packet begins with ``id``, its blocks at ``begin``. The first two bytes of a block, big-endian, have a mask
    and a value. The time is in seconds (``is_utc``) instead of date and time. The horizontal angles in device
    information are at ``horizontal_at``. The return mode, which says whether there are two returns, is at ``mode_at``
    of data packets, or in device information (None). With halves, a block consists of two blocks, each with id, azimuth
    and half of the channels. Other bits of a distance than those of the mask have another meaning.
    """

    id: bytes
    begin: int = 42
    block_id: tuple[int, int] = (0xFFFF, 0xFFEE)
    time_at: int = 20
    is_utc: bool = False
    temperature_at: int = 38
    temperature_big_endian: bool = False
    horizontal_at: int = 564
    dual_modes: tuple[int, ...] = (0,)
    mode_at: int | None = None
    has_halves: bool = False
    distance_mask: int = 0xFFFF


CLASSIC_ID = bytes.fromhex("55aa050a")
HELIOS_ID = bytes.fromhex("55aa055a")

CLASSIC = PacketFormat(CLASSIC_ID)
HELIOS = PacketFormat(HELIOS_ID, is_utc=True)
RUBY = PacketFormat(HELIOS_ID, 80, (0xFF00, 0xFE00), 10, True, 8, True, 852, (3,))
AIRY = replace(HELIOS, horizontal_at=756, dual_modes=(3,), mode_at=17, has_halves=True, distance_mask=0x3FFF)
AIRY_48 = replace(AIRY, has_halves=False)
RUBY_PLUS = replace(RUBY, dual_modes=(3, 4, 5))


@dataclass(frozen=True)
class RobosenseModel:
    """A sensor model, with the units of its firmware.

    With 16 lasers, the 32 channels of a block contain two firings or two returns. ``block_ns`` is the time between
    firings, ``lens_m`` the offset of the lens from the axis, forward and up. ``firing_ns`` are the times of lasers
    since the start of their firing or, if there is one for each channel, since the start of a block with two firings.
    Old firmware swaps the halves of a block if the highest bit of its first distance is set. The unit of angles in
    device information is in hundredths of a degree.
    """

    name: str
    lasers: int
    unit_m: float
    range_m: tuple[float, float]
    block_ns: int
    lens_m: tuple[float, float]
    firing_ns: tuple[int, ...]
    format: PacketFormat = CLASSIC
    channels: int = CHANNELS
    blocks: int = BLOCKS
    angle_unit: float = 1
    swaps_halves: bool = False
    packet_bytes: int = INFO_BYTES

    def firings(self, *, dual: bool) -> int:
        """Return the number of firings in a block."""
        return self.channels // self.lasers if not dual else 1

    def channel_ns(self, *, dual: bool) -> Ints:
        """Return the firing time of each channel relative to its block, shape (C,), in nanoseconds."""
        times = np.array(self.firing_ns, np.int64)
        firing = np.tile(times[: self.lasers], self.channels // self.lasers)
        if dual:
            return firing
        if len(times) == self.channels:
            return times
        return firing + np.arange(self.channels) // self.lasers * self.block_ns

    @property
    def packet_ns(self) -> int:
        """Time from the first firing of a packet to its transmission in nanoseconds, as in RoboSense's driver."""
        return self.blocks * self.block_ns * (self.channels // self.lasers)


def _ns(text: str) -> tuple[int, ...]:
    """Return times in microseconds, each with its number of repetitions, as nanoseconds of each laser."""
    found: list[int] = []
    for word in text.split():
        time, _, times = word.partition("x")
        found += [round(float(time) * 1000)] * int(times or 1)
    return tuple(found)


_RS32_NS = (*range(0, 40321, 2880), 44640, *range(1440, 41761, 2880), 46080)
_BPEARL_NS = tuple(first + 2560 * laser for first in (0, 25680, 1280, 26960) for laser in range(8))
_HELIOS_NS = tuple(range(0, 53631, 1730))
_BPEARL_4_NS = _ns(
    "0 1.67 3.34 5 6.67 8.34 10.01 11.68 13.34 15.01 16.68 18.35 20.02 21.68 23.35 25.02 "
    "26.69 28.36 30.02 31.69 33.36 35.03 36.7 38.36 40.03 41.7 43.37 45.04 46.7 48.37 50.04 51.71"
)
_RUBY_NS = 2 * tuple(3236 * (laser // 4) for laser in range(64))
_RUBY_80_NS = _ns(
    "0x3 3.236x2 6.472x4 9.708x3 12.944x3 16.18x3 19.416x3 22.652x2 25.888x2 29.124x2 32.36x2 35.596x2 38.832x2 "
    "42.068x2 45.304x2 48.54x3 "
    "0x3 3.236x3 6.472x3 9.708x2 12.944x4 16.18x2 19.416x3 22.652x3 25.888x2 29.124x2 32.36x2 35.596x3 38.832x2 "
    "42.068 45.304x2 48.54x3"
)
_RUBY_48_NS = 2 * _ns(
    "0 3.236 6.472 9.708 12.944x2 16.18x2 19.416x2 22.652x2 25.888 29.124 32.36 35.596 38.832x2 42.068x2 45.304x2 "
    "48.54x2"
)
_RUBY_PLUS_NS = _ns(
    "0x4 1.13x4 2.13x4 3.26x4 4.26x4 5.38x4 6.38x4 7.51x4 8.51x4 10.01x4 11.38x4 13.31x4 15.11x4 17.04x4 18.85x4 "
    "21.14x5 23.31x4 25.61x4 27.78x4 30.07x4 32.24x4 34.54x4 36.7x4 38.64x4 40.44x4 41.94x4 43.3x4 44.8x4 46.17x4 "
    "47.66x4 49.03x4 50.53x2 53.771"
)
_RUBY_PLUS_80_NS = _ns(
    "0x4 1.217x4 2.434x2 3.652x3 4.869x2 6.086x2 7.304x2 8.521x2 9.739x2 11.323x2 12.907x2 14.924x2 16.941x4 18.959x4 "
    "20.976x4 23.127x4 25.278x4 27.428x4 29.579x4 31.963x4 34.347x4 36.498x4 38.648x2 40.666x2 42.683 50.603 52.187x3 "
    "53.771x2"
)
_RUBY_PLUS_80V_NS = _ns(
    "0x4 1.217x4 2.434x4 3.652x4 4.869x4 6.086x4 7.304x4 8.521x4 9.739x4 11.323x4 12.907x4 14.924x4 16.941x4 18.959x4 "
    "20.976x4 23.127x4 25.278x4 27.428x4 29.579x4 31.963x4"
)
_RUBY_PLUS_48_NS = _ns(
    "0x2 1.217x2 2.434x2 3.652x2 4.869x2 6.086x2 7.304x2 8.521x2 9.739x2 11.323x2 12.907x2 14.924x2 16.941x2 18.959x2 "
    "20.976x2 23.127x2 25.278x2 27.428x2 29.579x2 31.963x2 34.347x2 36.498x2 38.648x2 40.666x2"
)
_AIRY_NS = {
    "upright": _ns(
        "0x8 5.712x8 12.376x8 19.04x8 25.704x8 33.32x8 41.888x8 50.456x8 59.024x8 70.448x8 81.872x8 93.296x8"
    ),
    "side": _ns("0x8 11.424x8 22.848x8 34.272x8 45.696x8 54.264x8 62.832x8 71.4x8 79.016x8 85.68x8 92.344x8 99.008x8"),
    "M": _ns("0x8 7.616x8 16.184x8 24.752x8 33.32x8 42.84x8 52.36x8 61.88x8 71.4x8 79.968x8 88.536x8 97.104x8"),
}

_AIRY_48_NS = _AIRY_NS["M"][::2]
_AIRY_LENS_M = (hypot(0.0075, 0.00664), 0.04532)


def _ruby(name: str, blocks: int, block_ns: int, firing_ns: tuple[int, ...], layout: PacketFormat) -> RobosenseModel:
    lasers, lens_m = len(firing_ns), (0.03615 if layout is RUBY else 0.02892, 0)
    model = RobosenseModel(name, lasers, 0.005, (0.4, 250), block_ns, lens_m, firing_ns, layout, lasers, blocks)
    return replace(model, packet_bytes=1268) if lasers == 48 else model


BPEARL_4 = RobosenseModel(
    "RS-Bpearl", 32, 0.0025, (0.1, 150), 55560, (0.01619, 0.09571), _BPEARL_4_NS, replace(CLASSIC, is_utc=True)
)
"""The fourth version of the RS-Bpearl, which its packets state."""

MODELS: Mapping[str, RobosenseModel] = {
    model.name: model
    for model in (
        RobosenseModel("RS-LiDAR-32", 32, 0.005, (0.4, 230), 55520, (0.03997, 0), _RS32_NS, angle_unit=0.1),
        RobosenseModel("RS-LiDAR-16", 16, 0.005, (0.4, 230), 55500, (0.03825, 0), tuple(range(0, 42001, 2800))),
        RobosenseModel("RS-Bpearl", 32, 0.005, (0.1, 150), 55520, (0.01473, 0.09427), _BPEARL_NS),
        RobosenseModel("RS-Helios", 32, 0.0025, (0.1, 180), 55560, (0.03498, 0), _HELIOS_NS, HELIOS),
        RobosenseModel("RS-Helios-16P", 16, 0.0025, (0.1, 180), 55560, (0.03498, 0), _HELIOS_NS, HELIOS),
        _ruby("RS-Ruby", 3, 55550, _RUBY_NS, RUBY),
        _ruby("RS-Ruby-80", 4, 55552, _RUBY_80_NS, RUBY),
        _ruby("RS-Ruby-48", 8, 55552, _RUBY_48_NS, RUBY),
        _ruby("RS-Ruby-Plus", 3, 55560, _RUBY_PLUS_NS, RUBY_PLUS),
        _ruby("RS-Ruby-Plus-80", 4, 55560, _RUBY_PLUS_80_NS, RUBY_PLUS),
        _ruby("RS-Ruby-Plus-48", 8, 55560, _RUBY_PLUS_48_NS, RUBY_PLUS),
        RobosenseModel("RS-Airy", 96, 0.005, (0.1, 60), 111080, _AIRY_LENS_M, _AIRY_NS["M"], AIRY, 96, 4),
        RobosenseModel("RS-Airy-48", 48, 0.005, (0.1, 60), 111080, _AIRY_LENS_M, _AIRY_48_NS, AIRY_48, 48, 8),
    )
}
"""Models by name."""

DATA_BYTES = frozenset(model.packet_bytes for model in MODELS.values())
"""Sizes of data packets."""

CHECKED = ("RS-LiDAR-32", "RS-LiDAR-16", "RS-Helios")
"""Models whose decoder is not experimental."""

AIRY_BY_MOUNTING = {
    mode: replace(MODELS["RS-Airy"], firing_ns=_AIRY_NS[name]) for mode, name in enumerate(("upright", "side", "M"))
}
"""The RS-Airy by the mounting that its device information states."""
RUBY_PLUS_80V = replace(MODELS["RS-Ruby-Plus-80"], firing_ns=_RUBY_PLUS_80V_NS)
"""The RS-Ruby-Plus-80V, which its packets state."""


def with_old_firmware(model: RobosenseModel) -> RobosenseModel:
    """Return a model with firmware from before 2019: distances in centimetres, other timing for 32 lasers."""
    if model.lasers == CHANNELS:
        firing = tuple(3000 * (channel % 16) for channel in range(CHANNELS))
        return replace(model, unit_m=0.01, block_ns=50000, firing_ns=firing, swaps_halves=True)
    return replace(model, unit_m=0.01)
