"""Decoder for RoboSense's rotating lidars."""

from collections.abc import Collection, Iterator
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Bytes, Ints, Mask, Rows
from seaclutter_cli.errors import InputError
from seaclutter_cli.records import SensorFacts
from seaclutter_cli.sensors.packets import (
    DAY_NS,
    EXPERIMENTAL,
    NO_END,
    DecoderOptions,
    LossCounter,
    PacketFamily,
    PacketFrame,
    Packets,
    SensorClock,
    make_points,
    view_packets,
)
from seaclutter_cli.sensors.robosense import models
from seaclutter_cli.sensors.robosense import packets as layouts
from seaclutter_cli.sensors.robosense.device import Device, find_device, find_model
from seaclutter_cli.sensors.robosense.packets import Angles, data_layout, header_times

BLIND = 100
"""Azimuth step between blocks, in hundredths of a degree, above which a blind sector separates them."""
_MIN_AZIMUTH, _MAX_AZIMUTH = -9000, 45000
_SWAPPED = 0x8000
_TOLERANCE = 100
_DATA_IDS = models.CLASSIC_ID, models.HELIOS_ID


def second_returns(azimuth: Ints, device: Device, before: int) -> Mask:
    """Return which blocks contain second returns, shape (P, B), given their azimuths and that of the block before."""
    blocks = azimuth.shape[1]
    if device.paired and blocks % 2:
        # Pairs extend from one packet into the next.
        return np.asarray(np.diff(azimuth.ravel(), prepend=before) == 0).reshape(azimuth.shape)
    return np.broadcast_to((np.arange(blocks) % 2 == 1) & device.paired, azimuth.shape)


def steps(azimuth: Ints, second: Mask, device: Device) -> tuple[Ints, Ints]:
    """Return the rotation during each block, and its start time relative to the first block of its packet.

    Azimuths and rotations, shape (P, B), are in hundredths of a degree, times in nanoseconds. The blocks with
    ``second`` returns start with those before them.
    """
    jump = np.diff(azimuth, axis=1)
    jump += np.where(jump < 0, 36000, 0)
    blind, later = jump > BLIND, ~second[:, 1:]
    step, time_ns = np.full(azimuth.shape, device.step, np.int64), np.zeros(azimuth.shape, np.int64)
    np.cumsum(np.where(blind, device.gap_ns, device.step_ns) * later, axis=1, out=time_ns[:, 1:])
    step[:, :-1] = np.where(blind, device.step, jump)
    return np.where(np.pad(later, ((0, 0), (0, 1)), constant_values=True), step, np.roll(step, -1, axis=1)), time_ns


