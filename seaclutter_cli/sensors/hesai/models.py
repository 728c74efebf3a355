"""Supported Hesai sensors: what distinguishes their packets, angles and firing times."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from itertools import chain, product
from typing import Any

import numpy as np

from seaclutter_cli.arrays import Floats, Ints, Mask, Rows
from seaclutter_cli.sensors.packets import unix_seconds

Layouts = Mapping[int, np.dtype[Any]]
"""Layouts of packets by their length in bytes."""

RETURN_MODES = {
    0x33: "first",
    0x34: "second",
    0x37: "strongest",
    0x38: "last",
    0x39: "last, strongest",
    0x3A: "first, second",
    0x3B: "last, first",
    0x3C: "first, strongest",
    0x3E: "strongest, second strongest",
}
"""Returns by the mode code in a packet, in the order of the blocks that contain them."""

DUAL_MODES = [mode for mode, names in RETURN_MODES.items() if "," in names]
"""Codes of modes with two returns."""

_MARK: list[Any] = [("start", "u1", 2)]
_BYTES = ("status_version", "reserved", "lasers", "blocks_number", "first_return", "unit_mm", "returns", "flags")
_HEADER = [*_MARK, ("version", "u1", 2), *((name, "u1") for name in _BYTES)]
_NONE: list[Any] = []
_STATUS = [("status", "u1", 8)]
_TAIL: list[Any] = [("rpm", "<u2"), ("microseconds", "<u4"), ("mode", "u1"), ("factory", "u1"), ("utc", "u1", 6)]
_LATE_TAIL = [_TAIL[at] for at in (2, 0, 4, 1, 3)]
_SEQUENCE, _CHECKSUM, _TAIL_CHECKSUM = [("sequence", "<u4")], [("checksum", "<u4")], [("tail_checksum", "<u4")]
_MAY_NUMBER, _MAY_SIGN = (_SEQUENCE, _NONE), ([("signature", "u1", 32)], _NONE)


def _blocks(
    blocks: int, lasers: int, unit_bytes: int, mark: list[Any] | None = None, fine: list[Any] | None = None
) -> list[Any]:
    """Return the field of the blocks of a packet; ``fine`` is a field after the azimuth."""
    names, formats = ["distance", "intensity"], ["<u2", "u1"]
    unit: Any = {"names": names, "formats": formats, "offsets": [0, 2], "itemsize": unit_bytes}
    fields = [*(mark or []), ("azimuth", "<u2"), *(fine or []), ("units", np.dtype(unit), lasers)]
    return [("blocks", np.dtype(fields), blocks)]


def _layouts(*parts: list[Any] | tuple[list[Any], ...]) -> Layouts:
    """Return the layouts of packets of some parts; of a tuple, a packet has one of its alternatives."""
    choices = [part if isinstance(part, tuple) else (part,) for part in parts]
    layouts = [np.dtype(list(chain.from_iterable(packet))) for packet in product(*choices)]
    return {layout.itemsize: layout for layout in layouts}


_PANDAR40 = _layouts(_blocks(10, 40, 3, _MARK), _STATUS, _TAIL, _MAY_NUMBER)
_PANDAR64_HEADER = [*_MARK, *_HEADER[4:6], ("reserved", "u1"), ("unit_mm", "u1"), ("spare", "u1", 2)]
_PANDAR64 = _layouts(_PANDAR64_HEADER, _blocks(6, 64, 3), _STATUS, _TAIL, _MAY_NUMBER)
_PANDARQT = _layouts(_HEADER, _blocks(4, 64, 4), [("status", "u1", 10)], _TAIL, _SEQUENCE)
_AT_BODY = [*_blocks(2, 128, 4, fine=[("fine", "u1")]), *_CHECKSUM, ("status", "u1", 18), *_TAIL]
_MIRRORS = _layouts(_HEADER, _AT_BODY, _MAY_NUMBER, _TAIL_CHECKSUM, _MAY_SIGN)
"""Packets of protocol 4.3: with and without sequence number and signature."""
_FLAGGED = _layouts(
    _HEADER,
    tuple(_blocks(2, 128, unit_bytes) for unit_bytes in (3, 4, 5, 6)),
    _CHECKSUM,
    ([("safety", "u1", 17)], _NONE),
    [("status", "u1", 5), ("mode_flag", "u1"), ("more_status", "u1", 3), ("azimuth_state", "<u2"), ("operation", "u1")],
    _LATE_TAIL,
    _MAY_NUMBER,
    ([("inertial", "u1", 22)], _NONE),
    _TAIL_CHECKSUM,
    _MAY_SIGN,
)
"""Packets of protocols 1.4 and 3.2, which have parts that flags announce and that their lengths determine.

