"""Captures of lidar packets: PCAP and PCAPNG."""

from collections import Counter, defaultdict, deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from seaclutter_cli.errors import InputError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.messages.definitions import POINT_CLOUD, ros2_schema
from seaclutter_cli.records import Channel, Damage, Message
from seaclutter_cli.sensors.catalog import ADVICE, name_unsupported
from seaclutter_cli.sensors.families import PACKET_FAMILIES
from seaclutter_cli.sensors.packets import CALIBRATION_SUFFIXES, DecoderOptions, PacketDecoder, PacketFrame, Packets
from seaclutter_cli.sources.pcap import PCAP_MAGICS, PCAPNG_MAGIC, metadata_of
from seaclutter_cli.sources.pcap.records import PcapngReader, PcapReader, RecordReader
from seaclutter_cli.sources.pcap.udp import Kind, Udp, ends
from seaclutter_cli.sources.shared.log_file import LogFile, LostDataError
from seaclutter_cli.sources.shared.packet_streams import MAX_CALIBRATIONS, MAX_SAMPLES, CloudStream, Samples
from seaclutter_cli.text import count

_TRIED_AT_ONCE, _TRIED = 4, 256
_MAX_FLOWS = 10_000
_FEW = 10
_MAX_WAITING = 16
_LATEST_NS = (2**31 - 1) * 10**9
_SHOWN_FLOWS = 5
_WINDOW = 4 * 2**20


@dataclass
class Flow:
    """Datagrams of one length from one port to another; ``unsupported`` names a known sensor that is not decoded."""

    kind: Kind
    address: str
    source_port: int
    port: int
    family: str | None = None
    count: int = 0
    samples: Samples = field(default_factory=Samples)
    unsupported: str | None = None

    @property
    def length(self) -> int:
        """Number of bytes of a payload."""
        return self.kind[1]

    @property
    def ends(self) -> str:
        """Sender and receiver as text."""
        return f"{self.address}:{self.source_port} to port {self.port}"

    def __str__(self) -> str:
        text = f"{count(self.count, 'UDP datagram')} of {count(self.length, 'byte')} from {self.ends}"
        return f"{text} ({self.unsupported}: not supported; {ADVICE})" if self.unsupported else text


@dataclass
class CapturedSensor:
    """A sensor in a capture: its main flow, the kinds of its packets, and samples of them."""

    flow: Flow
    kinds: set[Kind]
    samples: Samples


class SensorSearch:
    """Search for sensors among the datagrams of a capture."""

    def __init__(self) -> None:
        self.flows: dict[Kind, Flow] = {}
        self._calibrated: set[tuple[str, str]] = set()

    def add(self, kind: Kind, packets: Packets) -> None:
        """Add datagrams of a kind to the search."""
        flow = self.flows.get(kind) or Flow(kind, *ends(kind[0]))
        if flow.family is None and flow.count < _TRIED:
            payloads = packets.payloads[:_TRIED_AT_ONCE]
            families = (name for name, one in PACKET_FAMILIES.items() if any(map(one.recognises, payloads)))
            flow.family = next(families, None)
            if flow.family is None:
                flow.unsupported = flow.unsupported or name_unsupported(payloads[0])
        flow.count += len(packets)
        if flow.family is not None:
            self._sample(flow, packets, flow.family)
        if flow.family is not None or len(self.flows) < _MAX_FLOWS:
            self.flows[kind] = flow

    def _sample(self, flow: Flow, packets: Packets, name: str) -> None:
        family, samples, sensor = PACKET_FAMILIES[name], flow.samples, (name, flow.address)
        searched = family.calibrates and (sensor not in self._calibrated or not samples.data)
        if len(samples.data) < MAX_SAMPLES or searched:
            samples.add(packets, family)
            if len(samples.calibrations) >= MAX_CALIBRATIONS:
                self._calibrated.add(sensor)

    def damaged_flows(self) -> list[Flow]:
        """Return flows of few packets, probably damaged ones of another flow: only address, or only length differs."""
        most: dict[tuple[str | None, int] | str, int] = defaultdict(int)
        for flow in self.flows.values():
            if flow.family is not None:
                most[flow.family, flow.length] = max(most[flow.family, flow.length], flow.count)
                most[flow.ends] = max(most[flow.ends], flow.count)
        few = [flow for flow in self.flows.values() if flow.count < _FEW and not flow.samples.calibrations]
        like = [(flow, (flow.family, flow.length) if flow.samples.data else flow.ends) for flow in few]
        return [flow for flow, key in like if flow.count * 100 < most[key]]

    def headless(self, file: LogFile, udp: Udp) -> list[tuple[Flow, int]]:
        """Return flows of sensors, each with the number of packets like its own whose headers are damaged."""
        like = {(flow.family, flow.length): flow for flow in self.flows.values() if flow.samples.data}
        found = []
        for (family, length), flow in like.items():
            if length in udp.shapes:  # not if it is sent in fragments
                size, start = udp.shapes[length]
                records = (file[at + start : at + start + length] for at, other in udp.unread if other == size)
                number = sum(PACKET_FAMILIES[family or ""].recognises(np.frombuffer(one, np.uint8)) for one in records)
                found += [(flow, number)] if number else []
        return found

    def sensors(self) -> list[CapturedSensor]:
        """Return the sensors, sorted by address, port and family."""
        groups: dict[tuple[str, str], list[Flow]] = defaultdict(list)
        damaged = {flow.kind for flow in self.damaged_flows()}
        for flow in sorted(self.flows.values(), key=lambda flow: (flow.port, flow.source_port)):
            if flow.family is not None and flow.kind not in damaged:
                groups[flow.address, flow.family].append(flow)
        found = _without_copies([sensor for group in groups.values() for sensor in _split(group)])
        return sorted(found, key=lambda sensor: (sensor.flow.address, sensor.flow.port, sensor.flow.family))


