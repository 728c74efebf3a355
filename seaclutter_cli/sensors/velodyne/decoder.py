"""Decoder for Velodyne's rotating sensors, based on the library ``velodyne-decoder``."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Bytes, Ints, Mask
from seaclutter_cli.documents import read_document
from seaclutter_cli.errors import InputError, requiring
from seaclutter_cli.records import SensorFacts
from seaclutter_cli.sensors.packets import DecoderOptions, PacketFamily, PacketFrame, Packets, make_points, view_packets

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
_MIN_REVOLUTION_NS = 25_000_000
_POSITION_BYTES = 512
_BATCH = 512
_LAST = 2
_UNIT = re.compile(r"^distance_resolution:.*$", re.MULTILINE)


@dataclass(frozen=True)
class VelodyneModel:
    """A sensor: name, name in the library, lasers, period of single-return packets (µs), blocks per column.

    ``dual_rate`` is the number of dual-return packets in that period.
    """

    name: str
    library: str
    lasers: int
    period_us: float
    banks: int = 1
    dual_rate: int = 2


MODELS: Mapping[int, VelodyneModel] = {
    0x21: VelodyneModel("HDL-32E", "HDL32E", 32, 552.96),
    0x22: VelodyneModel("VLP-16", "VLP16", 16, 1327.104),
    0x23: VelodyneModel("VLP-32A", "VLP32A", 32, 663.552),
    0x24: VelodyneModel("Puck Hi-Res", "PuckHiRes", 16, 1327.104),
    0x28: VelodyneModel("VLP-32C", "VLP32C", 32, 663.552),
    0xA1: VelodyneModel("Alpha Prime", "VLS128", 128, 173.4, banks=4, dual_rate=3),
}
"""Models by factory byte. VLP-32A and VLP-32B share one."""
VLP32B = VelodyneModel("VLP-32B", "VLP32B", 32, 663.552)


def valid_packets(packets: NDArray[Any]) -> Mask:
    """Return which packets, shape (P,), are valid. Models with one bank send only blocks of bank 0."""
    used = used_blocks(packets)
    blocks = packets["blocks"]
    many = packets["model"][:, None] == 0xA1
    flags = np.where(many, np.isin(blocks["bank"], _BANKS), blocks["bank"] == _BANKS[0])
    fit = np.all((flags & (blocks["azimuth"] < FULL_CIRCLE)) | ~used, axis=1)
    return np.asarray(fit & np.isin(packets["mode"], list(MODES)))


def used_blocks(packets: NDArray[Any]) -> Mask:
    """Return which blocks contain data, shape (P, 12); the last four of a dual-return Alpha Prime do not."""
    short = (packets["model"] == 0xA1) & (packets["mode"] == DUAL)
    return np.asarray(~short[:, None] | (np.arange(12) < 8))


def _near(host_ns: Ints, times_ns: Ints) -> Ints:
    """Return the times nearest to the recording times that differ from given ones by whole hours."""
    return host_ns + (times_ns - host_ns + _HOUR_NS // 2) % _HOUR_NS - _HOUR_NS // 2


@dataclass(frozen=True)
class Cut:
    """Azimuth at which revolutions are split, in 0.01°, and whether the sensor measures in each degree from there on.

    ``blind`` is start and end of the blind sector in 0.01°; None without one.
    """

    azimuth: int = 0
    covered: Mask = field(default_factory=lambda: np.ones(360, np.bool_))
    blind: tuple[int, int] | None = None

    @classmethod
    def find(cls, azimuths: Ints, times_ns: Ints) -> "Cut | None":
        """Return the cut for packets with azimuths of shape (P, 12); None until they span a full revolution."""
        flat = azimuths.ravel()
        steps: Ints = np.mod(np.diff(flat), FULL_CIRCLE)
        rotation = np.cumsum(np.where(steps < 3 * FULL_CIRCLE // 4, steps, 0))
        if not len(rotation) or rotation[-1] < FULL_CIRCLE:
            return cls() if np.ptp(times_ns) > MAX_REVOLUTION_NS else None
        covered = np.zeros(360, bool)
        covered[flat[: np.searchsorted(rotation, FULL_CIRCLE) + 2] // 100] = True
        degrees = np.flatnonzero(covered)
        sizes = np.diff(degrees, append=degrees[0] + 360) - 1
        begin, size = (int(degrees[sizes.argmax()]) + 1) % 360, int(sizes.max())  # of the longest gap
        if size < BLIND_DEG:
            return cls()
        azimuth = (begin + size // 2) % 360
        return cls(azimuth * 100, np.roll(covered, -azimuth), (begin * 100, (begin + size) % 360 * 100))


class _Losses:
    """Counter of lost packets, from gaps in the sensor time that the recording times confirm."""

    def __init__(self, facts: SensorFacts, model: VelodyneModel) -> None:
        self._facts, self._model = facts, model
        self._packets = np.empty(0, PACKET)
        self._host_ns = np.empty(0, np.int64)

    def add(self, packets: NDArray[Any], host_ns: Ints, cut: Cut | None) -> None:
        """Add the next packets; count the gaps between packets once the cut is known, and keep the last packet."""
        self._packets = np.concatenate((self._packets, packets))
        self._host_ns = np.concatenate((self._host_ns, host_ns))
        if cut is None or len(self._packets) < 2:
            return
        gaps: Ints = np.mod(np.diff(self._packets["time_us"].astype(np.int64)) * 1000, _HOUR_NS)
        rates = np.where(self._packets["mode"][:-1] == DUAL, self._model.dual_rate, 1)
        missing = np.rint(gaps / (self._model.period_us * 1000) * rates).astype(np.int64) - 1
        real = np.abs(np.diff(self._host_ns) - gaps) < CLOCK_NS // 4
        self._facts.lost_packets += int(missing[(missing > 0) & real & ~self._blind_gaps(cut)].sum())
        self._packets, self._host_ns = self._packets[-1:], self._host_ns[-1:]

    def _blind_gaps(self, cut: Cut) -> Mask:
        first = self._packets["blocks"]["azimuth"][:, 0].astype(np.int64)
        if cut.blind is None:
            return np.zeros(len(first) - 1, bool)
        begin, end = cut.blind
        self._facts.details["field of view"] = f"{end // 100}° to {begin // 100}°"
        jump: Ints = np.mod(np.diff(first), FULL_CIRCLE)
        reach: Ints = np.mod(begin - first[:-1] + TOLERANCE, FULL_CIRCLE)
        return np.asarray((reach <= jump + TOLERANCE) & (jump < (end - begin) % FULL_CIRCLE + 5 * TOLERANCE))


class Velodyne(PacketFamily):
    """Velodyne's rotating sensors except the HDL-64E, whose packets do not name the model."""

    title = "Velodyne"

    def recognises(self, payload: Bytes) -> bool:
        """Return whether a UDP payload, shape (L,), is a data packet; position packets contain nothing useful."""
        return len(_known_models(payload[None])) > 0

    def decoder(self, packets: Packets, options: DecoderOptions) -> "_Decoder":
        """Return a decoder for the model that most packets name; `InputError` if it is unknown or ambiguous."""
        known = _known_models(packets.payloads)
        if not len(known):
            raise InputError("the packets are not from a supported Velodyne sensor")
        return _Decoder(int(np.bincount(known).argmax()), options)


