"""Decoder for RoboSense's rotating lidars."""

from collections.abc import Collection, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import InputError
from seaclutter_cli.records import SensorFacts
from seaclutter_cli.sensors.packets import (
    DAY_NS,
    EXPERIMENTAL,
    DecoderOptions,
    LossCounter,
    PacketFamily,
    PacketFrame,
    Packets,
    SensorClock,
)
from seaclutter_cli.sensors.robosense.device import Device, find_device, find_model
from seaclutter_cli.sensors.robosense.models import CHECKED, CLASSIC_ID, DATA_BYTES, HELIOS_ID, INFO_BYTES
from seaclutter_cli.sensors.robosense.packets import INFO_ID, Angles, data_packets, header_times, temperature_degc
from seaclutter_cli.sensors.robosense.points import BLIND, Geometry, block_dtype, second_returns, steps, valid_blocks

_TOLERANCE = 100


class RoboSense(PacketFamily):
    """RoboSense's rotating lidars. First bytes and lengths identify data and device information packets."""

    title = "RoboSense"
    calibrates = True

    def recognises(self, payload: NDArray[np.uint8]) -> bool:
        """Return whether a UDP payload, shape (L,), is a data packet or a device information packet."""
        begin = payload[:4].tobytes()
        if begin == INFO_ID[:4]:
            return len(payload) == INFO_BYTES
        return begin in (CLASSIC_ID, HELIOS_ID) and len(payload) in DATA_BYTES

    def is_calibration(self, payloads: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Return which UDP payloads, shape (P, L), are device information packets, which contain the laser angles."""
        return _are(payloads, INFO_ID[:4], {INFO_BYTES})

    def decoder(self, packets: Packets, options: DecoderOptions) -> "RoboSenseDecoder":
        """Return a decoder for the sensor that sent these packets: data, and device information from anywhere.

        Options contain device information if data packets have another length, a file of angles, which overrides those
        in the packets, and the model if packets do not identify it. `InputError` if model or angles are unknown.
        """
        info = packets.payloads[self.is_calibration(packets.payloads)] if options.info is None else options.info
        is_data = _are(packets.payloads, CLASSIC_ID, DATA_BYTES) | _are(packets.payloads, HELIOS_ID, DATA_BYTES)
        data = packets.payloads[is_data]
        if not len(data):
            raise InputError("RoboSense: no data packets, only device information")
        warnings: list[str] = []
        model = find_model(data[0], info, options, warnings)
        device, angles = find_device(model, data, info, options, warnings)
        return RoboSenseDecoder(device, angles, warnings, packets[is_data])


def _are(payloads: NDArray[np.uint8], begin: bytes, lengths: Collection[int]) -> NDArray[np.bool_]:
    """Return which payloads, shape (P, L), begin with some bytes and have one of some lengths."""
    wanted = np.frombuffer(begin, np.uint8)
    if payloads.shape[1] not in lengths:
        return np.zeros(len(payloads), np.bool_)
    begins: NDArray[np.bool_] = (payloads[:, : len(wanted)] == wanted).all(axis=1)
    return begins


class RoboSenseDecoder:
    """Decoder for the packets of one sensor, with known angles; some of them show whether its clock is right.

    State: the blocks of the current revolution (about 200 kB), the azimuth of the last block, and the clock.
    """

    def __init__(self, device: Device, angles: Angles, warnings: list[str], sample: Packets) -> None:
        self._device = device
        self._geometry = Geometry(device, angles)
        self._is_utc = device.model.format.is_utc
        self._clock, self._losses = SensorClock(), LossCounter()
        self._parts: list[NDArray[np.void]] = []
        self._azimuth = -1
        self._gaps_ns = 0
        self._is_first = True
        self.facts = SensorFacts(device.model.name, dict(device.details), warnings=warnings)
        packets = data_packets(device.model, sample.payloads)
        header_ns = header_times(packets, is_utc=self._is_utc)
        wrong = bool(((abs(header_ns - sample.times_ns) > DAY_NS) & (sample.times_ns > 0)).mean() > 0.5)
        raw, big_endian = packets["temperature"][0].tolist(), device.model.format.temperature_big_endian
        temperature = temperature_degc(*raw, big_endian=big_endian)
        self.facts.details["temperature"] = f"{temperature:.1f} °C at the start"
        self.facts.details["clock"] = "sensor time, shifted to the recording time" if wrong else "sensor time (UTC)"
        self.facts.details |= EXPERIMENTAL if device.model.name not in CHECKED else {}
        if wrong:
            warnings.append("the sensor clock is off by more than a day: times are shifted to the recording time")

    def add(self, packets: Packets) -> Iterator[PacketFrame]:
        """Yield the frames that these packets complete. Invalid packets are counted and raise no error."""
        model = self._device.model
        is_data = _are(packets.payloads, model.format.id, {model.packet_bytes})
        if not is_data.all():
            is_info = _are(packets.payloads, INFO_ID[:4], {INFO_BYTES})
            self.facts.bad_packets += int((~is_data & ~is_info).sum())
            packets = packets[is_data]
        if len(packets):
            yield from self._frames_of(data_packets(model, packets.payloads), packets.times_ns)

    def finish(self) -> Iterator[PacketFrame]:
        """Yield the last revolution."""
        if self._parts:
            yield self._frame(is_last=True)

    def _frames_of(self, packets: NDArray[Any], record_ns: NDArray[np.int64]) -> Iterator[PacketFrame]:
        valid = valid_blocks(packets["blocks"], self._device.model.format)
        self.facts.bad_packets += int((~valid.any(axis=1)).sum())
        if not valid.any():
            return
        blocks, revolution = self._blocks(packets, record_ns, valid)
        starts = np.flatnonzero(np.diff(revolution, prepend=0))
        begin = 0
        for start in starts.tolist():
            if start > begin:
                self._parts.append(blocks[begin:start])
            begin = start
            if self._parts:
                yield self._frame()
        self._parts.append(blocks[begin:].copy())

    def _blocks(
        self, packets: NDArray[Any], record_ns: NDArray[np.int64], valid: NDArray[np.bool_]
    ) -> tuple[NDArray[np.void], NDArray[np.int64]]:
        """Return the valid blocks of packets, and the revolution of each, shape (B,); 0 for the current one."""
        raw = packets["blocks"]
        azimuth = raw["azimuth"].astype(np.int64)
        used = azimuth[valid]
        revolution = np.cumsum(np.diff(used, prepend=self._azimuth) < 0, dtype=np.int64)
        second = second_returns(azimuth, self._device, self._azimuth)
        step, after_ns = steps(azimuth, second, self._device)
        header_ns = header_times(packets, is_utc=self._is_utc)
        times_ns = header_ns + self._clock.shifts(header_ns, record_ns - self._device.model.packet_ns)
        self._count_lost(header_ns, azimuth)
        self._azimuth = int(used[-1])
        blocks = np.empty(len(used), block_dtype(self._device.model))
        for name, values in (
            ("step", step),
            ("times_ns", times_ns[:, None] + after_ns),
            ("second", second),
            ("channels", raw["channels"]),
        ):
            blocks[name] = values[valid]
        blocks["azimuth"] = used
        return blocks, revolution

    def _count_lost(self, times_ns: NDArray[np.int64], azimuth: NDArray[np.int64]) -> None:
        """Count lost packets by the times of packets, shape (P,), without those in the blind sector."""
        device, flat = self._device, azimuth.ravel()
        is_gap = np.diff(flat, prepend=flat[0] if self._azimuth < 0 else self._azimuth) % 36000 > BLIND
        gaps_ns = self._gaps_ns + np.cumsum(is_gap * (device.gap_ns - device.step_ns))
        self._gaps_ns = int(gaps_ns[-1])
        period_ns = device.step_ns * azimuth.shape[1] / (2 if device.paired else 1)
        self._losses.add(times_ns - gaps_ns[:: azimuth.shape[1]], period_ns)
        self.facts.lost_packets = self._losses.lost

    def _frame(self, *, is_last: bool = False) -> PacketFrame:
        """Return the points of the collected blocks; only the first and the last revolution can be partial."""
        blocks = np.concatenate(self._parts)
        self._parts = []
        start, end = self._device.fov
        start, end = (start, end) if start < end else (0, 36000)
        late = self._is_first and abs(int(blocks["azimuth"][0]) - start) > _TOLERANCE
        early = is_last and abs(end - int(blocks["azimuth"][-1] + blocks["step"][-1])) > _TOLERANCE
        self._is_first = False
        stamp_ns = int(blocks["times_ns"][-1]) + self._geometry.last_ns
        return PacketFrame(self._geometry.points(blocks), stamp_ns, partial=late or early)
