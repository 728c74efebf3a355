"""Velodyne: packets of the spinning sensors, decoded by the velodyne-decoder library."""

from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import InputError, MissingExtraError
from seaclutter_cli.records import SensorFacts
from seaclutter_cli.sensors.packets import DecoderOptions, PacketFrame, Packets, point_dtype
from seaclutter_cli.sensors.velodyne.packets import (
    BLIND_DEG,
    CLOCK_NS,
    CLOSE,
    DUAL,
    LONGEST_TURN_NS,
    MODELS,
    MODES,
    PACKET,
    TURN,
    VLP32B,
    Cut,
    VelodyneClock,
    VelodyneLosses,
    VelodyneModel,
    are_sound,
    used_blocks,
    view_packets,
)

_SHORTEST_TURN_NS = 25_000_000
_POSITION_BYTES = 512
_PORTION = 512
_LAST = 2


class _Velodyne:
    """Velodyne's spinning sensors but the HDL-64E, whose packets do not say what they are."""

    title = "Velodyne"
    scan_types: Mapping[str, str] = {"velodyne_msgs/msg/VelodyneScan": "packets"}

    def recognises(self, payload: NDArray[np.uint8]) -> bool:
        """Tell whether a UDP payload, shape (L,), is a data packet; position packets hold nothing of use."""
        if len(payload) != PACKET.itemsize:
            return False
        record = payload.tobytes()
        packet = np.frombuffer(record, PACKET)
        return int(packet["model"][0]) in MODELS and bool(are_sound(packet)[0])

    def decoder(self, packets: Packets, options: DecoderOptions) -> "VelodyneDecoder":
        """Return a decoder for the model that most of some packets name.

        Raises
        ------
        InputError
            If none of them is a Velodyne packet, the model has to be told or the calibration cannot be read.
        MissingExtraError
            If the library is not installed.
        """
        views = view_packets(packets.payloads)
        models = views["model"][are_sound(views)]
        known = models[np.isin(models, list(MODELS))]
        if not len(known):
            raise InputError("none of the packets is from a Velodyne sensor that is known")
        return VelodyneDecoder(int(np.bincount(known).argmax()), options)


VELODYNE = _Velodyne()


def _library() -> Any:
    try:
        return import_module("velodyne_decoder")
    except ImportError as error:
        raise MissingExtraError("decoding Velodyne packets", "velodyne") from error


