"""RoboSense's rotating lidars: RS-LiDAR-32, RS-LiDAR-16 and RS-Helios."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import InputError
from seaclutter_cli.records import SensorFacts
from seaclutter_cli.sensors.packets import DecoderOptions, PacketFrame, Packets
from seaclutter_cli.sensors.robosense.angles import file_angles
from seaclutter_cli.sensors.robosense.blocks import Blocks, join, second_returns, sound_blocks, steps
from seaclutter_cli.sensors.robosense.clock import RobosenseClock, are_off, header_times
from seaclutter_cli.sensors.robosense.device import Device, assumed_device, guess_model, read_device
from seaclutter_cli.sensors.robosense.losses import RobosenseLosses
from seaclutter_cli.sensors.robosense.models import BLOCKS, CLASSIC_ID, HELIOS_ID, MODELS, RobosenseModel
from seaclutter_cli.sensors.robosense.packets import DATA, INFO_ID, PACKET_BYTES, temperatures_degc
from seaclutter_cli.sensors.robosense.points import Geometry

_WHOLE = 100
_CLASSIC = ("RS-LiDAR-32", "RS-LiDAR-16")


class RoboSense:
    """The family: both kinds of packets are 1248 bytes, told apart by their first bytes."""

    title = "RoboSense"
    scan_types: Mapping[str, str] = {}

    def recognises(self, payload: NDArray[np.uint8]) -> bool:
        """Tell whether a UDP payload, shape (L,), is a packet of data or of device information."""
        return len(payload) == PACKET_BYTES and payload[:4].tobytes() in (CLASSIC_ID, HELIOS_ID, INFO_ID[:4])

    def is_calibration(self, payloads: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Tell which UDP payloads, shape (P, L), hold device information with the angles of the lasers."""
        return _begins(payloads, INFO_ID[:4])

    def decoder(self, packets: Packets, options: DecoderOptions) -> "RoboSenseDecoder":
        """Return a decoder for the sensor that these packets come from.

        Parameters
        ----------
        packets : Packets
            Data and device information, the latter from anywhere in the recording.
        options : DecoderOptions
            A file of angles, which go before those in the packets; the model, where packets do not tell it.

        Raises
        ------
        InputError
            If the model or the angles are not known.
        """
        of_size = packets.payloads.shape[1] == PACKET_BYTES
        info = packets.payloads[_begins(packets.payloads, INFO_ID[:4])] if of_size else packets.payloads[:0]
        is_data = _begins(packets.payloads, CLASSIC_ID) | _begins(packets.payloads, HELIOS_ID)
        data = packets.payloads[is_data] if of_size else packets.payloads[:0]
        if not len(data):
            raise InputError("RoboSense: there are no data packets, only device information")
        warnings: list[str] = []
        model = _find_model(data[0], info, options, warnings)
        device = _find_device(model, data, info, options, warnings)
        return RoboSenseDecoder(device, warnings, Packets(packets.times_ns[is_data], data))


def _begins(payloads: NDArray[np.uint8], with_bytes: bytes) -> NDArray[np.bool_]:
    wanted = np.frombuffer(with_bytes, np.uint8)
    if payloads.shape[1] < len(wanted):
        return np.zeros(len(payloads), np.bool_)
    begins: NDArray[np.bool_] = (payloads[:, : len(wanted)] == wanted).all(axis=1)
    return begins


def _find_model(
    data: NDArray[np.uint8], info: NDArray[np.uint8], options: DecoderOptions, warnings: list[str]
) -> RobosenseModel:
    helios = data[:4].tobytes() == HELIOS_ID
    allowed = ("RS-Helios",) if helios else _CLASSIC
    wanted = options.model
    guessed = "RS-Helios" if helios else next((name for packet in info if (name := guess_model(packet))), None)
    if wanted is None and guessed is None:
        raise InputError(
            "RoboSense: the packets do not tell an RS-LiDAR-32 from an RS-LiDAR-16: name it with --sensor"
            + ("" if len(info) or options.calibration else f", and {_WANTED}")
        )
    if wanted is None or wanted not in allowed:
        if wanted in MODELS or guessed is None:
            raise InputError(f"RoboSense: the packets are of an {' or '.join(allowed)}, not of an {wanted}")
        return MODELS[guessed]
    if guessed not in (None, wanted):
        warnings.append(f"the device information is of an {guessed}; the packets are read as those of an {wanted}")
    return MODELS[wanted]


_WANTED = "pass its angles with --calibration FILE, a line 'elevation,azimuth offset' in degrees for each laser"


def _find_device(
    model: RobosenseModel,
    data: NDArray[np.uint8],
    info: NDArray[np.uint8],
    options: DecoderOptions,
    warnings: list[str],
) -> Device:
    devices = [read_device(model, packet) for packet in info]
    device = next((device for device in devices if device.angles), devices[0] if devices else None)
    if options.calibration is None and (device is None or device.angles is None):
        what = "its device information (DIFOP) holds no angles" if devices else "there is no device information (DIFOP)"
        raise InputError(f"{model.name}: {what}: {_WANTED}")
    if device is None:
        warnings.append("no device information (DIFOP): speed, number of returns and distance unit are as they seem")
        azimuth = data.view(DATA)["blocks"]["azimuth"].reshape(-1, BLOCKS).astype(np.int64)
        device = assumed_device(model, azimuth)
    intensity = device.details.get("intensity", "")
    if intensity.startswith(("raw", "unknown")):
        warnings.append(f"intensity is {intensity}: thresholds of calibrated sensors do not fit")
    if device.model.unit_m > model.unit_m:
        warnings.append("old firmware: distances are read in units of 1 cm")
    if options.calibration is None:
        return device
    angles = file_angles(model, options.calibration)
    details = {**device.details, "angles": str(options.calibration)}
    return Device(device.model, angles, device.dual, device.turns_hz, device.fov, details)


