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
    point_dtype,
)
from seaclutter_cli.sensors.robosense import models
from seaclutter_cli.sensors.robosense import packets as layouts
from seaclutter_cli.sensors.robosense.device import Device, find_device, find_model
from seaclutter_cli.sensors.robosense.models import RobosenseModel
from seaclutter_cli.sensors.robosense.packets import Angles, data_packets, header_times

_WHOLE = 0xFFFF
BLIND = 100
"""Azimuth step between blocks, in hundredths of a degree, above which a blind sector separates them."""
_MIN_AZIMUTH, _MAX_AZIMUTH = -9000, 45000
_SWAPPED = 0x8000
_TOLERANCE = 100
_DATA_IDS = models.CLASSIC_ID, models.HELIOS_ID


@cache
def block_dtype(model: RobosenseModel) -> np.dtype[Any]:
    """Return the layout of decoded blocks.

    They have the azimuth at their start and the rotation until the next one in hundredths of a degree, their start time
    in nanoseconds of Unix time, whether they contain second returns, and the raw bytes of distances and intensities.
    """
    numbers: list[Any] = [(name, np.int64) for name in ("azimuth", "step", "times_ns")]
    channels = layouts.data_layout(model)["blocks"].base["channels"]
    return np.dtype([*numbers, ("second", np.bool_), ("channels", channels)])


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
        share = (channel_ns / device.step_ns).astype(np.float32)
        rotation = np.arange(max(BLIND, device.step) + 1, dtype=np.float32)[:, None] * share
        self._rotation = rotation.astype(np.int64)
        forward, up = np.array(model.lens_m, np.float32)
        self._directions = _directions()
        self._lens = self._directions * forward
        vertical = angles.vertical * 0.01 * np.pi / 180
        self._cos, self._sin, self._up = np.cos(vertical).astype("f4"), np.sin(vertical).astype("f4"), up
        self._unit = np.float32(model.unit_m)
        least, most = np.array(model.range_m, np.float32)
        ranges = np.arange(2**16, dtype=np.float32) * self._unit
        valid = np.flatnonzero((ranges >= least) & (ranges <= most))
        self._limits = np.uint16(max(valid[0], 1)), np.uint16(valid[-1])  # least and greatest valid distance in units
        self._dtype = point_dtype(returns=device.dual)
        self._packed = _packed(self._dtype)

    def points(self, blocks: Rows) -> Rows:
        """Return the points of blocks, shape (N,), in firing order."""
        distance, intensity = self._measured(layouts.channels(blocks["channels"]))
        azimuth = blocks["azimuth"][:, None] + self._rotation[blocks["step"]] - _MIN_AZIMUTH
        range_m = distance * self._unit
        points = np.empty(distance.shape, self._packed)
        positions = self._directions.take(azimuth + self._horizontal, mode="clip")
        positions *= range_m * self._cos
        positions += self._lens.take(azimuth, mode="clip")
        points["xy"] = positions.conj() if self._device.reversed else positions
        points["z"] = range_m * self._sin + self._up
        points["intensity"] = intensity
        points["ring"] = self._rings
        points["timestamp"] = (blocks["times_ns"] / 1e9)[:, None] + self._channel_s
        if self._device.dual:
            lasers = np.arange(self._device.model.channels) // self._device.model.lasers
            points["return_number"] = 1 + (blocks["second"][:, None] if self._device.paired else lasers)
        least, most = self._limits
        return _select(points.reshape(-1).view(self._dtype), (distance >= least) & (distance <= most))

    def _measured(self, measured: NDArray[Any]) -> tuple[NDArray[np.uint16], Bytes]:
        distance, intensity = measured["distance"].astype(np.uint16), measured["intensity"]
        if (mask := self._device.model.format.distance_mask) != _WHOLE:
            distance &= mask
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


def _packed(dtype: np.dtype[Any]) -> np.dtype[Any]:
    """Return the layout of points with x and y as one complex number, which is faster to write."""
    fields = dict(dtype.fields or {})
    names = [name for name in fields if name not in "xy"]
    formats = ["<c8", *(fields[name][0] for name in names)]
    offsets = [0, *(fields[name][1] for name in names)]
    return np.dtype({"names": ["xy", *names], "formats": formats, "offsets": offsets, "itemsize": dtype.itemsize})


