"""Captures of lidar packets: PCAP and PCAPNG."""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from seaclutter_cli.errors import InputError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.messages.definitions import ros2_schema
from seaclutter_cli.records import Channel, Damage, Message
from seaclutter_cli.sensors.families import PACKET_FAMILIES
from seaclutter_cli.sensors.packets import CALIBRATION_SUFFIXES, DecoderOptions, PacketDecoder, PacketFrame
from seaclutter_cli.sources.pcap import PCAP_MAGICS, PCAPNG_MAGIC, metadata_of
from seaclutter_cli.sources.pcap.records import PcapngReader, PcapReader, RecordReader
from seaclutter_cli.sources.pcap.sensors import CapturedSensor, SensorSearch
from seaclutter_cli.sources.pcap.udp import Udp
from seaclutter_cli.sources.shared.log_file import LogFile, LostDataError
from seaclutter_cli.sources.shared.packet_streams import CloudStream
from seaclutter_cli.text import count

_TYPE = "sensor_msgs/msg/PointCloud2"
_MAX_WAITING = 16
_LATEST_NS = (2**31 - 1) * 10**9
_SHOWN_FLOWS = 5
_WINDOW = 4 * 2**20


class CaptureSource(Source):
    """A capture of one or several sensors; each revolution is a ROS 2 point cloud.

    One sensor is on ``/points``, several are on ``/points/<address>``, or ``/points/<address>/<port>`` if they share an
    address. `InputError` if the file is not a capture, or none of its packets can be decoded.
    """

    channels: Sequence[Channel] = ()
    span_ns: tuple[int, int] | None = None

    def __init__(self, path: Path, options: DecoderOptions | None = None) -> None:
        super().__init__()
        self.name, self._path = path.stem, path
        self._options = options or DecoderOptions()
        self._file = LogFile(path, _WINDOW)
        try:
            decoders = self._usable(self._search())
        except BaseException:
            self._file.close()
            raise
        self._sensors = sensors = [sensor for sensor, _ in decoders]
        topics = [f"/points/{sensor.address}" + f"/{sensor.port}" * sensor.shares for sensor in sensors]
        topics = topics if len(topics) > 1 else ["/points"]
        self.channels = [Channel(number, topic, "cdr", ros2_schema(_TYPE)) for number, topic in enumerate(topics, 1)]
        self._start([decoder for _, decoder in decoders])
        models = dict.fromkeys(facts.model for facts in self.facts.values())
        kind = "PCAPNG" if self._file[:4] == PCAPNG_MAGIC else "PCAP"
        self.format = f"{kind} of {', '.join(models)}"

    def _reader(self) -> RecordReader:
        if self._file[:4] == PCAPNG_MAGIC:
            return PcapngReader(self._file, self._path)
        if bytes(self._file[:4]) in PCAP_MAGICS:
            return PcapReader(self._file, self._path)
        raise InputError(f"{self._path}: not a packet capture: it does not begin with PCAP or PCAPNG magic bytes")

    def _search(self) -> SensorSearch:
        """Search the whole capture: a sensor's calibration may be anywhere in it."""
        reader, udp = self._reader(), Udp(self._file)
        search = SensorSearch()
        for kind, packets in udp.packets(reader, lambda kind: kind):
            search.add(kind, packets)
            first, last = int(packets.times_ns.min()), int(packets.times_ns.max())
            known = self.span_ns or (first, last)
            self.span_ns = (min(known[0], first), max(known[1], last))
        udp.fragments.finish()
        self.damage += reader.damage
        for flow in search.damaged_flows():
            problem = f"{count(flow.count, 'packet')} from {flow.ends}, too few for a sensor"
            self.damage.append(Damage(self._path, None, problem, flow.count * flow.length))
        for flow, number in search.headless(self._file, udp):
            problem = f"{count(number, 'packet')} like those from {flow.ends}, with damaged headers"
            self.damage.append(Damage(self._path, None, problem, number * flow.length))
        if udp.fragments.lost:
            self.warnings.append(f"fragments of {count(udp.fragments.lost, 'datagram')} are missing")
        if not search.sensors():
            found = _found(search, udp, self.damage)
            raise InputError(f"{self._path}: no packets of a supported lidar; {found}")
        self.warnings += [f"{flow} are not decoded" for flow in search.flows.values() if flow.unsupported]
        return search

    def _usable(self, search: SensorSearch) -> list[tuple[CapturedSensor, PacketDecoder]]:
        """Return the sensors that can be decoded, and their decoders; `InputError` if there are no such sensors."""
        usable: list[tuple[CapturedSensor, PacketDecoder]] = []
        problems = []
        for sensor in search.sensors():
            try:
                usable.append((sensor, self._decoder(sensor)))
            except InputError as error:
                problems.append(f"{sensor.address}: {error}")
        if not usable:
            raise InputError(f"{self._path}: {'; '.join(problems)}")
        self.warnings += problems
        return usable

    def _decoder(self, sensor: CapturedSensor) -> PacketDecoder:
        options = replace(self._options, info=sensor.info)
        if options.calibration is None and (suffix := CALIBRATION_SUFFIXES.get(sensor.family)):
            beside = metadata_of(self._path, suffix)
            is_clear = len(beside) == 1 or self._path.with_suffix(suffix) in beside
            options = replace(options, calibration=beside[0] if is_clear else None)
        return PACKET_FAMILIES[sensor.family].decoder(sensor.sample, options)

    def records(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Message]:  # noqa: ARG002
        """Yield the frames of all sensors in the order of their stamps, until every sensor has one at ``end_ns``."""
        streams = self._start([self._decoder(sensor) for sensor in self._sensors])
        kinds = {kind: number for number, sensor in enumerate(self._sensors) for kind in sensor.kinds}
        flows = {flow: number for (flow, _), number in kinds.items()}
        merge = _Merge(streams)
        udp = Udp(self._file)
        try:
            for number, packets in udp.packets(self._reader(), kinds.get):
                for frame in streams[number].decoder.add(packets):
                    yield from merge.add(number, frame)
                if end_ns is not None and merge.latest_ns >= end_ns:
                    yield from merge.finish()
                    return
        except LostDataError as error:
            self.add_damage(Damage(self._path, None, f"{error.problem}; the frames after this are missing"))
        for number, stream in enumerate(streams):
            for frame in stream.decoder.finish():
                yield from merge.add(number, frame)
        yield from merge.finish()
        for number, stream in enumerate(streams):
            own = sum(udp.cut[flow] for flow, sensor in flows.items() if sensor == number)
            stream.conclude(self._path, "where the capture begins or ends", own)

    def _start(self, decoders: Sequence[PacketDecoder]) -> list[CloudStream]:
        """Return the streams of the sensors, given new decoders."""
        self.facts = {channel.topic: one.facts for channel, one in zip(self.channels, decoders, strict=True)}
        self.warn(*(f"{topic}: {text}" for topic, facts in self.facts.items() for text in facts.warnings))
        sizes = (sensor.sample.payloads.shape[1] for sensor in self._sensors)
        parts = zip(self.channels, decoders, sizes, strict=True)
        return [CloudStream(self, channel, decoder, size) for channel, decoder, size in parts]

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class _Merge:
    """Merger of the frames of several sensors in the order of their stamps; at most 16 of a sensor wait for others."""

    def __init__(self, streams: Sequence[CloudStream]) -> None:
        self._streams = streams
        self._waiting: list[deque[PacketFrame]] = [deque() for _ in streams]
        self._latest_ns = [0] * len(streams)

    def add(self, number: int, frame: PacketFrame) -> Iterator[Message]:
        """Add a frame, and yield the frames whose order is now known."""
        self._waiting[number].append(frame)
        self._latest_ns[number] = frame.stamp_ns
        while all(self._waiting) or max(map(len, self._waiting)) > _MAX_WAITING:
            yield from self._next()

    @property
    def latest_ns(self) -> int:
        """Time up to which the frames of every sensor have been added."""
        return min(self._latest_ns)

    def finish(self) -> Iterator[Message]:
        """Yield the waiting frames."""
        while any(self._waiting):
            yield from self._next()

    def _next(self) -> Iterator[Message]:
        waiting = (number for number, frames in enumerate(self._waiting) if frames)
        number = min(waiting, key=lambda number: self._waiting[number][0].stamp_ns)
        frame = self._waiting[number].popleft()
        # Beyond the limit, the recorded time is damaged.
        message = self._streams[number].message(replace(frame, stamp_ns=min(max(frame.stamp_ns, 0), _LATEST_NS)))
        if message:
            yield message


def _found(search: SensorSearch, udp: Udp, damage: Sequence[Damage]) -> str:
    """Return a description of a capture without sensors, and advice."""
    flows = sorted(search.flows.values(), key=lambda flow: flow.count * flow.length, reverse=True)
    found = [str(flow) for flow in flows[:_SHOWN_FLOWS]]
    if len(flows) > _SHOWN_FLOWS:
        found.append(f"{count(len(flows) - _SHOWN_FLOWS, 'other flow')}")
    parts = [", ".join(found) or "no complete UDP datagrams"]
    if cut := udp.cut.total():
        parts.append(f"{count(cut, 'truncated datagram')}: capture whole packets (tcpdump -s 0)")
    if udp.other:
        parts.append(f"{count(udp.other, 'other packet')}")
    parts += [str(item) for item in damage[:1]]
    titles = ", ".join(family.title for family in PACKET_FAMILIES.values())
    return f"found {'; '.join(parts)}. Supported sensors: {titles}"