These are up to three bytes after distance and intensity, functional safety, sequence number, inertial measurements and
signature.
"""


@dataclass(frozen=True)
class HesaiModel:
    """A Hesai sensor with C channels. Each block in a packet contains one firing or one return.

    Its name is that of the file with its nominal angles and firing times. Headers have the numbers of lasers and blocks
    of its layouts, the first numbers of a version, and a status version within bounds. ``block_ns`` is the time between
    two firings of all channels, or twice that in packets without high resolution if it has paces; the packet's time is
    ``last_block_ns`` before its last firing or, if there is one, ``first_block_ns`` before its first. Channels that do
    not always fire at the same times have ``states``, by block, shape (P, B). Distances below the least one are codes.
    If mirrors rotate instead of the lasers, directions are those of the unit, which has no nominal ones. Experimental
    decoders are not checked with real packets.
    """

    name: str
    layouts: Layouts
    block_ns: int
    version: tuple[int, ...] = ()
    status: tuple[int, int] = (0, 255)
    last_block_ns: int = 0
    first_block_ns: int | None = None
    states: Callable[[Rows], Ints] | None = None
    has_paces: bool = False
    least_distance: int = 1
    has_mirrors: bool = False
    is_experimental: bool = False

    @property
    def angles_deg(self) -> Floats:
        """Nominal elevations of channels, and offsets from the azimuth of their block, shape (2, C), in degrees."""
        return _read_table(self.name)[:, 1:3].T

    @property
    def channels(self) -> int:
        """Number of channels."""
        return len(_read_table(self.name))

    def matches(self, packets: Rows) -> Mask:
        """Return which packets, shape (P,), come from this sensor."""
        if "start" not in (packets.dtype.names or ()):
            return np.asarray((packets["blocks"]["start"] == (0xFF, 0xEE)).all(axis=(1, 2)))
        found = (packets["start"] == (0xEE, 0xFF)).all(axis=1) & (packets["unit_mm"] > 0)
        blocks, lasers = packets["blocks"]["units"].shape[1:]
        found &= (packets["lasers"] == lasers) & (packets["blocks_number"] == blocks)
        if self.version:
            found &= (packets["version"][:, : len(self.version)] == self.version).all(axis=1)
            found &= (packets["status_version"] >= self.status[0]) & (packets["status_version"] <= self.status[1])
        return np.asarray(found)

    def unit_m(self, packets: Rows) -> Floats:
        """Return the distance unit of each packet, shape (P,), in metres."""
        if "unit_mm" in (packets.dtype.names or ()):
            return np.asarray(packets["unit_mm"] / 1000.0)
        return np.full(len(packets), 0.004)

    def firings_ns(self, packets: Rows, returns: int) -> Ints:
        """Return the times of the F firings in each packet relative to the packet's time, shape (P, F)."""
        firings = packets["blocks"].shape[1] // returns
        times = self._steps_ns(packets)[:, None] * np.arange(firings)
        if self.first_block_ns is not None:
            return np.asarray(times + self.first_block_ns)
        return np.asarray(times + (self.last_block_ns - times[:, -1:]))

    def period_ns(self, packets: Rows, returns: int) -> float:
        """Return the time between packets of one return mode in nanoseconds."""
        return float(self._steps_ns(packets)[0] * packets["blocks"].shape[1] / returns)

    def _steps_ns(self, packets: Rows) -> Ints:
        """Return the time between two firings in each packet, shape (P,), in nanoseconds."""
        is_slow = packets["operation"] != 0 if self.has_paces else np.zeros(len(packets), np.bool_)
        return np.asarray(self.block_ns * (1 + is_slow.astype(np.int64)))

    def channels_ns(self, packets: Rows, returns: int) -> Ints:
        """Return the firing times of channels relative to their firings, shape (C,) or (P, F, C)."""
        by_state = _read_table(self.name)[:, 3:].T.astype(np.int64)
        return np.asarray(by_state[0 if self.states is None else self.states(packets)[:, ::returns]])