def _split(flows: Sequence[Flow]) -> list[CapturedSensor]:
    """Return the sensors at one address: one for each port that receives data of the main packet length."""
    data = [flow for flow in flows if flow.samples.data]
    calibrating = [flow for flow in flows if flow.samples.calibrations]
    separate = [flow for flow in calibrating if not flow.samples.data]
    by_length: dict[int, list[Flow]] = defaultdict(list)
    for flow in data:
        by_length[flow.length].append(flow)
    main = max(by_length.values(), key=lambda alike: sum(flow.count * flow.length for flow in alike), default=[])
    sensors = []
    for index, flow in enumerate(main):
        own = data if len(main) == 1 else [alike[index] for alike in by_length.values() if len(alike) == len(main)]
        of_all = [separate[index]] if len(separate) == len(main) else calibrating
        sources = [flow] if flow.samples.calibrations else of_all
        calibrations = [pair for one in sources for pair in one.samples.calibrations]
        kinds = {one.kind for one in (*own, *(separate if index == 0 else ()))}
        sensors.append(CapturedSensor(flow, kinds, Samples(flow.samples.data, calibrations)))
    return sensors


def _without_copies(sensors: Sequence[CapturedSensor]) -> list[CapturedSensor]:
    """Return sensors without those that send the packets of another, as on a mirrored port; these count as repeated."""
    kept: list[tuple[CapturedSensor, set[bytes]]] = []
    for sensor in sensors:
        payloads = {payload for _, payload in sensor.samples.data}
        same = (one for one, other in kept if 2 * len(payloads & other) > min(len(payloads), len(other)) > 1)
        if original := next(same, None):
            original.kinds |= sensor.kinds
        else:
            kept.append((sensor, payloads))
    return [sensor for sensor, _ in kept]


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
            found = self._search()
            decoders = self._usable(found)
        except BaseException:
            self._file.close()
            raise
        self._sensors = sensors = [sensor for sensor, _ in decoders]
        used = Counter(sensor.flow.address for sensor in found)
        topics = [f"/points/{one.flow.address}" + f"/{one.flow.port}" * (used[one.flow.address] > 1) for one in sensors]
        topics = topics if len(topics) > 1 else ["/points"]
        schema = ros2_schema(POINT_CLOUD)
        self.channels = [Channel(number, topic, "cdr", schema) for number, topic in enumerate(topics, 1)]
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

    def _search(self) -> list[CapturedSensor]:
        """Return the sensors in the whole capture: the calibration of one may be anywhere in it."""
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
            self.report(problem, flow.count * flow.length, path=self._path)
        for flow, number in search.headless(self._file, udp):
            problem = f"{count(number, 'packet')} like those from {flow.ends}, with damaged headers"
            self.report(problem, number * flow.length, path=self._path)
        if udp.fragments.lost:
            self.warnings.append(f"fragments of {count(udp.fragments.lost, 'datagram')} are missing")
        if not (sensors := search.sensors()):
            found = _found(search, udp, self.damage)
            raise InputError(f"{self._path}: no packets of a supported lidar; {found}")
        self.warnings += [f"{flow} are not decoded" for flow in search.flows.values() if flow.unsupported]
        return sensors

    def _usable(self, found: Sequence[CapturedSensor]) -> list[tuple[CapturedSensor, PacketDecoder]]:
        """Return the sensors that can be decoded, and their decoders; `InputError` if there are no such sensors."""
        usable: list[tuple[CapturedSensor, PacketDecoder]] = []
        problems = []
        for sensor in found:
            try:
                usable.append((sensor, self._decoder(sensor)))
            except InputError as error:
                problems.append(f"{sensor.flow.address}: {error}")
        if not usable:
            raise InputError(f"{self._path}: {'; '.join(problems)}")
        self.warnings += problems
        return usable

    def _decoder(self, sensor: CapturedSensor) -> PacketDecoder:
        (sample, info), family = sensor.samples.packets(sensor.flow.length), sensor.flow.family or ""
        options = replace(self._options, info=info)
        if options.calibration is None and (suffix := CALIBRATION_SUFFIXES.get(family)):
            beside = metadata_of(self._path, suffix)
            is_clear = len(beside) == 1 or self._path.with_suffix(suffix) in beside
            options = replace(options, calibration=beside[0] if is_clear else None)
        return PACKET_FAMILIES[family].decoder(sample, options)

    def records(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Message]:  # noqa: ARG002
        """Yield the frames of all sensors in the order of their stamps, until every sensor has one at ``end_ns``."""
        streams = self._start([self._decoder(sensor) for sensor in self._sensors])
        kinds = {kind: number for number, sensor in enumerate(self._sensors) for kind in sensor.kinds}
        flows = {flow: number for (flow, _), number in kinds.items()}
        merge = _Merge(streams)
        udp = Udp(self._file)
        try:
            for number, packets in udp.packets(self._reader(), kinds.get):
                for frame in streams[number].add(packets):
                    yield from merge.add(number, frame)
                if end_ns is not None and min(merge.latest_ns) >= end_ns:
                    yield from merge.finish()
                    return
        except LostDataError as error:
            self.report(f"{error.problem}; the frames after this are missing", path=self._path)
        for number, stream in enumerate(streams):
            for frame in stream.finish():
                yield from merge.add(number, frame)
        yield from merge.finish()
        for number, stream in enumerate(streams):
            own = sum(udp.cut[flow] for flow, sensor in flows.items() if sensor == number)
            stream.conclude(self._path, "where the capture begins or ends", own)

    def _start(self, decoders: Sequence[PacketDecoder]) -> list[CloudStream]:
        self.facts = {channel.topic: one.facts for channel, one in zip(self.channels, decoders, strict=True)}
        self.warn(*(f"{topic}: {text}" for topic, facts in self.facts.items() for text in facts.warnings))
        sizes = (sensor.flow.length for sensor in self._sensors)
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
        self.latest_ns = [0] * len(streams)
        """Times up to which the frames of the sensors have been added."""

    def add(self, number: int, frame: PacketFrame) -> Iterator[Message]:
        self._waiting[number].append(frame)
        self.latest_ns[number] = frame.stamp_ns
        while all(self._waiting) or max(map(len, self._waiting)) > _MAX_WAITING:
            yield from self._next()

    def finish(self) -> Iterator[Message]:
        while any(self._waiting):
            yield from self._next()

    def _next(self) -> Iterator[Message]:
        waiting = (number for number, frames in enumerate(self._waiting) if frames)
        number = min(waiting, key=lambda number: self._waiting[number][0].stamp_ns)
        frame = self._waiting[number].popleft()
        # Beyond the limit, the recorded time is damaged.
        frame = replace(frame, stamp_ns=min(max(frame.stamp_ns, 0), _LATEST_NS))
        yield from self._streams[number].messages([frame])


def _found(search: SensorSearch, udp: Udp, damage: Sequence[Damage]) -> str:
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
