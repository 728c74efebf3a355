"""Ouster sensors, by their metadata."""

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import InputError
from seaclutter_cli.records import SensorFacts
from seaclutter_cli.sensors.hesai.clock import SensorClock
from seaclutter_cli.sensors.ouster.metadata import OusterMetadata, read_metadata
from seaclutter_cli.sensors.ouster.packets import (
    PROFILES,
    frame_ids,
    looks_like_packet,
    packet_layout,
    serial_number,
    sound_packets,
    valid_columns,
)
from seaclutter_cli.sensors.packets import DecoderOptions, PacketFrame, Packets, point_dtype

_IMU_LENGTH = 48
_MOST_LOST_TURNS = 1000


class OusterDecoder:
    """Decodes the packets of one Ouster sensor.

    Points are in the sensor's frame, x away from the connector and z up, column by column. The intensity is the signal,
    in photons; the reflectivity where a profile has no signal.

    Parameters
    ----------
    metadata : OusterMetadata
        What the sensor says of itself.

    Attributes
    ----------
    facts : SensorFacts
        What is known of the sensor.

    Notes
    -----
    State: packets of the turn that is not complete yet, and the shift of the clock.
    """

    def __init__(self, metadata: OusterMetadata) -> None:
        profile = PROFILES[metadata.profile]
        self.facts = SensorFacts(metadata.model, _details(metadata))
        self._metadata = metadata
        self._profile = profile
        self._rows, returns = len(metadata.altitude_rad), len(profile.ranges)
        self._layout = packet_layout(metadata.profile, self._rows, metadata.packet_columns)
        self._expected = metadata.expected_packets()
        unit_m = np.float32(profile.range_unit_mm / 1000)
        directions, origins = metadata.directions()
        self._directions, self._origins = directions * unit_m, origins
        self._dtype = point_dtype(returns=returns == 2)
        self._clock = SensorClock()
        self._turn: int | None = None
        self._pending: list[tuple[NDArray[np.uint8], NDArray[np.int64]]] = []
        self._count = 0
        self._is_first = True

    def add(self, packets: Packets) -> Iterator[PacketFrame]:
        """Yield the frames that these packets complete. Bad packets are counted, never raised."""
        length = packets.payloads.shape[1]
        if length != self._layout.itemsize or not len(packets):
            self.facts.bad_packets += len(packets) if length != _IMU_LENGTH else 0
            return
        data = self._view(packets.payloads)
        sound = sound_packets(data, self._metadata.columns)
        self.facts.bad_packets += int((~sound).sum())
        useful = np.flatnonzero(sound & valid_columns(data).any(axis=1))
        if len(useful) and self._turn is None:
            self._check_serial(data[useful[0]])
        turns = frame_ids(data)[useful]
        for part in np.split(useful, np.flatnonzero(np.diff(turns)) + 1):
            if len(part):
                yield from self._take(int(frame_ids(data[part[:1]])[0]), packets.payloads[part], packets.times_ns[part])

    def finish(self) -> Iterator[PacketFrame]:
        """Yield what is left."""
        if self._pending:
            yield self._complete(is_last=True)

    def _view(self, payloads: NDArray[np.uint8]) -> NDArray[np.void]:
        return np.ascontiguousarray(payloads).view(self._layout)[:, 0]

    def _take(self, turn: int, payloads: NDArray[np.uint8], times_ns: NDArray[np.int64]) -> Iterator[PacketFrame]:
        """Take packets of one turn, shape (P,); yield the turn before it."""
        step = 0 if self._turn is None else (turn - self._turn + 0x8000) % 0x10000 - 0x8000
        if step == -1:
            return
        most = 2 * len(self._expected)
        if step and self._pending:
            yield self._complete()
            if 1 < step <= _MOST_LOST_TURNS:
                self.facts.lost_packets += (step - 1) * int(self._expected.sum())
        self._turn = turn
        while len(payloads):
            if self._count >= most:
                yield self._complete()
            room = most - self._count
            self._pending.append((payloads[:room], times_ns[:room]))
            self._count += len(payloads[:room])
            payloads, times_ns = payloads[room:], times_ns[room:]

    def _complete(self, *, is_last: bool = False) -> PacketFrame:
        """Return the frame of the packets that are pending."""
        data = self._view(np.concatenate([part for part, _ in self._pending]))
        times_ns = np.concatenate([times for _, times in self._pending])
        self._pending, self._count = [], 0
        partial = self._count_lost(data, is_last=is_last)
        valid = valid_columns(data)
        column_ns = np.where(valid, data["columns"]["time_ns"], 0).astype(np.int64)
        column_ns += self._clock.shifts(column_ns.max(axis=1), times_ns)[:, None]
        if self._clock.is_wrong:
            self.facts.details["clock"] = "not synchronised: times are those of the recorder"
        ids, places = np.unique(np.where(valid, data["columns"]["id"].astype(np.int64), -1), return_index=True)
        ids, places = ids[ids >= 0], places[ids >= 0]
        column_ns = column_ns.ravel()[places]
        return PacketFrame(self._points(data, ids, places, column_ns), int(column_ns.max()), partial=partial)

    def _count_lost(self, data: NDArray[np.void], *, is_last: bool) -> bool:
        """Count the packets that a turn lacks; tell whether the recording begins or ends within it."""
        seen = np.zeros(len(self._expected), bool)
        offset = valid_columns(data).argmax(axis=1)
        ids = data["columns"]["id"][np.arange(len(data)), offset].astype(np.int64)
        seen[(ids - offset) // self._metadata.packet_columns] = True
        missing = np.flatnonzero(self._expected & ~seen)
        first, last = np.flatnonzero(seen)[[0, -1]]
        before = missing < first if self._is_first else np.zeros(len(missing), bool)
        after = missing > last if is_last else np.zeros(len(missing), bool)
        self._is_first = False
        self.facts.lost_packets += int((~before & ~after).sum())
        return bool((before | after).any())

    def _points(
        self, data: NDArray[np.void], ids: NDArray[np.int64], places: NDArray[np.intp], column_ns: NDArray[np.int64]
    ) -> NDArray[np.void]:
        """Return the points of some columns of packets, by their ids and places, shape (C,), column by column."""
        profile, returns = self._profile, len(self._profile.ranges)

        def values(names: tuple[str, ...]) -> NDArray[np.uint32]:
            pixels = data["columns"]["pixels"]
            return np.stack([pixels[name].reshape(-1, self._rows)[places] for name in names], axis=-1)

        ranges = values(profile.ranges) & profile.range_mask
        hit = np.flatnonzero(ranges)
        column = np.repeat(np.arange(len(ids)), np.count_nonzero(ranges, axis=(1, 2)))
        beam = hit >> 1 if returns == 2 else hit
        row = beam - column * self._rows
        place = beam if len(ids) == self._metadata.columns else ids[column] * self._rows + row
        units = ranges.ravel()[hit].astype(np.float32)
        points = np.empty(len(hit), self._dtype)
        for axis, name in enumerate("xyz"):
            points[name] = units * self._directions[axis].ravel()[place] + self._origins[axis].ravel()[place]
        points["intensity"] = values(profile.intensities).ravel()[hit]
        points["ring"] = row
        points["timestamp"] = (column_ns / 1e9)[column]
        if returns == 2:
            points["return_number"] = (hit & 1) + 1
        return points

    def _check_serial(self, packet: NDArray[np.void]) -> None:
        """Warn where the metadata is of another sensor."""
        serial, known = serial_number(packet), self._metadata.serial
        if serial and known and serial != known:
            text = f"the metadata is of sensor {known}, the packets are of {serial}: angles will be off"
            self.facts.warnings.append(text)


def _details(metadata: OusterMetadata) -> dict[str, str]:
    """Return what people want to know of a sensor."""
    signal = PROFILES[metadata.profile].has_signal
    first, last = metadata.window
    details = {
        "serial number": metadata.serial,
        "firmware": metadata.firmware,
        "profile": metadata.profile,
        "columns": f"{metadata.columns} a turn, {first} to {last} sent",
        "timestamps": metadata.clock,
        "intensity": "signal, photons" if signal else "reflectivity, 0 to 255: this profile has no signal",
        "return mode": "strongest, second strongest" if len(PROFILES[metadata.profile].ranges) > 1 else "single",
    }
    return {name: text for name, text in details.items() if text}


class Ouster:
    """The sensors of Ouster."""

    title = "Ouster OS0, OS1, OS2"
    scan_types: Mapping[str, str] = {}

    def recognises(self, payload: NDArray[np.uint8]) -> bool:
        """Tell by its content whether a UDP payload, shape (L,), is a data packet of an Ouster sensor."""
        return looks_like_packet(payload)

    def decoder(self, packets: Packets, options: DecoderOptions) -> OusterDecoder:
        """Return a decoder for a sensor, told by some of its packets; `InputError` without fitting metadata."""
        if options.calibration is None:
            raise InputError(
                "Ouster packets say nothing of the sensor's angles: pass --calibration METADATA.json, the file that "
                "is recorded with them"
            )
        metadata = read_metadata(options.calibration)
        if metadata.profile not in PROFILES:
            raise InputError(f"{options.calibration}: profile {metadata.profile}; known are {', '.join(PROFILES)}")
        length = packet_layout(metadata.profile, len(metadata.altitude_rad), metadata.packet_columns).itemsize
        found = packets.payloads.shape[1]
        if len(packets) and found not in (length, _IMU_LENGTH):
            raise InputError(
                f"{options.calibration}: packets have {length} bytes by this metadata ({metadata.model}, "
                f"{metadata.profile}), those recorded {found}: is it of another sensor?"
            )
        return OusterDecoder(metadata)
