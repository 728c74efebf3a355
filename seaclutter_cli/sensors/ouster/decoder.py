"""Decoder for Ouster sensors, based on their metadata."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Any

import numpy as np

from seaclutter_cli.arrays import Bytes, Indices, Ints, Mask, Rows
from seaclutter_cli.errors import InputError
from seaclutter_cli.records import SensorFacts
from seaclutter_cli.sensors.ouster.metadata import OusterMetadata, parse_metadata
from seaclutter_cli.sensors.packets import (
    DecoderOptions,
    PacketFamily,
    PacketFrame,
    Packets,
    SensorClock,
    make_points,
    view_packets,
)

_MAX_COLUMNS = 4096
_IMU_LENGTH = 48
_MAX_LOST_FRAMES = 1000


@dataclass(frozen=True)
class Profile:
    """Layout of the pixels in a column; each return has a range, in the bits of a mask, and an intensity."""

    pixel: np.dtype[Any]
    range_mask: int
    range_unit_mm: int = 1
    has_signal: bool = True

    @property
    def returns(self) -> int:
        """Number of returns of a pixel."""
        return int(self.pixel["range"].shape[0])


def _pixel(size: int, kinds: tuple[str, str], intensity_at: int, returns: int = 1) -> np.dtype[Any]:
    formats = [(kind, (returns,)) for kind in kinds]
    offsets = [0, intensity_at]
    return np.dtype({"names": ["range", "intensity"], "formats": formats, "offsets": offsets, "itemsize": size})


_SINGLE = _pixel(12, ("<u4", "<u2"), 6)
PROFILES = {
    "LEGACY": Profile(_SINGLE, 0xFFFFF),
    "RNG19_RFL8_SIG16_NIR16": Profile(_SINGLE, 0x7FFFF),
    "RNG19_RFL8_SIG16_NIR16_DUAL": Profile(_pixel(16, ("<u4", "<u2"), 8, returns=2), 0x7FFFF),
    "RNG15_RFL8_NIR8": Profile(_pixel(4, ("<u2", "u1"), 2), 0x7FFF, range_unit_mm=8, has_signal=False),
}
"""Profiles by name."""


@cache
def packet_layout(profile: str, rows: int, columns: int) -> np.dtype[Any]:
    """Return the layout of packets with the given numbers of columns and rows."""
    pixels = ("pixels", PROFILES[profile].pixel, rows)
    if profile == "LEGACY":
        head = [("time_ns", "<u8"), ("id", "<u2"), ("frame", "<u2"), ("encoder", "<u4")]
        column = np.dtype([*head, pixels, ("status", "<u4")])
        return np.dtype([("columns", column, columns)])
    column = np.dtype([("time_ns", "<u8"), ("id", "<u2"), ("status", "<u2"), pixels])
    top: list[Any] = [("type", "<u2"), ("frame", "<u2"), ("alerts", "u1", 3), ("serial", "u1", 5), ("state", "u1", 20)]
    return np.dtype([*top, ("columns", column, columns), ("footer", "u1", 32)])


def valid_columns(packets: Rows) -> Mask:
    """Return which columns of packets, shape (P, C), contain measurements."""
    status = packets["columns"]["status"]
    return np.asarray(status == 0xFFFFFFFF if status.dtype.itemsize == 4 else status & 1 == 1)


def first_columns(packets: Rows) -> Ints:
    """Return the id of the first column of each packet, shape (P,), according to its first valid column."""
    at = valid_columns(packets).argmax(axis=1)
    return np.asarray(packets["columns"]["id"][np.arange(len(packets)), at].astype(np.int64) - at)


def valid_packets(packets: Rows, columns: int) -> Mask:
    """Return which packets, shape (P,), are valid: consecutive ids among all columns, measured within one second."""
    ids = packets["columns"]["id"].astype(np.int64)
    count = ids.shape[1]
    valid = valid_columns(packets)
    valid |= ~valid.any(axis=1, keepdims=True)
    first = first_columns(packets)
    intact = (((ids - np.arange(count)) == first[:, None]) | ~valid).all(axis=1)
    intact &= (first >= 0) & (first % count == 0) & (first + count <= columns)
    times_ns = packets["columns"]["time_ns"]
    start_ns = times_ns[np.arange(len(ids)), valid.argmax(axis=1), None]
    intact &= ((times_ns - start_ns <= 1_000_000_000) | ~valid).all(axis=1) & (start_ns[:, 0] < 1 << 62)
    if "type" in (packets.dtype.names or ()):
        intact &= packets["type"] == 1
    return np.asarray(intact)


class _Decoder:
    """Decoder for the packets of one Ouster sensor.

    Points are in the sensor frame, x away from the connector and z up, column by column. The intensity is the signal in
    photons, or the reflectivity for profiles without a signal.

    State: packets of the incomplete revolution, a packet that may begin the next one until its successor is known, and
    the clock correction.
    """

    def __init__(self, metadata: OusterMetadata) -> None:
        profile = PROFILES[metadata.profile]
        self.facts = SensorFacts(metadata.model, _details(metadata))
        self._metadata = metadata
        self._profile = profile
        self._rows = len(metadata.altitude_rad)
        self._layout = packet_layout(metadata.profile, self._rows, metadata.packet_columns)
        self._expected = metadata.expected_packets()
        self.places_end = 0x10000 * len(self._expected)
        unit_m = np.float32(profile.range_unit_mm / 1000)
        directions, origins = metadata.directions()
        self._directions, self._origins = directions * unit_m, origins
        self._clock = SensorClock(self.facts)
        self._frame_id: int | None = None
        self._place = 0
        self._waiting: Packets | None = None
        self._pending: list[Packets] = []
        self._is_first = True

    def places(self, packets: Packets) -> Ints:
        """Return the number of each data packet since the revolution with the frame id 0, shape (P,); -1 for others."""
        data = view_packets(packets.payloads, self._layout)
        if not len(data):
            return np.full(len(packets), -1)
        frames = data["frame"] if "frame" in (data.dtype.names or ()) else data["columns"]["frame"][:, 0]
        return frames.astype(np.int64) * len(self._expected) + first_columns(data) // self._metadata.packet_columns

    def add(self, packets: Packets) -> Iterator[PacketFrame]:
        length = packets.payloads.shape[1]
        if length != self._layout.itemsize or not len(packets):
            self.facts.bad_packets += len(packets) if length != _IMU_LENGTH else 0
            return
        data = view_packets(packets.payloads, self._layout)
        valid = valid_packets(data, self._metadata.columns)
        self.facts.bad_packets += int((~valid).sum())
        useful = np.flatnonzero(valid & valid_columns(data).any(axis=1))
        if len(useful):
            known = self._metadata.serial
            if self._frame_id is None and self._waiting is None and known and "serial" in (data.dtype.names or ()):
                serial = str(int.from_bytes(data["serial"][useful[0]].tobytes(), "little"))
                if serial != known:
                    problem = f"the metadata is from sensor {known}, the packets are from {serial}"
                    self.facts.warnings.append(f"{problem}: the angles do not match")
            yield from self._add_valid(packets[useful])

    def _add_valid(self, packets: Packets) -> Iterator[PacketFrame]:
        """Add packets with measurements; a last one with another frame id waits for its successor."""
        if self._waiting is not None:
            packets, self._waiting = Packets.joined([self._waiting, packets]), None
        places = self.places(packets)
        ids = places // len(self._expected)
        starts = np.append(0, np.flatnonzero(np.diff(ids)) + 1).tolist()
        for start, end in zip(starts, [*starts[1:], len(ids)], strict=True):
            run = packets[start:end]
            if len(run) == 1 and self._frame_id not in (None, ids[start]):
                if end == len(ids):
                    self._waiting = run
                    return
                if _is_damaged(*places[[start, end]].tolist(), before=self._place, per_revolution=len(self._expected)):
                    self.facts.bad_packets += 1
                    continue
            yield from self._collect(int(ids[start]), run)
            self._place = int(places[end - 1])

    def finish(self) -> Iterator[PacketFrame]:
        if self._waiting is not None:
            yield from self._collect(int(self.places(self._waiting)[0]) // len(self._expected), self._waiting)
        if self._pending:
            yield self._complete(is_last=True)

    def _collect(self, frame_id: int, packets: Packets) -> Iterator[PacketFrame]:
        """Collect packets of one revolution; yield the previous revolution."""
        step = 0 if self._frame_id is None else (frame_id - self._frame_id + 0x8000) % 0x10000 - 0x8000
        if step == -1:  # late packets of the previous revolution
            self.facts.bad_packets += len(packets)
            return
        most = 2 * len(self._expected)
        if step and self._pending:
            yield self._complete()
            if 1 < step <= _MAX_LOST_FRAMES:
                self.facts.lost_packets += (step - 1) * int(self._expected.sum())
        self._frame_id = frame_id
        self._pending.append(packets)
        while sum(map(len, self._pending)) > most:
            together = Packets.joined(self._pending)
            self._pending = [together[:most]]
            yield self._complete()
            self._pending = [together[most:]]

    def _complete(self, *, is_last: bool = False) -> PacketFrame:
        packets, self._pending = Packets.joined(self._pending), []
        data, times_ns = view_packets(packets.payloads, self._layout), packets.times_ns
        partial = self._count_lost(data, is_last=is_last)
        valid = valid_columns(data)
        column_ns = np.where(valid, data["columns"]["time_ns"], 0).astype(np.int64)
        column_ns += self._clock.shifts(column_ns.max(axis=1), times_ns)[:, None]
        ids, indices = np.unique(np.where(valid, data["columns"]["id"].astype(np.int64), -1), return_index=True)
        ids, indices = ids[ids >= 0], indices[ids >= 0]
        column_ns = column_ns.ravel()[indices]
        return PacketFrame(self._points(data, ids, indices, column_ns), int(column_ns.max()), partial=partial)

    def _count_lost(self, data: Rows, *, is_last: bool) -> bool:
        """Count the lost packets of a revolution; return whether the recording begins or ends within it."""
        seen = np.zeros(len(self._expected), bool)
        seen[first_columns(data) // self._metadata.packet_columns] = True
        missing = np.flatnonzero(self._expected & ~seen)
        first, last = np.flatnonzero(seen)[[0, -1]]
        cut = ((missing < first) & self._is_first) | ((missing > last) & is_last)
        self._is_first = False
        self.facts.lost_packets += int((~cut).sum())
        return bool(cut.any())

    def _points(self, data: Rows, ids: Ints, indices: Indices, column_ns: Ints) -> Rows:
        """Return the points of columns, given their ids and flat indices, shape (C,), column by column."""
        pixels, returns = data["columns"]["pixels"], self._profile.returns
        shape = -1, self._rows, returns
        ranges, intensities = (pixels[name].reshape(shape)[indices] for name in ("range", "intensity"))
        ranges &= self._profile.range_mask
        hit = np.flatnonzero(ranges)
        column = np.repeat(np.arange(len(ids)), np.count_nonzero(ranges, axis=(1, 2)))
        beam, number = np.divmod(hit, returns)
        row = beam - column * self._rows
        pixel = beam if len(ids) == self._metadata.columns else ids[column] * self._rows + row
        units = ranges.ravel()[hit].astype(np.float32)
        beams = zip(self._directions, self._origins, strict=True)
        xyz = (units * direction.ravel()[pixel] + origin.ravel()[pixel] for direction, origin in beams)
        times_s, numbers = (column_ns / 1e9)[column], number + 1 if returns > 1 else None
        return make_points(xyz, intensities.ravel()[hit], row, times_s, numbers)


def _is_damaged(place: int, after: int, *, before: int, per_revolution: int) -> bool:
    """Return whether the place of a packet is not between those of its neighbours, at most a revolution apart."""
    total = 0x10000 * per_revolution
    gap = (after - before) % total
    return gap <= per_revolution and (place - before) % total > gap


def _details(metadata: OusterMetadata) -> dict[str, str]:
    profile, (first, last) = PROFILES[metadata.profile], metadata.window
    details = {
        "serial number": metadata.serial,
        "firmware": metadata.firmware,
        "profile": metadata.profile,
        "columns": f"{metadata.columns} per revolution, {first} to {last} sent",
        "timestamp mode": metadata.clock,
        "intensity": "signal, photons" if profile.has_signal else "reflectivity, 0 to 255: this profile has no signal",
        "return mode": "strongest, second strongest" if profile.returns > 1 else "single",
    }
    return {name: text for name, text in details.items() if text}


class Ouster(PacketFamily):
    """Ouster sensors."""

    title = "Ouster OS0, OS1, OS2"

    def recognises(self, payload: Bytes) -> bool:
        """Return whether a UDP payload, shape (L,), is a data packet of any Ouster sensor and profile."""
        layouts = (packet_layout(*shape) for shape in product(PROFILES, (128, 64, 32, 16), (16, 8, 4)))
        packets = (view_packets(payload[None], layout) for layout in layouts)
        return any(len(one) and valid_packets(one, _MAX_COLUMNS)[0] and valid_columns(one).any() for one in packets)

    def decoder(self, packets: Packets, options: DecoderOptions) -> _Decoder:
        """Return a decoder for the sensor that sent these packets; `InputError` without matching metadata."""
        if options.unit is None:
            raise InputError(
                "Ouster packets contain no beam angles: pass --calibration METADATA.json, the metadata file recorded "
                "with them"
            )
        name, metadata = options.unit[1], parse_metadata(*options.unit)
        if metadata.profile not in PROFILES:
            raise InputError(f"{name}: unsupported profile {metadata.profile}; supported: {', '.join(PROFILES)}")
        length = packet_layout(metadata.profile, len(metadata.altitude_rad), metadata.packet_columns).itemsize
        found = packets.payloads.shape[1]
        if len(packets) and found not in (length, _IMU_LENGTH):
            raise InputError(
                f"{name}: the metadata ({metadata.model}, {metadata.profile}) describes packets of "
                f"{length} bytes, the recorded ones have {found}: pass the metadata of this sensor"
            )
        return _Decoder(metadata)
