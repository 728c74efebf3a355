"""What Velodyne's packets hold: their layout, clock, losses, and where turns end."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.records import SensorFacts

TURN = 36_000
_HOUR_NS = 3_600 * 10**9
LONGEST_TURN_NS = 500_000_000
CLOCK_NS = 1_000_000_000
BLIND_DEG = 20
CLOSE = 300

MODES = {0x37: "strongest", 0x38: "last", 0x39: "dual"}
DUAL = 0x39
_BANKS = (0xEEFF, 0xDDFF, 0xCCFF, 0xBBFF)

_BLOCK = np.dtype([("bank", "<u2"), ("azimuth", "<u2"), ("channels", "V96")])
PACKET = np.dtype([("blocks", _BLOCK, (12,)), ("time_us", "<u4"), ("mode", "u1"), ("model", "u1")])


@dataclass(frozen=True)
class VelodyneModel:
    """A sensor: its name, the library's, lasers, microseconds in a packet of single returns, blocks per column."""

    name: str
    library: str
    lasers: int
    period_us: float
    banks: int = 1

    @property
    def shares(self) -> int:
        """Packets of dual returns in the time of one of single returns."""
        return 3 if self.banks > 1 else 2


MODELS: Mapping[int, VelodyneModel] = {
    0x21: VelodyneModel("HDL-32E", "HDL32E", 32, 552.96),
    0x22: VelodyneModel("VLP-16", "VLP16", 16, 1327.104),
    0x23: VelodyneModel("VLP-32A", "VLP32A", 32, 663.552),
    0x24: VelodyneModel("Puck Hi-Res", "PuckHiRes", 16, 1327.104),
    0x28: VelodyneModel("VLP-32C", "VLP32C", 32, 663.552),
    0xA1: VelodyneModel("Alpha Prime", "VLS128", 128, 173.4, banks=4),
}
"""Models by their factory byte. A VLP-32A and a VLP-32B have the same."""
VLP32B = VelodyneModel("VLP-32B", "VLP32B", 32, 663.552)


def view_packets(payloads: NDArray[np.uint8]) -> NDArray[Any]:
    """Return payloads, shape (P, L), as packets, shape (P,); none if they have another length."""
    if payloads.shape[1] != PACKET.itemsize:
        return np.empty(0, PACKET)
    return np.ascontiguousarray(payloads).view(PACKET).reshape(-1)


def are_sound(packets: NDArray[Any]) -> NDArray[np.bool_]:
    """Tell which packets, shape (P,), are whole; those of one bank consist of blocks of the first alone."""
    used = used_blocks(packets)
    blocks = packets["blocks"]
    many = packets["model"][:, None] == 0xA1
    flags = np.where(many, np.isin(blocks["bank"], _BANKS), blocks["bank"] == _BANKS[0])
    fit: NDArray[np.bool_] = np.all((flags & (blocks["azimuth"] < TURN)) | ~used, axis=1)
    return fit & np.isin(packets["mode"], list(MODES))


def used_blocks(packets: NDArray[Any]) -> NDArray[np.bool_]:
    """Return which blocks hold data, shape (P, 12): the last four of an Alpha Prime with dual returns do not."""
    short = (packets["model"] == 0xA1) & (packets["mode"] == DUAL)
    used: NDArray[np.bool_] = ~short[:, None] | (np.arange(12) < 8)
    return used