def _select(points: Rows, keep: Mask) -> Rows:
    kept = np.flatnonzero(keep)
    if len(kept) == len(points):
        return points
    # Points copy several times faster as raw bytes.
    return points.view(np.dtype((np.void, points.dtype.itemsize))).take(kept).view(points.dtype)


class RoboSense(PacketFamily):
    """RoboSense's rotating lidars. First bytes and lengths identify data and device information packets."""

    title = "RoboSense"
    calibrates = True

    def recognises(self, payload: Bytes) -> bool:
        """Return whether a UDP payload, shape (L,), is a data packet or a device information packet."""
        payloads = payload[None]
        return bool((self.is_calibration(payloads) | _are(payloads, _DATA_IDS, models.DATA_BYTES))[0])

    def is_calibration(self, payloads: Bytes) -> Mask:
        """Return which UDP payloads, shape (P, L), are device information packets, which contain the laser angles."""
        return _are(payloads, [layouts.INFO_ID[:4]], {models.INFO_BYTES})

    def decoder(self, packets: Packets, options: DecoderOptions) -> "RoboSenseDecoder":
        """Return a decoder for the sensor that sent these packets: data, and device information from anywhere.

        Options contain device information if data packets have another length, a file of angles, which overrides those
        in the packets, and the model if packets do not identify it. `InputError` if model or angles are unknown.
        """
        info = packets.payloads[self.is_calibration(packets.payloads)] if options.info is None else options.info
        is_data = _are(packets.payloads, _DATA_IDS, models.DATA_BYTES)
        data = packets.payloads[is_data]
        if not len(data):
            raise InputError("RoboSense: no data packets, only device information")
        warnings: list[str] = []
        model = find_model(data[0], info, options, warnings)
        device, angles = find_device(model, data, info, options, warnings)
        return RoboSenseDecoder(device, angles, warnings, packets[is_data])


def _are(payloads: Bytes, begins: Collection[bytes], lengths: Collection[int]) -> Mask:
    """Return which payloads, shape (P, L), begin with some four bytes and have one of some lengths."""
    if payloads.shape[1] not in lengths:
        return np.zeros(len(payloads), np.bool_)
    found = [(payloads[:, :4] == np.frombuffer(begin, np.uint8)).all(axis=1) for begin in begins]
    return np.asarray(np.any(found, axis=0))


class RoboSenseDecoder:
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
        packets = data_packets(device.model, sample.payloads)
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
        times_ns = header_times(data_packets(self._device.model, packets.payloads))
        return np.where(is_data, times_ns, -1)

    def _are_data(self, packets: Packets) -> Mask:
        return _are(packets.payloads, [self._device.model.format.id], {self._device.model.packet_bytes})

    def add(self, packets: Packets) -> Iterator[PacketFrame]:
        """Yield the frames that these packets complete. Invalid packets are counted and raise no error."""
        model = self._device.model
        is_data = self._are_data(packets)
        if not is_data.all():
            is_info = _are(packets.payloads, [layouts.INFO_ID[:4]], {models.INFO_BYTES})
            self.facts.bad_packets += int((~is_data & ~is_info).sum())
            packets = packets[is_data]
        if len(packets):
            yield from self._frames_of(data_packets(model, packets.payloads), packets.times_ns)

    def finish(self) -> Iterator[PacketFrame]:
        """Yield the last revolution."""
        if self._parts:
            yield self._frame(is_last=True)

    def _frames_of(self, packets: NDArray[Any], record_ns: Ints) -> Iterator[PacketFrame]:
        raw, (mask, value) = packets["blocks"], self._device.model.format.block_id
        ids = raw["id"] if mask == _WHOLE else raw["id"] & mask
        # A block is valid if its azimuth is below 360° and there is no invalid id up to it.
        valid = np.logical_and.accumulate(ids == value, axis=1) & (raw["azimuth"] < 36000)
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

    def _blocks(self, packets: NDArray[Any], record_ns: Ints, valid: Mask) -> tuple[Rows, Ints]:
        """Return the valid blocks of packets, and the revolution of each, shape (B,); 0 for the current one."""
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
