"""Velodyne packets: layout, clock, losses, and the azimuth at which revolutions are split."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.records import SensorFacts

FULL_CIRCLE = 36_000
_HOUR_NS = 3_600 * 10**9
MAX_REVOLUTION_NS = 500_000_000
CLOCK_NS = 1_000_000_000
BLIND_DEG = 20
TOLERANCE = 300

MODES = {0x37: "strongest", 0x38: "last", 0x39: "dual"}
DUAL = 0x39
_BANKS = (0xEEFF, 0xDDFF, 0xCCFF, 0xBBFF)

_BLOCK = np.dtype([("bank", "<u2"), ("azimuth", "<u2"), ("channels", "V96")])
PACKET = np.dtype([("blocks", _BLOCK, (12,)), ("time_us", "<u4"), ("mode", "u1"), ("model", "u1")])


@dataclass(frozen=True)
class VelodyneModel:
    """A sensor: name, name in the library, lasers, period of single-return packets (µs), blocks per column."""

    name: str
    library: str
    lasers: int
    period_us: float
    banks: int = 1

    @property
    def dual_rate(self) -> int:
        """Number of dual-return packets in the period of a single-return packet."""
        return 3 if self.banks > 1 else 2


MODELS: Mapping[int, VelodyneModel] = {
    0x21: VelodyneModel("HDL-32E", "HDL32E", 32, 552.96),
    0x22: VelodyneModel("VLP-16", "VLP16", 16, 1327.104),
    0x23: VelodyneModel("VLP-32A", "VLP32A", 32, 663.552),
    0x24: VelodyneModel("Puck Hi-Res", "PuckHiRes", 16, 1327.104),
    0x28: VelodyneModel("VLP-32C", "VLP32C", 32, 663.552),
    0xA1: VelodyneModel("Alpha Prime", "VLS128", 128, 173.4, banks=4),
}
"""Models by factory byte. VLP-32A and VLP-32B share one."""
VLP32B = VelodyneModel("VLP-32B", "VLP32B", 32, 663.552)


def view_packets(payloads: NDArray[np.uint8]) -> NDArray[Any]:
    """Return payloads, shape (P, L), as packets, shape (P,); empty if L is not the length of a packet."""
    if payloads.shape[1] != PACKET.itemsize:
        return np.empty(0, PACKET)
    return np.ascontiguousarray(payloads).view(PACKET).reshape(-1)


def valid_packets(packets: NDArray[Any]) -> NDArray[np.bool_]:
    """Return which packets, shape (P,), are valid. Models with one bank send only blocks of bank 0."""
    used = used_blocks(packets)
    blocks = packets["blocks"]
    many = packets["model"][:, None] == 0xA1
    flags = np.where(many, np.isin(blocks["bank"], _BANKS), blocks["bank"] == _BANKS[0])
    fit: NDArray[np.bool_] = np.all((flags & (blocks["azimuth"] < FULL_CIRCLE)) | ~used, axis=1)
    return fit & np.isin(packets["mode"], list(MODES))


def used_blocks(packets: NDArray[Any]) -> NDArray[np.bool_]:
    """Return which blocks contain data, shape (P, 12); the last four of a dual-return Alpha Prime do not."""
    short = (packets["model"] == 0xA1) & (packets["mode"] == DUAL)
    used: NDArray[np.bool_] = ~short[:, None] | (np.arange(12) < 8)
    return used


class VelodyneClock:
    """Converter from microseconds of the hour to Unix time; a clock that is not set follows the recording time."""

    def __init__(self, facts: SensorFacts) -> None:
        self._details = facts.details
        self._offset_ns: int | None = None

    def unix_ns(self, host_ns: NDArray[np.int64], time_us: NDArray[np.uint32]) -> NDArray[np.int64]:
        """Return the times of packets, shape (P,), in nanoseconds of Unix time, the nearest to the recording times."""
        times_ns = time_us.astype(np.int64) * 1000
        near = _near(host_ns, times_ns + (self._offset_ns or 0))
        if self._offset_ns is None or abs(host_ns[0] - near[0]) > CLOCK_NS:
            error = int((host_ns - _near(host_ns, times_ns))[0])
            self._offset_ns = error if abs(error) > CLOCK_NS else 0
            relation = "shifted to the recording time" if self._offset_ns else "consistent with the recording time"
            self._details["clock"] = f"sensor time, {relation}"
            near = _near(host_ns, times_ns + self._offset_ns)
        return near


def _near(host_ns: NDArray[np.int64], times_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the times nearest to the recording times that differ from given ones by whole hours."""
    return host_ns + (times_ns - host_ns + _HOUR_NS // 2) % _HOUR_NS - _HOUR_NS // 2


@dataclass(frozen=True)
class Cut:
    """Azimuth at which revolutions are split, in 0.01°, and whether the sensor measures in each degree from there on.

    ``blind`` is start and end of the blind sector in 0.01°; None without one.
    """

    azimuth: int
    covered: NDArray[np.bool_]
    blind: tuple[int, int] | None = None

    @classmethod
    def at_zero(cls) -> "Cut":
        """Return a cut at azimuth 0, without a blind sector."""
        return cls(0, np.ones(360, bool))

    @classmethod
    def find(cls, azimuths: NDArray[np.int64], times_ns: NDArray[np.int64]) -> "Cut | None":
        """Return the cut for packets with azimuths of shape (P, 12); None until they span a full revolution."""
        flat = azimuths.ravel()
        steps: NDArray[np.int64] = np.mod(np.diff(flat), FULL_CIRCLE)
        rotation = np.cumsum(np.where(steps < 3 * FULL_CIRCLE // 4, steps, 0))
        if not len(rotation) or rotation[-1] < FULL_CIRCLE:
            return cls.at_zero() if np.ptp(times_ns) > MAX_REVOLUTION_NS else None
        covered = np.zeros(360, bool)
        covered[flat[: np.searchsorted(rotation, FULL_CIRCLE) + 2] // 100] = True
        begin, size = _longest_gap(covered)
        if size < BLIND_DEG:
            return cls.at_zero()
        azimuth = (begin + size // 2) % 360
        return cls(azimuth * 100, np.roll(covered, -azimuth), (begin * 100, (begin + size) % 360 * 100))

    def revolution_starts(self, azimuths: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the flat indices of blocks, shape (P, 12), that start a revolution."""
        flat = ((azimuths - self.azimuth) % FULL_CIRCLE).ravel()
        return np.flatnonzero(np.diff(flat) < -int(self.covered.sum()) * 100 // 2) + 1

    def is_start(self, azimuth: int) -> bool:
        """Return whether the sensor measures nothing between the cut and an azimuth relative to it."""
        return not self.covered[: max(azimuth // 100 - 1, 0)].any()

    def is_end(self, azimuth: int) -> bool:
        """Return whether the sensor measures nothing between an azimuth relative to the cut and the next cut."""
        return not self.covered[azimuth // 100 + 2 :].any()


def _longest_gap(covered: NDArray[np.bool_]) -> tuple[int, int]:
    """Return start and size of the longest run of degrees without measurements, around the circle."""
    indices = np.flatnonzero(covered)
    sizes = np.diff(indices, append=indices[0] + len(covered)) - 1
    longest = int(sizes.argmax())
    return (int(indices[longest]) + 1) % len(covered), int(sizes[longest])


class VelodyneLosses:
    """Counter of lost packets, from gaps in the sensor time that the recording times confirm."""

    def __init__(self, facts: SensorFacts, model: VelodyneModel) -> None:
        self._facts, self._model = facts, model
        self._packets = np.empty(0, PACKET)
        self._host_ns = np.empty(0, np.int64)

    def add(self, packets: NDArray[Any], host_ns: NDArray[np.int64], cut: Cut | None) -> None:
        """Add the next packets; count the gaps between packets once the cut is known, and keep the last packet."""
        self._packets = np.concatenate((self._packets, packets))
        self._host_ns = np.concatenate((self._host_ns, host_ns))
        if cut is None or len(self._packets) < 2:
            return
        gaps: NDArray[np.int64] = np.mod(np.diff(self._packets["time_us"].astype(np.int64)) * 1000, _HOUR_NS)
        rates = np.where(self._packets["mode"][:-1] == DUAL, self._model.dual_rate, 1)
        missing = np.rint(gaps / (self._model.period_us * 1000) * rates).astype(np.int64) - 1
        real = np.abs(np.diff(self._host_ns) - gaps) < CLOCK_NS // 4
        self._facts.lost_packets += int(missing[(missing > 0) & real & ~self._blind_gaps(cut)].sum())
        self._packets, self._host_ns = self._packets[-1:], self._host_ns[-1:]

    def _blind_gaps(self, cut: Cut) -> NDArray[np.bool_]:
        """Return which gaps are due to the blind sector."""
        first = self._packets["blocks"]["azimuth"][:, 0].astype(np.int64)
        if cut.blind is None:
            return np.zeros(len(first) - 1, bool)
        begin, end = cut.blind
        self._facts.details["field of view"] = f"{end // 100}° to {begin // 100}°"
        jump: NDArray[np.int64] = np.mod(np.diff(first), FULL_CIRCLE)
        reach: NDArray[np.int64] = np.mod(begin - first[:-1] + TOLERANCE, FULL_CIRCLE)
        is_blind: NDArray[np.bool_] = (reach <= jump + TOLERANCE) & (jump < (end - begin) % FULL_CIRCLE + 5 * TOLERANCE)
        return is_blind