class RoboSenseDecoder:
    """Decodes the packets of one sensor.

    Parameters
    ----------
    device : Device
        The sensor; its angles are known.
    warnings : list of str
        What is to be said of it.
    sample : Packets
        Some of its data packets, from which its clock is told.

    Notes
    -----
    State: the blocks of the turn that goes on (about 200 kB), the azimuth of the last, the clock.
    """

    def __init__(self, device: Device, warnings: list[str], sample: Packets) -> None:
        if device.angles is None:
            raise InputError(f"{device.model.name}: the angles of its lasers are not known")
        self._device = device
        self._geometry = Geometry(device, device.angles)
        self._helios = device.model.header == HELIOS_ID
        self._clock, self._losses = RobosenseClock(device.model.packet_ns), RobosenseLosses(device)
        self._parts: list[Blocks] = []
        self._azimuth = -1
        self._frames = 0
        self._whole_start = True
        self.facts = SensorFacts(device.model.name, dict(device.details), warnings=warnings)
        header_ns = header_times(sample.payloads.view(DATA)[:, 0], helios=self._helios)
        wrong = bool(are_off(header_ns, sample.times_ns).mean() > 0.5)
        warmth = temperatures_degc(sample.payloads.view(DATA)[:1, 0])[0]
        self.facts.details["temperature"] = f"{warmth:.1f} °C at the beginning"
        self.facts.details["clock"] = "of the recording; the sensor's is off" if wrong else "of the sensor, as UTC"
        if wrong:
            warnings.append("the sensor's clock is off by more than a day: stamps are those of the recording")

    def add(self, packets: Packets) -> Iterator[PacketFrame]:
        """Yield the frames that these packets complete."""
        payloads, times_ns = packets.payloads, packets.times_ns
        if payloads.shape[1] != PACKET_BYTES:
            self.facts.bad_packets += len(packets)
            return
        is_data = _begins(payloads, self._device.model.header)
        if not is_data.all():
            self.facts.bad_packets += int((~is_data & ~_begins(payloads, INFO_ID[:4])).sum())
            payloads, times_ns = payloads[is_data], times_ns[is_data]
        if len(payloads):
            yield from self._frames_of(np.ascontiguousarray(payloads).view(DATA)[:, 0], times_ns)

    def finish(self) -> Iterator[PacketFrame]:
        """Yield the last turn."""
        if self._parts:
            blocks = join(self._parts)
            self._parts = []
            yield self._frame(blocks, partial=not self._ends_whole(blocks))

    def _frames_of(self, packets: NDArray[Any], record_ns: NDArray[np.int64]) -> Iterator[PacketFrame]:
        sound = sound_blocks(packets["blocks"])
        self.facts.bad_packets += int((~sound.any(axis=1)).sum())
        if not sound.any():
            return
        blocks, turn = self._blocks(packets, record_ns, sound)
        starts = np.flatnonzero(np.diff(turn, prepend=0))
        begin = 0
        for start in starts.tolist():
            self._keep(blocks.part(begin, start))
            begin = start
            if self._parts:
                frame = join(self._parts)
                self._parts = []
                yield self._frame(frame, partial=False)
        self._keep(blocks.part(begin, len(blocks)).copy())

    def _blocks(
        self, packets: NDArray[Any], record_ns: NDArray[np.int64], sound: NDArray[np.bool_]
    ) -> tuple[Blocks, NDArray[np.int64]]:
        """Return the sound blocks of packets, and the turn of each, shape (B,); 0 for the turn that goes on."""
        raw = packets["blocks"]
        azimuth = raw["azimuth"].astype(np.int64)
        step, after_ns = steps(azimuth, self._device)
        used = azimuth[sound]
        turn = np.cumsum(np.diff(used, prepend=self._azimuth) < 0, dtype=np.int64)
        self._azimuth = int(used[-1])
        header_ns = header_times(packets, helios=self._helios)
        before = np.cumsum(sound.sum(axis=1)) - sound.sum(axis=1)
        first_turn = turn[np.minimum(before, len(turn) - 1)]
        times_ns = self._clock.times(header_ns, record_ns, first_turn)[:, None] + after_ns
        self._losses.add(header_ns, after_ns, azimuth)
        self.facts.lost_packets = self._losses.packets
        second = second_returns(len(packets), self._device)
        return Blocks(used, step[sound], times_ns[sound], second[sound], raw["channels"][sound]), turn

    def _keep(self, blocks: Blocks) -> None:
        if len(blocks):
            if not self._parts and not self._frames:
                self._whole_start = abs(int(blocks.azimuth[0]) - self._seen[0]) <= _WHOLE
            self._parts.append(blocks)

    @property
    def _seen(self) -> tuple[int, int]:
        """Azimuths between which the sensor sees something within a turn."""
        start, end = self._device.fov
        return (start, end) if start < end else (0, 36000)

    def _ends_whole(self, blocks: Blocks) -> bool:
        return abs(self._seen[1] - int(blocks.azimuth[-1] + blocks.step[-1])) <= _WHOLE

    def _frame(self, blocks: Blocks, *, partial: bool) -> PacketFrame:
        stamp_ns = int(blocks.times_ns[-1]) + self._geometry.last_ns
        partial = partial or (self._frames == 0 and not self._whole_start)
        self._frames += 1
        return PacketFrame(self._geometry.points(blocks), stamp_ns, partial=partial)