class VelodyneClock:
    """Turns microseconds of the hour into Unix time: by the sensor's clock if it is set, else moved to the host's."""

    def __init__(self, facts: SensorFacts) -> None:
        self._details = facts.details
        self._offset_ns: int | None = None

    def unix_ns(self, host_ns: NDArray[np.int64], time_us: NDArray[np.uint32]) -> NDArray[np.int64]:
        """Return the times of packets, shape (P,), in nanoseconds."""
        if self._offset_ns is None or abs(self._error_ns(host_ns, time_us)) > CLOCK_NS:
            self._offset_ns = 0
            error = self._error_ns(host_ns, time_us)
            self._offset_ns = error if abs(error) > CLOCK_NS else 0
            kept = "set to the time of recording" if self._offset_ns else "agrees with the time of recording"
            self._details["clock"] = f"sensor time, {kept}"
        return self._near(host_ns, time_us)

    def _error_ns(self, host_ns: NDArray[np.int64], time_us: NDArray[np.uint32]) -> int:
        return int((host_ns - self._near(host_ns, time_us))[0])

    def _near(self, host_ns: NDArray[np.int64], time_us: NDArray[np.uint32]) -> NDArray[np.int64]:
        """Return the times that these are in the hour that is nearest to the host's time."""
        offset = self._offset_ns or 0
        moved = time_us.astype(np.int64) * 1000 + offset
        return host_ns + (moved - host_ns + _HOUR_NS // 2) % _HOUR_NS - _HOUR_NS // 2


@dataclass(frozen=True)
class Cut:
    """Where turns end.

    Parameters
    ----------
    azimuth : int
        In 0.01°.
    covered : ndarray, shape (360,), bool
        Degrees from the cut on in which the sensor measures.
    blind : tuple of int or None
        Azimuths in 0.01° between which it does not.
    """

    azimuth: int
    covered: NDArray[np.bool_]
    blind: tuple[int, int] | None = None

    @classmethod
    def unknown(cls) -> "Cut":
        """Return the cut where less than a turn was recorded."""
        return cls(0, np.ones(360, bool))

    @classmethod
    def find(cls, azimuths: NDArray[np.int64], times_ns: NDArray[np.int64]) -> "Cut | None":
        """Return the cut for packets of azimuths (P, 12), None as long as they make no full turn."""
        flat = azimuths.ravel()
        steps: NDArray[np.int64] = np.mod(np.diff(flat), TURN)
        turned = np.cumsum(np.where(steps < 3 * TURN // 4, steps, 0))
        if not len(turned) or turned[-1] < TURN:
            return cls.unknown() if np.ptp(times_ns) > LONGEST_TURN_NS else None
        covered = np.zeros(360, bool)
        covered[flat[: np.searchsorted(turned, TURN) + 2] // 100] = True
        begin, size = _longest_gap(covered)
        if size < BLIND_DEG:
            return cls.unknown()
        azimuth = (begin + size // 2) % 360
        return cls(azimuth * 100, np.roll(covered, -azimuth), (begin * 100, (begin + size) % 360 * 100))

    def places(self, azimuths: NDArray[np.int64], *, after: int) -> NDArray[np.int64]:
        """Return which blocks of (P, 12) begin a turn, counted through, from one on."""
        flat = ((azimuths - self.azimuth) % TURN).ravel()[after:]
        enough = int(self.covered.sum()) * 100 // 2
        return np.flatnonzero(np.diff(flat) < -enough) + 1 + after

    def begins(self, azimuth: int) -> bool:
        """Tell whether the sensor measures nothing between the cut and an azimuth from there."""
        return not self.covered[: max(azimuth // 100 - 1, 0)].any()

    def ends(self, azimuth: int) -> bool:
        """Tell whether the sensor measures nothing between an azimuth from the cut and the next cut."""
        return not self.covered[azimuth // 100 + 2 :].any()


def _longest_gap(covered: NDArray[np.bool_]) -> tuple[int, int]:
    """Return beginning and size of the longest run of degrees that are not covered, around the circle."""
    places = np.flatnonzero(covered)
    sizes = np.diff(places, append=places[0] + len(covered)) - 1
    longest = int(sizes.argmax())
    return (int(places[longest]) + 1) % len(covered), int(sizes[longest])


class VelodyneLosses:
    """Counts packets that never arrived: gaps in the sensor's time that the host's time agrees with."""

    def __init__(self, facts: SensorFacts, model: VelodyneModel) -> None:
        self._facts, self._model = facts, model
        self._packets = np.empty(0, PACKET)
        self._host_ns = np.empty(0, np.int64)

    def hold(self, packets: NDArray[Any], host_ns: NDArray[np.int64]) -> None:
        """Take packets that are to be counted."""
        self._packets = np.concatenate((self._packets, packets))
        self._host_ns = np.concatenate((self._host_ns, host_ns))

    def count(self, cut: Cut) -> None:
        """Count the gaps between what is held, and keep the last packet."""
        if len(self._packets) < 2:
            return
        gaps: NDArray[np.int64] = np.mod(np.diff(self._packets["time_us"].astype(np.int64)) * 1000, _HOUR_NS)
        shares = np.where(self._packets["mode"][:-1] == DUAL, self._model.shares, 1)
        missing = np.rint(gaps / (self._model.period_us * 1000) * shares).astype(np.int64) - 1
        real = np.abs(np.diff(self._host_ns) - gaps) < CLOCK_NS // 4
        self._facts.lost_packets += int(missing[(missing > 0) & real & ~self._left_out(cut)].sum())
        self._packets, self._host_ns = self._packets[-1:], self._host_ns[-1:]

    def _left_out(self, cut: Cut) -> NDArray[np.bool_]:
        """Tell which gaps are the sector in which the sensor does not measure."""
        first = self._packets["blocks"]["azimuth"][:, 0].astype(np.int64)
        if cut.blind is None:
            return np.zeros(len(first) - 1, bool)
        begin, end = cut.blind
        self._facts.details["field of view"] = f"{end // 100}° to {begin // 100}°"
        jump: NDArray[np.int64] = np.mod(np.diff(first), TURN)
        reach: NDArray[np.int64] = np.mod(begin - first[:-1] + CLOSE, TURN)
        left_out: NDArray[np.bool_] = (reach <= jump + CLOSE) & (jump < (end - begin) % TURN + 5 * CLOSE)
        return left_out
