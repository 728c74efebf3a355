"""Lasers, units and timing of RoboSense's rotating lidars."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

CHANNELS = 32
BLOCKS = 12


@dataclass(frozen=True)
class RobosenseModel:
    """A sensor model, with the units of its firmware.

    Parameters
    ----------
    name : str
        Name as in `SENSORS`.
    lasers : int
        Number of lasers. With 16 lasers, the 32 channels of a block contain two firings or two returns.
    unit_m : float
        Distance unit in metres.
    range_m : tuple of float
        Least and greatest valid distance in metres.
    block_ns : int
        Time between firings in nanoseconds.
    lens_m : tuple of float
        Offset of the lens from the axis, forward and up, in metres.
    firing_ns : tuple of int
        Time of each laser relative to the start of its firing, in nanoseconds.
    swaps_halves : bool
        Whether the halves of a block are swapped if the highest bit of its first distance is set (old firmware).
    """

    name: str
    lasers: int
    unit_m: float
    range_m: tuple[float, float]
    block_ns: int
    lens_m: tuple[float, float]
    firing_ns: tuple[int, ...]
    swaps_halves: bool = False

    @property
    def header(self) -> bytes:
        """First bytes of a data packet."""
        return HELIOS_ID if self.name == "RS-Helios" else CLASSIC_ID

    def firings(self, *, dual: bool) -> int:
        """Return the number of firings in a block."""
        return CHANNELS // self.lasers if not dual else 1

    def channel_ns(self, *, dual: bool) -> NDArray[np.int64]:
        """Return the firing time of each channel relative to its block, shape (32,), in nanoseconds."""
        firing = np.tile(np.array(self.firing_ns, np.int64), CHANNELS // self.lasers)
        second = np.arange(CHANNELS) // self.lasers * self.block_ns
        return firing if dual else firing + second

    @property
    def packet_ns(self) -> int:
        """Time from the first firing of a packet to its transmission in nanoseconds, as in RoboSense's driver."""
        return BLOCKS * self.block_ns * (CHANNELS // self.lasers)


CLASSIC_ID = bytes.fromhex("55aa050a")
HELIOS_ID = bytes.fromhex("55aa055a")

_RS32_NS = (*range(0, 40321, 2880), 44640, *range(1440, 41761, 2880), 46080)

MODELS: Mapping[str, RobosenseModel] = {
    model.name: model
    for model in (
        RobosenseModel("RS-LiDAR-32", 32, 0.005, (0.4, 230), 55520, (0.03997, 0), _RS32_NS),
        RobosenseModel("RS-LiDAR-16", 16, 0.005, (0.4, 230), 55500, (0.03825, 0), tuple(range(0, 42001, 2800))),
        RobosenseModel("RS-Helios", 32, 0.0025, (0.1, 180), 55560, (0.03498, 0), tuple(range(0, 53631, 1730))),
    )
}
"""Models by name."""


def with_old_firmware(model: RobosenseModel) -> RobosenseModel:
    """Return a model with firmware from before 2019: distances in centimetres, other timing for 32 lasers."""
    if model.lasers == CHANNELS:
        firing = tuple(3000 * (channel % 16) for channel in range(CHANNELS))
        return replace(model, unit_m=0.01, block_ns=50000, firing_ns=firing, swaps_halves=True)
    return replace(model, unit_m=0.01)
