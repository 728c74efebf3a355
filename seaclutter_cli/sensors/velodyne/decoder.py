"""Decoder for Velodyne's rotating sensors, based on the library ``velodyne-decoder``."""

import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import InputError, MissingExtraError
from seaclutter_cli.records import SensorFacts
from seaclutter_cli.sensors.packets import DecoderOptions, PacketFamily, PacketFrame, Packets, point_dtype
from seaclutter_cli.sensors.velodyne.packets import (
    BLIND_DEG,
    CLOCK_NS,
    DUAL,
    FULL_CIRCLE,
    MAX_REVOLUTION_NS,
    MODELS,
    MODES,
    PACKET,
    TOLERANCE,
    VLP32B,
    Cut,
    VelodyneClock,
    VelodyneLosses,
    VelodyneModel,
    used_blocks,
    valid_packets,
    view_packets,
)

_MIN_REVOLUTION_NS = 25_000_000
_POSITION_BYTES = 512
_BATCH = 512
_LAST = 2
_UNIT = re.compile(r"^distance_resolution:.*$", re.MULTILINE)


class Velodyne(PacketFamily):
    """Velodyne's rotating sensors except the HDL-64E, whose packets do not name the model."""

    title = "Velodyne"

    def recognises(self, payload: NDArray[np.uint8]) -> bool:
        """Return whether a UDP payload, shape (L,), is a data packet; position packets contain nothing useful."""
        return len(_known_models(payload[None])) > 0

    def decoder(self, packets: Packets, options: DecoderOptions) -> "VelodyneDecoder":
        """Return a decoder for the model that most packets name; `InputError` if it is unknown or ambiguous."""
        known = _known_models(packets.payloads)
        if not len(known):
            raise InputError("the packets are not from a supported Velodyne sensor")
        return VelodyneDecoder(int(np.bincount(known).argmax()), options)