class Geometry:
    """Converter from the blocks of a sensor, whose lasers have some angles, to points."""

    def __init__(self, device: Device, angles: Angles) -> None:
        model = device.model
        self._device, self._horizontal, self._rings = device, angles.horizontal, angles.rings
        channel_ns = model.channel_ns(dual=device.dual)
        self.last_ns = int(channel_ns[-1])
        self._channel_s = channel_ns / 1e9
        self._share = (channel_ns / device.step_ns).astype(np.float32)
        self._forward, self._up = np.array(model.lens_m, np.float32)
        vertical = angles.vertical * 0.01 * np.pi / 180
        self._cos, self._sin = np.cos(vertical).astype("f4"), np.sin(vertical).astype("f4")
        self._unit = np.float32(model.unit_m)
        least, most = np.array(model.range_m, np.float32)
        ranges = np.arange(2**16, dtype=np.float32) * self._unit
        self._is_valid = (ranges >= least) & (ranges <= most)
        self._is_valid[0] = False

    def points(self, blocks: Rows) -> Rows:
        """Return the points of blocks, shape (N,), in firing order."""
        distance, intensity = self._measured(layouts.channels(blocks["channels"]))
        hit = np.flatnonzero(self._is_valid[distance])
        block, channel = np.divmod(hit, distance.shape[1])
        rotation = (blocks["step"][:, None].astype(np.float32) * self._share).astype(np.int64)
        azimuth = (blocks["azimuth"][:, None] + rotation - _MIN_AZIMUTH).ravel()[hit]
        range_m = distance.ravel()[hit] * self._unit
        directions = _directions()
        positions = directions.take(azimuth + self._horizontal[channel], mode="clip")
        positions *= range_m * self._cos[channel]
        positions += directions.take(azimuth, mode="clip") * self._forward
        left = -positions.imag if self._device.reversed else positions.imag
        xyz = positions.real, left, range_m * self._sin[channel] + self._up
        times_s = blocks["times_ns"][block] / 1e9 + self._channel_s[channel]
        number = None
        if self._device.dual:
            number = 1 + (blocks["second"][block] if self._device.paired else channel // self._device.model.lasers)
        return make_points(xyz, intensity.ravel()[hit], self._rings[channel], times_s, number)

    def _measured(self, measured: NDArray[Any]) -> tuple[NDArray[np.uint16], Bytes]:
        distance = measured["distance"].astype(np.uint16) & np.uint16(self._device.model.format.distance_mask)
        intensity = measured["intensity"]
        if self._device.model.swaps_halves:
            swapped = distance[:, 0] >= _SWAPPED
            distance &= _SWAPPED - 1
            intensity = intensity.copy()
            for values in (distance, intensity):
                values[swapped] = np.roll(values[swapped], values.shape[1] // 2, axis=1)
        return distance, intensity


@cache
def _directions() -> NDArray[np.complex64]:
    """Return unit vectors by azimuth in hundredths of a degree, for any two-byte azimuth plus offsets."""
    hundredths = np.arange(_MIN_AZIMUTH, 2**17)
    hundredths[hundredths >= _MAX_AZIMUTH] = 0
    radians = hundredths * 0.01 * np.pi / 180
    directions = np.empty(len(radians), np.complex64)
    directions.real, directions.imag = np.cos(radians), -np.sin(radians)
    return directions


class RoboSense(PacketFamily):
    """RoboSense's rotating lidars. First bytes and lengths identify data and device information packets."""

    title = "RoboSense"
    calibrates = True

    def recognises(self, payload: Bytes) -> bool:
        """Return whether a UDP payload, shape (L,), is a data packet or a device information packet."""
        payloads = payload[None]
        return bool((_are_info(payloads) | _are(payloads, _DATA_IDS, models.DATA_BYTES))[0])

    def is_calibration(self, payloads: Bytes) -> Mask:
        """Return which UDP payloads, shape (P, L), are device information packets, which contain the laser angles."""
        return _are_info(payloads)

    def decoder(self, packets: Packets, options: DecoderOptions) -> "_Decoder":
        """Return a decoder for the sensor that sent these packets: data, and device information from anywhere.

        Options contain device information if data packets have another length, a file of angles, which overrides those
        in the packets, and the model if packets do not identify it. `InputError` if model or angles are unknown.
        """
        info = packets.payloads[_are_info(packets.payloads)] if options.info is None else options.info
        is_data = _are(packets.payloads, _DATA_IDS, models.DATA_BYTES)
        data = packets.payloads[is_data]
        if not len(data):
            raise InputError("RoboSense: no data packets, only device information")
        warnings: list[str] = []
        model = find_model(data[0], info, options, warnings)
        device, angles = find_device(model, data, info, options, warnings)
        return _Decoder(device, angles, warnings, packets[is_data])


def _are(payloads: Bytes, begins: Collection[bytes], lengths: Collection[int]) -> Mask:
    """Return which payloads, shape (P, L), begin with some four bytes and have one of some lengths."""
    if payloads.shape[1] not in lengths:
        return np.zeros(len(payloads), np.bool_)
    found = [(payloads[:, :4] == np.frombuffer(begin, np.uint8)).all(axis=1) for begin in begins]
    return np.asarray(np.any(found, axis=0))


def _are_info(payloads: Bytes) -> Mask:
    return _are(payloads, [layouts.INFO_ID[:4]], {models.INFO_BYTES})


class _Decoder:
    """Decoder for the packets of one sensor, with known angles; some of them show whether its clock is right.

    State: the blocks of the current revolution (about 200 kB), the azimuth of the last block, and the clock.
    """

    places_end = NO_END

    def __init__(self, device: Device, angles: Angles, warnings: list[str], sample: Packets) -> None:
        self._device = device
        self._geometry = Geometry(device, angles)
        self._clock, self._losses = SensorClock(), LossCounter()
        self._parts: list[Rows] = []
        self._azimuth = -1
        self._gaps_ns = 0
        self._is_first = True
        self.facts = SensorFacts(device.model.name, dict(device.details), warnings=warnings)
        packets = view_packets(sample.payloads, data_layout(device.model))
        header_ns = header_times(packets)
        wrong = bool(((abs(header_ns - sample.times_ns) > DAY_NS) & (sample.times_ns > 0)).mean() > 0.5)
        raw, big_endian = packets["temperature"][0].tolist(), device.model.format.temperature_big_endian
        temperature = layouts.temperature_degc(*raw, big_endian=big_endian)
        self.facts.details["temperature"] = f"{temperature:.1f} °C at the start"
        self.facts.details["clock"] = "sensor time, shifted to the recording time" if wrong else "sensor time (UTC)"
        self.facts.details |= EXPERIMENTAL if device.model.name not in models.CHECKED else {}
        if wrong:
            warnings.append("the sensor clock is off by more than a day: times are shifted to the recording time")

    def places(self, packets: Packets) -> Ints:
        """Return the times of data packets, shape (P,), and -1 for device information and others."""
        is_data = self._are_data(packets)
        if not is_data.any():
            return np.full(len(packets), -1)
        times_ns = header_times(view_packets(packets.payloads, data_layout(self._device.model)))
        return np.where(is_data, times_ns, -1)

    def _are_data(self, packets: Packets) -> Mask:
        return _are(packets.payloads, [self._device.model.format.id], {self._device.model.packet_bytes})

    def add(self, packets: Packets) -> Iterator[PacketFrame]:
        is_data = self._are_data(packets)
        self.facts.bad_packets += int((~is_data & ~_are_info(packets.payloads)).sum())
        data = view_packets(packets.payloads[is_data], data_layout(self._device.model))
        raw, (mask, value) = data["blocks"], self._device.model.format.block_id
        # A block is valid if its azimuth is below 360° and there is no invalid id up to it.
        valid = np.logical_and.accumulate(raw["id"] & mask == value, axis=1) & (raw["azimuth"] < 36000)
        self.facts.bad_packets += int((~valid.any(axis=1)).sum())
        if not valid.any():
            return
        blocks, revolution = self._blocks(data, packets.times_ns[is_data], valid)
        rest, *begun = np.split(blocks, np.flatnonzero(np.diff(revolution, prepend=0)))
        self._parts += [rest.copy()] if len(rest) else []
        for part in begun:
            if self._parts:
                yield self._frame()
            self._parts = [part.copy()]

    def finish(self) -> Iterator[PacketFrame]:
        if self._parts:
            yield self._frame(is_last=True)

    def _blocks(self, packets: Rows, record_ns: Ints, valid: Mask) -> tuple[Rows, Ints]:
        """Return the valid blocks of packets, and the revolution of each, shape (B,); 0 for the current one.

        Blocks have the azimuth at their start and the rotation until the next one in hundredths of a degree, their
        start time in nanoseconds of Unix time, whether they contain second returns, and the raw bytes of channels.
        """
        raw = packets["blocks"]
        azimuth = raw["azimuth"].astype(np.int64)
        used = azimuth[valid]
        revolution = np.cumsum(np.diff(used, prepend=self._azimuth) < 0, dtype=np.int64)
        second = second_returns(azimuth, self._device, self._azimuth)
        step, after_ns = steps(azimuth, second, self._device)
        header_ns = header_times(packets)
        times_ns = header_ns + self._clock.shifts(header_ns, record_ns - self._device.model.packet_ns)
        self._count_lost(header_ns, azimuth)
        self._azimuth = int(used[-1])
        numbers = ((name, np.int64) for name in ("azimuth", "step", "times_ns"))
        blocks = np.empty(len(used), [*numbers, ("second", np.bool_), ("channels", raw["channels"].dtype)])
        columns = azimuth, step, times_ns[:, None] + after_ns, second, raw["channels"]
        for name, values in zip(blocks.dtype.names or (), columns, strict=True):
            blocks[name] = values[valid]
        return blocks, revolution

    def _count_lost(self, times_ns: Ints, azimuth: Ints) -> None:
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