@cache
def _read_table(name: str) -> Floats:
    """Return channels, angles and firing times of a model, shape (C, 3 + S)."""
    lines = (files(__package__) / "tables" / f"{name}.csv").read_text("ascii").splitlines()
    return np.array([line.split(",") for line in lines[1:]], np.float64)


def _states_of_qt128(packets: Rows) -> Ints:
    """Return which of two halves of the channels fires in each block: it alternates."""
    dual = np.isin(packets["mode"], DUAL_MODES)
    firing = np.where(dual[:, None], 0, np.arange(packets["blocks"].shape[1]))
    return np.asarray((packets["mode_flag"].astype(np.int64)[:, None] + firing + 1) % 2)


def _states_of_128(packets: Rows) -> Ints:
    """Return the state in which each block fires: one of four with high resolution, one of two others without."""
    shifts = 14 - 2 * np.arange(packets["blocks"].shape[1])
    angle = packets["azimuth_state"].astype(np.int64)[:, None] >> shifts & 3
    return np.asarray(np.where(packets["operation"][:, None] == 0, angle, 4 + angle % 2))


def _xt(name: str, blocks: int, lasers: int) -> HesaiModel:
    layouts = _layouts(_HEADER, _blocks(blocks, lasers, 4), [("status", "u1", 10)], _LATE_TAIL, _SEQUENCE)
    return HesaiModel(name, layouts, 50_000, version=(6,), last_block_ns=5_632)


_P128: dict[str, Any] = {"version": (1, 4), "states": _states_of_128, "has_paces": True, "is_experimental": True}
"""What a Pandar128 and an OT128 share, which the versions in their status tell apart."""

MODELS = (
    _xt("PandarXT-32", 8, 32),
    _xt("PandarXT-16", 8, 16),
    _xt("PandarXT-32M2X", 6, 32),
    HesaiModel("Pandar40P", _PANDAR40, 55_560, last_block_ns=-28_580),
    HesaiModel("Pandar64", _PANDAR64, 55_560, last_block_ns=-42_580),
    HesaiModel("PandarQT", _PANDARQT, 166_667, version=(3, 1), first_block_ns=25_710),
    HesaiModel("PandarQT128", _FLAGGED, 111_110, version=(3, 2), first_block_ns=9_000, states=_states_of_qt128),
    HesaiModel("Pandar128", _FLAGGED, 27_778, status=(0, 127), last_block_ns=3_148, **_P128),
    HesaiModel("OT128", _FLAGGED, 27_778, status=(128, 136), least_distance=4, **_P128),
    HesaiModel("AT128", _MIRRORS, 41_666, (4, 3), last_block_ns=-50_915, has_mirrors=True, is_experimental=True),
)
"""Supported sensors. Times and angles are from their manuals or from the files that Hesai's SDK contains."""


def utc_ns(packets: Rows) -> Ints:
    """Return the time of each packet, shape (P,), in nanoseconds of Unix time.

    The six bytes are year, month, day, hour, minute and second; years below 70 count from 2000, others from 1900. A
    first byte of 0 means that the last four are seconds of Unix time, big-endian.
    """
    utc = packets["utc"].astype(np.int64)
    civil = unix_seconds(utc[:, 0] + np.where(utc[:, 0] < 70, 2000, 1900), *utc[:, 1:].T)
    counted = utc[:, 2:] @ np.array([1 << 24, 1 << 16, 1 << 8, 1])
    seconds = np.where(utc[:, 0] == 0, counted, civil)
    return np.asarray(seconds * 1_000_000_000 + packets["microseconds"].astype(np.int64) * 1000)