class VelodyneDecoder:
    """Decodes one sensor's packets; turns end at azimuth 0, or in the middle of a sector that the sensor leaves out.

    Parameters
    ----------
    factory : int
        Factory byte of the packets, which names the model.
    options : DecoderOptions
        ``calibration`` is a YAML file as velodyne-decoder and ROS have it, in place of the model's usual angles.

    Notes
    -----
    State: packets of the turn that is not complete, at most half a second of them; those of the first turn until it is
    known which sector is left out. The packet in which a turn ends is made two, with the other's channels emptied.
    """

    def __init__(self, factory: int, options: DecoderOptions) -> None:
        """Choose the model and its calibration."""
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
        self._searched = 0
        self._began_cut = False

    def add(self, packets: Packets) -> Iterator[PacketFrame]:
        """Yield the frames that these packets complete; position packets are left out, others that do not fit count."""
        views = view_packets(packets.payloads)
        good = are_sound(views) & (views["model"] == self._factory)
        if packets.payloads.shape[1] != _POSITION_BYTES:
            self.facts.bad_packets += len(packets) - int(good.sum())
        places = np.flatnonzero(good)
        for start in range(0, len(places), _PORTION):
            part = places[start : start + _PORTION]
            yield from self._take(views[part], packets.times_ns[part])

    def _take(self, packets: NDArray[Any], host_ns: NDArray[np.int64]) -> Iterator[PacketFrame]:
        times_ns = self._clock.unix_ns(host_ns, packets["time_us"])
        self.facts.details["returns"] = MODES[int(packets["mode"][-1])]
        self._packets = np.concatenate((self._packets, packets))
        self._times_ns = np.concatenate((self._times_ns, times_ns))
        self._losses.hold(packets, host_ns)
        if self._cut is None:
            self._cut = Cut.find(self._azimuths(), self._times_ns)
        if self._cut is not None:
            yield from self._turns(self._cut)

    def finish(self) -> Iterator[PacketFrame]:
        """Yield what is left; it is partial unless it reaches the end of a turn."""
        if self._cut is None:
            self._cut = Cut.unknown()
            yield from self._turns(self._cut)
        if len(self._packets):
            yield self._frame(len(self._packets), 0, self._cut, ended=False)

    def _azimuths(self) -> NDArray[np.int64]:
        """Return the azimuth of each block, shape (P, 12), in 0.01°; of one that is not used, that of the last used."""
        used = used_blocks(self._packets)
        azimuths = self._packets["blocks"]["azimuth"].astype(np.int64)
        return np.where(used, azimuths, azimuths[:, 7:8])

    def _turns(self, cut: Cut) -> Iterator[PacketFrame]:
        """Yield the turns that are complete, and drop their packets."""
        self._losses.count(cut)
        while (end := self._next_end(cut)) is not None:
            packet, block, ended = end
            yield self._frame(packet, block, cut, ended=ended)

    def _next_end(self, cut: Cut) -> tuple[int, int, bool] | None:
        """Return packet and block with which the next turn begins, and whether it is a cut and no pause."""
        if not len(self._packets):
            return None
        elapsed = self._times_ns - self._times_ns[0]
        late = np.flatnonzero((elapsed > LONGEST_TURN_NS) | (elapsed < -CLOCK_NS))
        for place in cut.places(self._azimuths(), after=self._searched):
            packet, block = divmod(int(place), 12)
            if len(late) and late[0] <= packet:
                break
            if not self._began_cut or elapsed[packet] > _SHORTEST_TURN_NS:
                whole = self._model.banks > 1 and block > 0  # its decoder needs the step from packet to packet
                return (packet + 1, 0, True) if whole else (packet, block, True)
        if len(late):
            return int(late[0]), 0, False
        self._searched = max(12 * len(self._packets) - 1, 0)
        return None

    def _frame(self, packet: int, block: int, cut: Cut, *, ended: bool) -> PacketFrame:
        """Return the turn before a block of a packet, and keep what comes from there on."""
        if block:
            self._divide(packet, block)
            packet += 1
        azimuths = (self._azimuths()[:packet] - cut.azimuth) % TURN
        points, stamp_ns = self._decode(packet)
        begun = self._began_cut or cut.begins(int(azimuths[0, 0]))
        partial = not (begun and (ended or cut.ends(int(azimuths[-1, -1]))))
        self._packets, self._times_ns = self._packets[packet:], self._times_ns[packet:]
        self._began_cut, self._searched = ended, 0
        return PacketFrame(points, stamp_ns, partial=partial)

    def _divide(self, packet: int, block: int) -> None:
        """Make a packet two, of which the first keeps the blocks before one and the second the others."""
        pair = np.repeat(self._packets[packet : packet + 1], 2)
        blocks = pair["blocks"]
        blocks["channels"][0, block:] = blocks["channels"][1, :block] = b""
        azimuths = blocks["azimuth"].astype(np.int64)
        steps = np.diff(azimuths[0]) % TURN
        if steps[block - 1] > BLIND_DEG * 100:  # the library takes it for so much rotation within the packet
            pace = float(steps[np.arange(11) != block - 1].mean())
            places = np.arange(12)
            ahead = np.rint(azimuths[0, block - 1] + pace * (places - block + 1)).astype(np.int64)
            behind = np.rint(azimuths[1, block] - pace * (block - places)).astype(np.int64)
            blocks["azimuth"][0, block:] = ahead[block:] % TURN
            blocks["azimuth"][1, :block] = behind[:block] % TURN
        self._packets = np.concatenate((self._packets[:packet], pair, self._packets[packet + 1 :]))
        self._times_ns = np.insert(self._times_ns, packet, self._times_ns[packet])

    def _settle_first(self) -> None:
        """Give the second half of a packet that was divided by a blind sector its time: a packet before the next."""
        if len(self._packets) < 2 or not self._began_cut:
            return
        step = int(self._azimuths()[1, 0] - self._azimuths()[0, -1]) % TURN
        if step < CLOSE:
            dual = self._packets["mode"][0] == DUAL
            period_ns = round(self._model.period_us * 1000 / (self._model.shares if dual else 1))
            if self._times_ns[1] - self._times_ns[0] > 2 * period_ns:
                self._times_ns[0] = self._times_ns[1] - period_ns

    def _decode(self, count: int) -> tuple[NDArray[Any], int]:
        """Return the points of the first packets, shape (N,), and the time of the last in nanoseconds."""
        self._settle_first()
        packets, times_ns = self._packets[:count], self._times_ns[:count]
        start_ns = int(times_ns[0])
        octets = packets.view(np.uint8).reshape(count, -1)
        stamps = (self._times(second, second) for second in ((times_ns - start_ns) / 1e9).tolist())
        scan = self._scan([self._packet(stamp, row.tolist()) for stamp, row in zip(stamps, octets, strict=True)])
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
        raise InputError("the packets are from a VLP-32A or a VLP-32B, which look alike: say which it is")
    return named[wanted]


def _read_calibration(library: Any, path: Path | None, model: VelodyneModel) -> Any:
    if path is None:
        return None
    try:
        calibration = library.Calibration.read(str(path))
        lasers = calibration.to_string().count("laser_id:")
    except Exception as error:  # the library passes on what its YAML parser throws
        raise InputError(f"{path}: no calibration of a Velodyne sensor ({error})") from error
    if lasers != model.lasers:  # of which the library does not take heed
        raise InputError(f"{path}: the calibration has {lasers} lasers, the {model.name} has {model.lasers}")
    return calibration