def _known_models(payloads: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the factory bytes of known models in valid packets among payloads, shape (P, L)."""
    packets = view_packets(payloads)
    models = packets["model"][valid_packets(packets)]
    return np.asarray(models[np.isin(models, list(MODELS))])


def _library() -> Any:
    try:
        return import_module("velodyne_decoder")
    except ImportError as error:
        raise MissingExtraError("decoding Velodyne packets", "velodyne") from error


class VelodyneDecoder:
    """Decoder for the packets of one sensor, whose model a factory byte identifies.

    Revolutions are split at azimuth 0, or in the middle of a blind sector. A file of angles in the format of
    velodyne-decoder and ROS (YAML) replaces the model's usual ones.

    State: packets of the incomplete revolution, at most half a second; packets of the first revolution until the blind
    sector is known. A packet in which a revolution ends is duplicated; each copy keeps the channels of one revolution.
    """

    def __init__(self, factory: int, options: DecoderOptions) -> None:
        """Select the model and read its calibration."""
        self._factory, self._model = factory, _choose_model(factory, options.model)
        library = _library()
        self._packet, self._scan = library.VelodynePacket, library.PacketVector
        self._times = library.velodyne_decoder_pylib.TimePair
        model = getattr(library.Model, self._model.library)
        calibration = _read_calibration(library, options.calibration, self._model)
        config = library.Config(
            model=model, calibration=calibration, min_range=0.0, max_range=1000.0, timestamp_first_packet=True
        )
        self._decoder = library.ScanDecoder(config)
        self.facts = SensorFacts(self._model.name)
        self._clock = VelodyneClock(self.facts)
        self._losses = VelodyneLosses(self.facts, self._model)
        self._cut: Cut | None = None
        self._packets = np.empty(0, PACKET)
        self._times_ns = np.empty(0, np.int64)
        self._starts_at_cut = False

    def add(self, packets: Packets) -> Iterator[PacketFrame]:
        """Yield the frames that these packets complete. Position packets are ignored; invalid packets are counted."""
        views = view_packets(packets.payloads)
        good = valid_packets(views) & (views["model"] == self._factory)
        if packets.payloads.shape[1] != _POSITION_BYTES:
            self.facts.bad_packets += len(packets) - int(good.sum())
        indices = np.flatnonzero(good)
        for start in range(0, len(indices), _BATCH):
            part = indices[start : start + _BATCH]
            yield from self._process(views[part], packets.times_ns[part])

    def _process(self, packets: NDArray[Any], host_ns: NDArray[np.int64]) -> Iterator[PacketFrame]:
        times_ns = self._clock.unix_ns(host_ns, packets["time_us"])
        self.facts.details["return mode"] = MODES[int(packets["mode"][-1])]
        self._packets = np.concatenate((self._packets, packets))
        self._times_ns = np.concatenate((self._times_ns, times_ns))
        if self._cut is None:
            self._cut = Cut.find(self._azimuths(), self._times_ns)
        self._losses.add(packets, host_ns, self._cut)
        if self._cut is not None:
            yield from self._revolutions(self._cut)

    def finish(self) -> Iterator[PacketFrame]:
        """Yield the remaining points; they are partial unless they reach the end of a revolution."""
        if self._cut is None:
            self._cut = Cut.at_zero()
            self._losses.add(self._packets[:0], self._times_ns[:0], self._cut)
            yield from self._revolutions(self._cut)
        if len(self._packets):
            yield self._frame(len(self._packets), 0, self._cut, ended=False)

    def _azimuths(self) -> NDArray[np.int64]:
        """Return the azimuth of each block, shape (P, 12), in 0.01°; unused blocks repeat the last used one."""
        used = used_blocks(self._packets)
        azimuths = self._packets["blocks"]["azimuth"].astype(np.int64)
        return np.where(used, azimuths, azimuths[:, 7:8])

    def _revolutions(self, cut: Cut) -> Iterator[PacketFrame]:
        """Yield the complete revolutions and drop their packets."""
        while (end := self._next_end(cut)) is not None:
            packet, block, ended = end
            yield self._frame(packet, block, cut, ended=ended)

    def _next_end(self, cut: Cut) -> tuple[int, int, bool] | None:
        """Return the packet and block that start the next revolution, and whether they follow a cut, not a pause."""
        if not len(self._packets):
            return None
        elapsed = self._times_ns - self._times_ns[0]
        late = np.flatnonzero((elapsed > MAX_REVOLUTION_NS) | (elapsed < -CLOCK_NS))
        for index in cut.revolution_starts(self._azimuths()):
            packet, block = divmod(int(index), 12)
            if len(late) and late[0] <= packet:
                break
            if not self._starts_at_cut or elapsed[packet] > _MIN_REVOLUTION_NS:
                whole = self._model.banks > 1 and block > 0  # the library needs the step between packets
                return (packet + 1, 0, True) if whole else (packet, block, True)
        return (int(late[0]), 0, False) if len(late) else None

    def _frame(self, packet: int, block: int, cut: Cut, *, ended: bool) -> PacketFrame:
        """Return the revolution before a block of a packet, and keep the packets from there on."""
        if block:
            self._split_packet(packet, block)
            packet += 1
        azimuths = (self._azimuths()[:packet] - cut.azimuth) % FULL_CIRCLE
        points, stamp_ns = self._decode(packet)
        begun = self._starts_at_cut or cut.is_start(int(azimuths[0, 0]))
        partial = not (begun and (ended or cut.is_end(int(azimuths[-1, -1]))))
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
        points = np.empty(len(raw), point_dtype(returns=dual))
        for name in ("x", "y", "z", "intensity", "ring"):
            points[name] = raw[name]
        times = start_ns + np.rint(raw["time"].astype(np.float64) * 1e9).astype(np.int64)
        points["timestamp"] = times / 1e9
        if dual:
            points["return_number"] = np.where(raw["return_type"] == _LAST, 2, 1)
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
        text = library.Calibration.read(str(path)).to_string()
        lasers = text.count("laser_id:")
        # The ROS drivers' calibration of the Alpha Prime states a wrong distance unit.
        calibration = library.Calibration.from_string(_UNIT.sub(_UNIT.findall(usual)[0], text))
    except Exception as error:  # the library does not wrap errors of its YAML parser
        raise InputError(f"{path}: not a valid Velodyne calibration ({error})") from error
    if lasers != model.lasers:  # not checked by the library
        raise InputError(f"{path}: the calibration has {lasers} lasers, the {model.name} has {model.lasers}")
    return calibration
