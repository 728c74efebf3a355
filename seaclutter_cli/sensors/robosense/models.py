"""What tells RoboSense's rotating lidars apart: lasers, units, timing."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

CHANNELS = 32
BLOCKS = 12


@dataclass(frozen=True)
class RobosenseModel:
    """A model, or a model with a firmware of other units.

    Parameters
    ----------
    name : str
        Name as in `SENSORS`.
    lasers : int
        Lasers; a block has 32 channels, so one of 16 lasers holds two firings or two returns.
    unit_m : float
        Distance unit in metres.
    range_m : tuple of float
        Least and greatest distance that counts as a return, in metres.
    block_ns : int
        Time from firing to firing.
    lens_m : tuple of float
        Offset of the lens forward from the axis and up, in metres.
    firing_ns : tuple of int
        When each laser fires, from the start of its firing.
    two_kinds : bool
        Whether the halves of a block are swapped where the highest bit of its first distance is set (old firmware).
    """

    name: str
    lasers: int
    unit_m: float
    range_m: tuple[float, float]
    block_ns: int
    lens_m: tuple[float, float]
    firing_ns: tuple[int, ...]
    two_kinds: bool = False

    @property
    def header(self) -> bytes:
        """First bytes of a data packet."""
        return HELIOS_ID if self.name == "RS-Helios" else CLASSIC_ID

    def firings(self, *, dual: bool) -> int:
        """Return how many firings a block holds."""
        return CHANNELS // self.lasers if not dual else 1

    def channel_ns(self, *, dual: bool) -> NDArray[np.int64]:
        """Return when each channel of a block fires, shape (32,), in nanoseconds from the block's time."""
        firing = np.tile(np.array(self.firing_ns, np.int64), CHANNELS // self.lasers)
        second = np.arange(CHANNELS) // self.lasers * self.block_ns
        return firing if dual else firing + second

    @property
    def packet_ns(self) -> int:
        """Time from the first firing of a packet to its sending, as RoboSense's driver takes it."""
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
    """Return a model as its firmware before 2019 has it: distances in centimetres, another timing of 32 lasers."""
    if model.lasers == CHANNELS:
        firing = tuple(3000 * (channel % 16) for channel in range(CHANNELS))
        return replace(model, unit_m=0.01, block_ns=50000, firing_ns=firing, two_kinds=True)
    return replace(model, unit_m=0.01)