def _known_models(payloads: Bytes) -> Bytes:
    """Return the factory bytes of known models in valid packets among payloads, shape (P, L)."""
    packets = view_packets(payloads, PACKET)
    models = packets["model"][valid_packets(packets)]
    return np.asarray(models[np.isin(models, list(MODELS))])


class _Decoder:
    """Decoder for the packets of one sensor, whose model a factory byte identifies.

    Revolutions are split at azimuth 0, or in the middle of a blind sector. A file of angles in the format of
    velodyne-decoder and ROS (YAML) replaces the model's usual ones.

    State: packets of the incomplete revolution, at most half a second; packets of the first revolution until the blind
    sector is known. A packet in which a revolution ends is duplicated; each copy keeps the channels of one revolution.
    """

    places_end = _HOUR_NS // 1000

    def __init__(self, factory: int, options: DecoderOptions) -> None:
        self._factory, self._model = factory, _choose_model(factory, options.model)
        with requiring("decoding Velodyne packets", "velodyne"):
            library: Any = import_module("velodyne_decoder")
        self._packet, self._scan = library.VelodynePacket, library.PacketVector
        self._times = library.velodyne_decoder_pylib.TimePair
        model = getattr(library.Model, self._model.library)
        calibration = _read_calibration(library, options.calibration, self._model)
        config = library.Config(
            model=model, calibration=calibration, min_range=0.0, max_range=1000.0, timestamp_first_packet=True
        )
        self._decoder = library.ScanDecoder(config)
        self.facts = SensorFacts(self._model.name)
        self._offset_ns: int | None = None
        self._losses = _Losses(self.facts, self._model)
        self._cut: Cut | None = None
        self._packets = np.empty(0, PACKET)
        self._times_ns = np.empty(0, np.int64)
        self._starts_at_cut = False

    def places(self, packets: Packets) -> Ints:
        """Return the times of data packets in the hour, shape (P,), in microseconds; -1 for position packets."""
        views = view_packets(packets.payloads, PACKET)
        return views["time_us"].astype(np.int64) if len(views) else np.full(len(packets), -1)

    def add(self, packets: Packets) -> Iterator[PacketFrame]:
        views = view_packets(packets.payloads, PACKET)
        good = valid_packets(views) & (views["model"] == self._factory)
        if packets.payloads.shape[1] != _POSITION_BYTES:
            self.facts.bad_packets += len(packets) - int(good.sum())
        indices = np.flatnonzero(good)
        for start in range(0, len(indices), _BATCH):
            part = indices[start : start + _BATCH]
            yield from self._process(views[part], packets.times_ns[part])

    def _process(self, packets: NDArray[Any], host_ns: Ints) -> Iterator[PacketFrame]:
        times_ns = self._unix_ns(host_ns, packets["time_us"].astype(np.int64) * 1000)
        self.facts.details["return mode"] = MODES[int(packets["mode"][-1])]
        self._packets = np.concatenate((self._packets, packets))
        self._times_ns = np.concatenate((self._times_ns, times_ns))
        if self._cut is None:
            self._cut = Cut.find(self._azimuths(), self._times_ns)
        self._losses.add(packets, host_ns, self._cut)
        if self._cut is not None:
            yield from self._revolutions(self._cut)

    def _unix_ns(self, host_ns: Ints, times_ns: Ints) -> Ints:
        """Return times of the hour, shape (P,), as Unix times; a clock that is not set follows the recording time."""
        near = _near(host_ns, times_ns + (self._offset_ns or 0))
        if self._offset_ns is None or abs(host_ns[0] - near[0]) > CLOCK_NS:
            error = int((host_ns - _near(host_ns, times_ns))[0])
            self._offset_ns = error if abs(error) > CLOCK_NS else 0
            relation = "shifted to the recording time" if self._offset_ns else "consistent with the recording time"
            self.facts.details["clock"] = f"sensor time, {relation}"
            near = _near(host_ns, times_ns + self._offset_ns)
        return near

    def finish(self) -> Iterator[PacketFrame]:
        """Yield the remaining points; they are partial unless they reach the end of a revolution."""
        if self._cut is None:
            self._cut = Cut()
            self._losses.add(self._packets[:0], self._times_ns[:0], self._cut)
            yield from self._revolutions(self._cut)
        if len(self._packets):
            yield self._frame(self._cut, len(self._packets), 0, ended=False)

    def _azimuths(self) -> Ints:
        """Return the azimuth of each block, shape (P, 12), in 0.01°; unused blocks repeat the last used one."""
        used = used_blocks(self._packets)
        azimuths = self._packets["blocks"]["azimuth"].astype(np.int64)
        return np.where(used, azimuths, azimuths[:, 7:8])

    def _revolutions(self, cut: Cut) -> Iterator[PacketFrame]:
        while end := self._next_end(cut):
            yield self._frame(cut, *end)

    def _next_end(self, cut: Cut) -> tuple[int, int, bool] | None:
        """Return the packet and block that start the next revolution, and whether they follow a cut, not a pause."""
        if not len(self._packets):
            return None
        elapsed = self._times_ns - self._times_ns[0]
        late = np.flatnonzero((elapsed > MAX_REVOLUTION_NS) | (elapsed < -CLOCK_NS))
        azimuths = ((self._azimuths() - cut.azimuth) % FULL_CIRCLE).ravel()
        starts = np.flatnonzero(np.diff(azimuths) < -int(cut.covered.sum()) * 100 // 2) + 1
        for packet, block in (divmod(start, 12) for start in starts.tolist()):
            if len(late) and late[0] <= packet:
                break
            if not self._starts_at_cut or elapsed[packet] > _MIN_REVOLUTION_NS:
                whole = self._model.banks > 1 and block > 0  # the library needs the step between packets
                return (packet + 1, 0, True) if whole else (packet, block, True)
        return (int(late[0]), 0, False) if len(late) else None

    def _frame(self, cut: Cut, packet: int, block: int, ended: bool) -> PacketFrame:
        """Return the revolution before a block of a packet, and keep the packets from there on."""
        if block:
            self._split_packet(packet, block)
            packet += 1
        degrees = (self._azimuths()[:packet] - cut.azimuth) % FULL_CIRCLE // 100
        points, stamp_ns = self._decode(packet)
        # A revolution is whole if the sensor measures nothing between its ends and the cut.
        begun = self._starts_at_cut or not cut.covered[: max(degrees[0, 0] - 1, 0)].any()
        partial = not (begun and (ended or not cut.covered[degrees[-1, -1] + 2 :].any()))
        self._packets, self._times_ns = self._packets[packet:], self._times_ns[packet:]
        self._starts_at_cut = ended
        return PacketFrame(points, stamp_ns, partial=partial)

    def _split_packet(self, packet: int, block: int) -> None:
        """Replace a packet by two: the first keeps the blocks before the given one, the second the others."""
        pair = np.repeat(self._packets[packet : packet + 1], 2)
        blocks = pair["blocks"]
        blocks["channels"][0, block:] = blocks["channels"][1, :block] = b""
        azimuths = blocks["azimuth"].astype(np.int64)
        steps = np.diff(azimuths[0]) % FULL_CIRCLE
        if steps[block - 1] > BLIND_DEG * 100:  # the library would treat the blind sector as rotation
            pace = float(steps[np.arange(11) != block - 1].mean())
            indices = np.arange(12)
            ahead = np.rint(azimuths[0, block - 1] + pace * (indices - block + 1)).astype(np.int64)
            behind = np.rint(azimuths[1, block] - pace * (block - indices)).astype(np.int64)
            blocks["azimuth"][0, block:] = ahead[block:] % FULL_CIRCLE
            blocks["azimuth"][1, :block] = behind[:block] % FULL_CIRCLE
        self._packets = np.concatenate((self._packets[:packet], pair, self._packets[packet + 1 :]))
        self._times_ns = np.insert(self._times_ns, packet, self._times_ns[packet])

    def _correct_first_time(self) -> None:
        """Set the time of the rest of a packet split by a blind sector to one period before the next packet."""
        if len(self._packets) < 2 or not self._starts_at_cut:
            return
        step = int(self._azimuths()[1, 0] - self._azimuths()[0, -1]) % FULL_CIRCLE
        if step < TOLERANCE:
            dual = self._packets["mode"][0] == DUAL
            period_ns = round(self._model.period_us * 1000 / (self._model.dual_rate if dual else 1))
            if self._times_ns[1] - self._times_ns[0] > 2 * period_ns:
                self._times_ns[0] = self._times_ns[1] - period_ns

    def _decode(self, count: int) -> tuple[NDArray[Any], int]:
        """Return the points of the first ``count`` packets, shape (N,), and the time of the last point in ns."""
        self._correct_first_time()
        packets, times_ns = self._packets[:count], self._times_ns[:count]
        start_ns = int(times_ns[0])
        raw_bytes = packets.view(np.uint8).reshape(count, -1)
        stamps = (self._times(second, second) for second in ((times_ns - start_ns) / 1e9).tolist())
        scan = self._scan([self._packet(stamp, row.tolist()) for stamp, row in zip(stamps, raw_bytes, strict=True)])
        _, raw = self._decoder.decode(scan, True)
        dual = bool((packets["mode"] == DUAL).any())
        times = start_ns + np.rint(raw["time"].astype(np.float64) * 1e9).astype(np.int64)
        number = np.where(raw["return_type"] == _LAST, 2, 1) if dual else None
        points = make_points([raw[axis] for axis in "xyz"], raw["intensity"], raw["ring"], times / 1e9, number)
        return points, int(times[-1]) if len(times) else int(times_ns[-1])


def _choose_model(factory: int, wanted: str | None) -> VelodyneModel:
    model = MODELS[factory]
    if factory != 0x23:
        return model
    named = {kind.name: kind for kind in (model, VLP32B)}
    if wanted not in named:
        raise InputError("VLP-32A and VLP-32B share a packet format: select one with --sensor")
    return named[wanted]


def _read_calibration(library: Any, path: Path | None, model: VelodyneModel) -> Any:
    if path is None:
        return None
    usual = library.Calibration.default_calibs[getattr(library.Model, model.library)].to_string()
    try:
        text = library.Calibration.from_string(read_document(path).decode()).to_string()
        lasers = text.count("laser_id:")
        # The ROS drivers' calibration of the Alpha Prime states a wrong distance unit.
        calibration = library.Calibration.from_string(_UNIT.sub(_UNIT.findall(usual)[0], text))
    except Exception as error:  # the library does not wrap errors of its YAML parser
        raise InputError(f"{path}: not a valid Velodyne calibration ({error})") from error
    if lasers != model.lasers:  # not checked by the library
        raise InputError(f"{path}: the calibration has {lasers} lasers, the {model.name} has {model.lasers}")
    return calibration
