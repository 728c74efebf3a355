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


def _ns(times_us: str, lasers: str) -> tuple[int, ...]:
    """Return the firing time of each laser in nanoseconds, from times in microseconds and how many lasers fire then."""
    times_ns = [round(float(time) * 1000) for time in times_us.split()[: len(lasers)]]
    return tuple(np.repeat(times_ns, [*map(int, lasers)]).tolist())


_RS32_NS = (*range(0, 40321, 2880), 44640, *range(1440, 41761, 2880), 46080)
_BPEARL_NS = tuple(first + 2560 * laser for first in (0, 25680, 1280, 26960) for laser in range(8))
_HELIOS_NS = tuple(range(0, 53631, 1730))
_BPEARL_4_NS = tuple(round(1668 * laser, -1) for laser in range(32))
_RUBY_US = "0 3.236 6.472 9.708 12.944 16.18 19.416 22.652 25.888 29.124 32.36 35.596 38.832 42.068 45.304 48.54"
_RUBY_NS = 2 * _ns(_RUBY_US, "4444444444444444")
_RUBY_80_NS = _ns(_RUBY_US, "3243333222222223") + _ns(_RUBY_US, "3332423322232123")
_RUBY_48_NS = 2 * _ns(_RUBY_US, "1111222211112222")
_RUBY_PLUS_NS = _ns(
    "0 1.13 2.13 3.26 4.26 5.38 6.38 7.51 8.51 10.01 11.38 13.31 15.11 17.04 18.85 21.14 23.31 25.61 27.78 30.07 32.24 "
    "34.54 36.7 38.64 40.44 41.94 43.3 44.8 46.17 47.66 49.03 50.53 53.771",
    "444444444444444544444444444444421",
)
_RUBY_PLUS_80_US = (
    "0 1.217 2.434 3.652 4.869 6.086 7.304 8.521 9.739 11.323 12.907 14.924 16.941 18.959 20.976 23.127 25.278 27.428 "
    "29.579 31.963 34.347 36.498 38.648 40.666 42.683 50.603 52.187 53.771"
)
_RUBY_PLUS_80_NS = _ns(_RUBY_PLUS_80_US, "4423222222224444444444221132")
_RUBY_PLUS_80V_NS = _ns(_RUBY_PLUS_80_US, "44444444444444444444")
_RUBY_PLUS_48_NS = _ns(_RUBY_PLUS_80_US, "222222222222222222222222")
_AIRY_US = {
    "upright": "0 5.712 12.376 19.04 25.704 33.32 41.888 50.456 59.024 70.448 81.872 93.296",
    "side": "0 11.424 22.848 34.272 45.696 54.264 62.832 71.4 79.016 85.68 92.344 99.008",
    "M": "0 7.616 16.184 24.752 33.32 42.84 52.36 61.88 71.4 79.968 88.536 97.104",
}
_AIRY_NS = {mounting: _ns(times_us, "888888888888") for mounting, times_us in _AIRY_US.items()}
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
